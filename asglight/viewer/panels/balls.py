# SPDX-License-Identifier: Apache-2.0
"""The balls: the picture itself, the orbit by drag, the wipe line, the errors under each ball."""

from imgui_bundle import ImVec2, imgui

from asglight.viewer.gl.arrangement import Cell, cells, hit, strip
from asglight.viewer.gl.inspecting import inspect
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.panels import legend, widgets
from asglight.viewer.panels.lights.highlight import highlight
from asglight.viewer.state.compared.titles import titles
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Probe, Scene

_WIPE_GRIP = 0.6
"""Half width, in heights of the font, of the strip where the wipe line can be taken."""

_TITLE_EM = 1.25
"""Heights of the font of the row above the picture."""

_SPACE = "      "
"""Between titles on one row."""

_MOUSE = int(imgui.ButtonFlags_.mouse_button_left) | int(imgui.ButtonFlags_.mouse_button_right)


def balls(state: ViewerState, renderer: Renderer) -> None:
    """Draw the picture as large as the room, with what lies over it."""
    room = imgui.get_content_region_avail()
    above = widgets.em(_TITLE_EM)
    points = max(1, int(room.x)), max(1, int(room.y - above - legend.room_below()))
    density = imgui.get_io().display_framebuffer_scale
    size = round(points[0] * density.x), round(points[1] * density.y)
    corner = imgui.get_cursor_screen_pos()
    origin = ImVec2(corner.x, corner.y + round(above))  # whole points: a texel is a pixel
    imgui.set_cursor_screen_pos(origin)
    target = renderer.balls(state, size)
    imgui.image(imgui.ImTextureRef(target.color_attachments[0].glo), ImVec2(*points))
    imgui.set_cursor_screen_pos(origin)
    imgui.set_next_item_allow_overlap()
    imgui.invisible_button("##picture", ImVec2(*points), _MOUSE)
    if not highlight(state, origin, points):
        _mouse(state, origin, points)
    if imgui.is_item_hovered():
        pointer = imgui.get_mouse_pos()
        _probe(state, points, (pointer.x - origin.x, pointer.y - origin.y))
    inspect(state, renderer, points)
    _pin(state, origin, points)
    _titles(state, renderer, corner, points[0])
    _labels(state, renderer, origin, points)
    legend.legend(state, state.shown, ImVec2(origin.x, origin.y + points[1]), points[0])


