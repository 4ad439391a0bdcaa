# SPDX-License-Identifier: Apache-2.0
"""The latlong map of reference and fit, with each lobe's outline and axes over it."""

from functools import lru_cache

import numpy as np
import torch
from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.lobes import LobeTracks
from asglight.sphere import latlong
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.panels import legend, widgets
from asglight.viewer.state.commands import command
from asglight.viewer.state.edits import acting
from asglight.viewer.state.held import Held
from asglight.viewer.state.picking import pick
from asglight.viewer.state.shown import shown_lobes
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Outlines, Probe
from asglight.viewer.uniforms import key_cards, outlines

CLICK_POINTS = 4.0
"""As far from a small lobe a click still means it."""

ZOOM_STEP = 1.25
"""For a notch of the wheel: three of them double the map."""

STILL_EM = 0.7
"""Heights of the font by which a pressed pointer has to move before it turns a lobe: a hand
trembles by a few points, with a pen by more."""

KEPT_TIMES = 256
"""Times whose outlines are kept, ten seconds of a shot: they take milliseconds, and a shot that is
looked at plays again and again. Those of 15 lobes are 10 kB."""

_KEY, _SHADOW = ImVec4(1.0, 1.0, 1.0, 0.9), ImVec4(0.0, 0.0, 0.0, 0.7)
"""Of the rectangles of keys: on a lamp nothing faint is seen."""


def latlong_map(state: ViewerState, renderer: Renderer) -> None:
    """Draw the map as large as it fits at two to one, and let lobes be clicked and dragged."""
    if state.subjects:
        imgui.set_next_item_width(widgets.em(9))
        state.map_view.comparison = widgets.choice(
            "##map_view",
            state.map_view.comparison,
            "What the map shows of fit and reference, or of A and B.",
        )
        imgui.same_line()
    imgui.set_next_item_width(widgets.em(9))
    outlined = command("Outlines in the map: all, selected, none")
    state.outlines = widgets.choice(
        "##outlines", state.outlines, "Which lobes are drawn over the map.", outlined.keys
    )
    if state.map_frame.zoom > 1:
        imgui.same_line()
        label = f"{state.map_frame.zoom:.3g} x###whole"
        widgets.button(state, "All of the map", label, "Show all of the map again.")
    room = imgui.get_content_region_avail()
    rows = max(1, int(min(room.x / 2, room.y - legend.room_below())))
    points = 2 * rows, rows
    density = imgui.get_io().display_framebuffer_scale
    target = renderer.map(state, (round(points[0] * density.x), round(points[1] * density.y)))
    origin = imgui.get_cursor_screen_pos()
    imgui.image(imgui.ImTextureRef(target.color_attachments[0].glo), ImVec2(*points))
    imgui.set_cursor_screen_pos(origin)
    imgui.invisible_button("##map", ImVec2(*points))
    _move_frame(state, origin, points)
    # all of the map, of which the panel shows a part
    left, top, wide, high = state.map_frame.area(*points)
    whole = ImVec2(origin.x + left, origin.y + top)
    size = max(1, round(wide)), max(1, round(high))
    _mouse(state, whole, size)
    draw = imgui.get_window_draw_list()
    draw.push_clip_rect(origin, ImVec2(origin.x + points[0], origin.y + points[1]), True)
    _lobes(state, whole, size)
    probe = state.probe
    if state.is_pinned and probe is not None and probe.place == "map":
        widgets.cross(whole.x + probe.x * wide, whole.y + probe.y * high)
    draw.pop_clip_rect()
    legend.legend(state, state.shown_map, ImVec2(origin.x, origin.y + points[1]), points[0])