def _mouse(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Orbit, or move the wipe line."""
    compared = state.compared
    is_wipe = state.shown is Comparison.WIPE
    line = origin.x + compared.wipe * points[0]
    if imgui.is_item_activated():
        away = abs(imgui.get_mouse_pos().x - line)
        state.moves_wipe = is_wipe and away < widgets.em(_WIPE_GRIP)
    if imgui.is_item_active():
        delta = imgui.get_io().mouse_delta
        if state.moves_wipe:
            share = (imgui.get_mouse_pos().x - origin.x) / points[0]
            compared.wipe = max(0.0, min(1.0, share))
        elif imgui.is_mouse_down(imgui.MouseButton_.right):
            state.camera.turn_environment(delta.x * 360 / points[0])
        else:
            state.camera.orbit(delta.x, delta.y)
    if imgui.is_item_hovered() and imgui.get_io().mouse_wheel:
        state.display.expose(0.25 * imgui.get_io().mouse_wheel)
    if is_wipe:
        draw = imgui.get_window_draw_list()
        draw.add_line_v(line, origin.y, origin.y + points[1], widgets.colour(widgets.ACCENT), 2.0)


def _probe(state: ViewerState, points: tuple[int, int], pointer: tuple[float, float]) -> None:
    """Read the ball under the pointer from now on; beside the balls the last one stays."""
    if state.scene is Scene.GROUND or state.is_pinned:
        return
    x, y = pointer
    columns, rows = points
    top, strip_rows = strip(rows, state.parts)
    y = y % strip_rows if state.shown is Comparison.ROWS else y - top
    rows = strip_rows
    if hit(cells((columns, rows), len(state.balls)), x, y) is not None:
        state.probe = Probe("balls", x / columns, y / rows)


def _pin(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Mark where the probe is pinned, in each row of balls."""
    probe = state.probe
    if not state.is_pinned or probe is None or probe.place != "balls":
        return
    top, rows = strip(points[1], state.parts)
    rows_shown = range(state.parts) if state.shown is Comparison.ROWS else [0]
    first = 0 if state.shown is Comparison.ROWS else top
    for row in rows_shown:
        y = origin.y + first + row * rows + probe.y * rows
        widgets.cross(origin.x + probe.x * points[0], y)


def _titles(state: ViewerState, renderer: Renderer, origin: ImVec2, width: float) -> None:
    """Say above the picture what it shows: on a row of its own, whatever the size of the balls."""
    left, right = _title(state, renderer)
    draw = imgui.get_window_draw_list()
    draw.add_text(origin, widgets.ink(0.9), left)
    if right:
        end = origin.x + width - imgui.calc_text_size(right).x
        draw.add_text(ImVec2(end, origin.y), widgets.ink(0.9), right)


def _title(state: ViewerState, renderer: Renderer) -> tuple[str, str]:
    """Return what stands above the picture, left and right."""
    fit, reference, truth = titles(state)
    if state.scene is Scene.GROUND:
        light = fit if state.keyed is None else "Lobes, as fitted: keys and rest light balls only"
        return f"{light}, {state.balls[state.ground_ball].name}", ""
    progress = "   preview" if state.is_moving and state.references else _progress(renderer)
    shown, has_truth = state.shown, state.parts == 3
    if shown is Comparison.ROWS and has_truth:
        return _SPACE.join([f"above: {fit}", f"middle: {reference}", f"below: {truth}"]), progress
    second = reference if has_truth else f"{reference}{progress}"
    if shown is Comparison.ROWS:
        return f"above: {fit}{_SPACE}below: {second}", ""
    if shown is Comparison.FIT:
        return fit, ""
    if shown is Comparison.REFERENCE:
        return second, ""
    if shown is Comparison.WIPE:
        return fit, second
    sign = "minus" if shown is Comparison.DIFFERENCE else "over"
    return f"{fit} {sign} {second}", ""


def _labels(
    state: ViewerState, renderer: Renderer, origin: ImVec2, points: tuple[int, int]
) -> None:
    """Name the balls, and say how far each is off."""
    if state.scene is Scene.GROUND:
        return
    top, rows = strip(points[1], state.parts)
    has_truth = state.parts == 3
    errors = _percent(renderer.ball_errors(state) if state.parts > 1 else None)
    of_b = _percent(renderer.ball_errors(state, of_b=True) if has_truth else None)
    size = points[0], rows
    if state.shown is Comparison.ROWS:
        lines = [errors, of_b, None] if has_truth else [None, errors]
        for part, texts in enumerate(lines[: state.parts]):
            _ball_labels(state, size, ImVec2(origin.x, origin.y + part * rows), texts)
        return
    texts = errors
    if errors is not None and of_b is not None:
        texts = [f"\nA {a}\nB {b}" for a, b in zip(errors, of_b, strict=True)]
    _ball_labels(state, size, ImVec2(origin.x, origin.y + top), texts)


def _percent(errors: list[float | None] | None) -> list[str] | None:
    """Return errors as they are written under balls."""
    if errors is None:
        return None
    return ["" if error is None else f"{100 * error:.1f} %" for error in errors]


def _ball_labels(
    state: ViewerState,
    points: tuple[int, int],
    origin: ImVec2,
    texts: list[str] | None,
) -> None:
    """Name each ball under it, with its errors."""
    row = state.balls
    arrangement = cells(points, len(row))
    errors = [""] * len(row) if texts is None else texts
    names = [ball.name for ball in row]
    gap = "" if errors[0].startswith("\n") else "   "
    labels = [f"{name}{gap}{error}".rstrip() for name, error in zip(names, errors, strict=True)]
    room = 1.2 * arrangement[0].size
    # One would touch its neighbour, or one of another row would: all are shortened.
    if _widest(labels) > room or state.parts == 3:
        labels = [label.removeprefix("roughness ") for label in labels]
    if _widest(labels) > room and any(errors):  # the balls are the same in every picture
        labels = [error.strip() for error in errors]
    for cell, label in zip(arrangement, labels, strict=True):
        x, y = _under(cell, origin, points)
        widgets.label_over(x, y, label, align=0.5)


def _widest(labels: list[str]) -> float:
    return max(imgui.calc_text_size(label).x for label in labels)


def _under(cell: Cell, origin: ImVec2, points: tuple[int, int]) -> tuple[float, float]:
    """Return where a label begins: under the ball, or over its lower edge where no room is."""
    bottom = origin.y + points[1] - 1.1 * imgui.get_font_size()
    below = origin.y + cell.y + cell.size + widgets.em(0.15)
    return origin.x + cell.x + cell.size / 2, min(below, bottom)


def _progress(renderer: Renderer) -> str:
    share = renderer.reference_progress
    return "" if share >= 1 else f"   rendering, {100 * share:.0f} %"