def _move_frame(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Zoom by the wheel, about the pointer; move what is shown by the middle button."""
    if not imgui.is_item_hovered():
        return
    io, frame = imgui.get_io(), state.map_frame
    if io.mouse_wheel:
        x = (io.mouse_pos.x - origin.x) / points[0]
        y = (io.mouse_pos.y - origin.y) / points[1]
        frame.zoom_at(x, y, ZOOM_STEP**io.mouse_wheel)
    if imgui.is_mouse_down(imgui.MouseButton_.middle):
        frame.pan(io.mouse_delta.x / points[0], io.mouse_delta.y / points[1])


def _mouse(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Click: select lobes. Drag: turn those selected, of which the drag began on one."""
    if not (imgui.is_item_hovered() or imgui.is_item_active()):
        return
    place = _place(imgui.get_mouse_pos(), origin, points)
    if not state.is_pinned:
        state.probe = Probe("map", *place)
    editing = state.editing
    tolerance = CLICK_POINTS * np.pi / points[1]
    if imgui.is_item_activated():
        _pick(state, _direction(place).tolist(), tolerance)
        editing.drag_from = _direction(place).tolist()
    if imgui.is_item_active() and state.selected and editing.reaches(state.moment):
        delta = imgui.get_mouse_drag_delta(imgui.MouseButton_.left, widgets.em(STILL_EM))
        if delta.x or delta.y:
            target = _direction(place).tolist()
            editing.turn_to(state.history, state.selected, state.moment, target)
    if imgui.is_item_deactivated():
        editing.commit(state.history)


def _pick(state: ViewerState, direction: list[float], tolerance: float) -> None:
    """Select the lobe that a click means; with Ctrl or Shift beside the others.

    A click on one of several that are selected keeps them, so that they can be dragged.
    """
    present = state.history.present
    lobes = state.lobes.select(torch.tensor(present, dtype=torch.long))
    found = pick(lobes, direction, tolerance)
    lobe = None if found is None else present[found]
    io = imgui.get_io()
    adds = io.key_ctrl or io.key_shift
    if lobe is not None and adds:
        acting.select_also(state, lobe)
    elif not adds and (lobe is None or lobe not in state.selected):
        state.select(lobe)


def _lobes(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    draw = imgui.get_window_draw_list()
    lit, selected = state.lit, state.selected
    present = state.history.present
    wanted = {
        Outlines.ALL: present,
        Outlines.SELECTED: tuple(index for index in present if index in selected),
        Outlines.NONE: (),
    }[state.outlines]
    are_keys = state.keyed is not None
    others = _KEY if are_keys else widgets.FAINT
    is_draft = state.playback.is_playing
    segments = outlines.DRAFT_SEGMENTS if is_draft else outlines.RING_SEGMENTS
    moment = Held(state.tracks), state.playback.index, state.playback.part
    shows_all = state.outlines is Outlines.ALL
    drawn = _curves(*moment, are_keys, segments) if shows_all else []
    centres = torch.stack(latlong.uv_from_direction(state.lobes.axis_z), dim=-1).tolist()
    for index in wanted:
        is_selected = index in selected
        shade = widgets.ACCENT if is_selected else others
        colour = widgets.colour(shade, 1.0 if index in lit else 0.35)
        # As fine as the others while the shot plays; its arms come back at rest.
        outline = None
        if is_selected and not (is_draft and shows_all):
            outline = _outline(*moment, index, are_keys)
        for line in outline.curves if outline else drawn[index]:
            if are_keys:
                _polyline(draw, line, origin, points, widgets.colour(_SHADOW), 4.0)
            _polyline(draw, line, origin, points, colour, 2.0 if is_selected else 1.0)
        for line in (*outline.arm_x, *outline.arm_y) if outline else ():
            _polyline(draw, line, origin, points, colour, 1.0)
        u, v = centres[index]
        centre = ImVec2(origin.x + u * points[0], origin.y + v * points[1])
        draw.add_circle_filled(centre, 3.0 if is_selected else 2.0, colour)


@lru_cache(maxsize=KEPT_TIMES)
def _curves(
    tracks: Held[LobeTracks], index: int, part: float, are_keys: bool, segments: int
) -> list[outlines.Polylines]:
    """Return the outlines at a time, as of `shown_lobes`."""
    lobes = shown_lobes(tracks, index, part)
    if are_keys:
        return [outline.curves for outline in key_cards.outlines(lobes)]
    return outlines.curves(lobes, segments=segments)


@lru_cache(maxsize=KEPT_TIMES)
def _outline(
    tracks: Held[LobeTracks], index: int, part: float, lobe: int, are_keys: bool
) -> outlines.Outline:
    """Return the outline of one lobe, or the rectangle of one key, with its arms."""
    one = shown_lobes(tracks, index, part).select(torch.tensor([lobe]))
    return (key_cards.outlines if are_keys else outlines.outlines)(one)[0]


def _polyline(
    draw: imgui.ImDrawList,
    line: np.ndarray,
    origin: ImVec2,
    points: tuple[int, int],
    colour: int,
    thickness: float,
) -> None:
    scaled = line * points + [origin.x, origin.y]
    draw.add_polyline([ImVec2(*point) for point in scaled.tolist()], colour, thickness, 0)


def _place(mouse: ImVec2, origin: ImVec2, points: tuple[int, int]) -> tuple[float, float]:
    """Return the pointer's latlong coordinates, held within the map."""
    u, v = (mouse.x - origin.x) / points[0], (mouse.y - origin.y) / points[1]
    return max(0.0, min(1.0, u)), max(0.0, min(1.0, v))


def _direction(place: tuple[float, float]) -> np.ndarray:
    u, v = (torch.tensor(value, dtype=torch.float64) for value in place)
    return latlong.direction_from_uv(u, v).numpy()
