# SPDX-License-Identifier: Apache-2.0
"""The latlong map of reference and fit, with each lobe's outline and axes over it."""

from functools import lru_cache

import numpy as np
import torch
from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.lobes import Lobes
from asglight.sphere import latlong
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.panels import legend, widgets
from asglight.viewer.state.commands import command
from asglight.viewer.state.held import Held
from asglight.viewer.state.picking import pick
from asglight.viewer.state.viewer_state import Outlines, Probe, ViewerState
from asglight.viewer.uniforms import key_cards, outlines

CLICK_POINTS = 4.0
"""As far from a small lobe a click still means it."""

STILL_EM = 0.7
"""Heights of the font by which a pressed pointer has to move before it turns a lobe: a hand
trembles by a few points, with a pen by more."""

_KEY, _SHADOW = ImVec4(1.0, 1.0, 1.0, 0.9), ImVec4(0.0, 0.0, 0.0, 0.7)
"""Of the rectangles of keys: on a lamp nothing faint is seen."""


def latlong_map(state: ViewerState, renderer: Renderer) -> None:
    """Draw the map as large as it fits at two to one, and let lobes be clicked and dragged."""
    if state.references is not None:
        imgui.set_next_item_width(widgets.em(9))
        state.map_view.comparison = widgets.choice(
            "##map_view", state.map_view.comparison, "What the map shows of fit and reference."
        )
        imgui.same_line()
    imgui.set_next_item_width(widgets.em(9))
    outlined = command("Outlines in the map: all, selected, none")
    state.outlines = widgets.choice(
        "##outlines", state.outlines, "Which lobes are drawn over the map.", outlined.keys
    )
    room = imgui.get_content_region_avail()
    rows = max(1, int(min(room.x / 2, room.y - legend.room_below())))
    points = 2 * rows, rows
    density = imgui.get_io().display_framebuffer_scale
    target = renderer.map(state, (round(points[0] * density.x), round(points[1] * density.y)))
    origin = imgui.get_cursor_screen_pos()
    imgui.image(imgui.ImTextureRef(target.color_attachments[0].glo), ImVec2(*points))
    imgui.set_cursor_screen_pos(origin)
    imgui.invisible_button("##map", ImVec2(*points))
    _mouse(state, origin, points)
    _lobes(state, origin, points)
    legend.legend(state, state.shown_map, ImVec2(origin.x, origin.y + points[1]), points[0])


def _mouse(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Click: select a lobe. Drag: turn the lobe that the drag began on."""
    if not (imgui.is_item_hovered() or imgui.is_item_active()):
        return
    place = _place(imgui.get_mouse_pos(), origin, points)
    state.probe = Probe("map", *place)
    editing = state.editing
    tolerance = CLICK_POINTS * np.pi / points[1]
    if imgui.is_item_activated():
        state.select(pick(state.lobes, _direction(place).tolist(), tolerance))
        editing.drag_from = _direction(place).tolist()
    if imgui.is_item_active() and state.selection.lobe is not None:
        delta = imgui.get_mouse_drag_delta(imgui.MouseButton_.left, widgets.em(STILL_EM))
        if delta.x or delta.y:
            target = _direction(place).tolist()
            editing.turn_to(state.history, state.selection.lobe, state.playback.index, target)
    if imgui.is_item_deactivated():
        editing.commit(state.history)


def _lobes(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    draw = imgui.get_window_draw_list()
    end = ImVec2(origin.x + points[0], origin.y + points[1])
    draw.push_clip_rect(origin, end, True)
    lit = state.lit
    drawn = _cards if state.keyed is not None else _outlines
    for index, outline in enumerate(drawn(Held(state.lobes))):
        is_selected = index == state.selection.lobe
        if state.outlines is Outlines.NONE or (
            state.outlines is Outlines.SELECTED and not is_selected
        ):
            continue
        others = widgets.FAINT if state.keyed is None else _KEY
        shade = widgets.ACCENT if is_selected else others
        colour = widgets.colour(shade, 1.0 if index in lit else 0.35)
        for line in outline.curves:
            if state.keyed is not None:
                _polyline(draw, line, origin, points, widgets.colour(_SHADOW), 4.0)
            _polyline(draw, line, origin, points, colour, 2.0 if is_selected else 1.0)
        if is_selected:
            for line in (*outline.arm_x, *outline.arm_y):
                _polyline(draw, line, origin, points, colour, 1.0)
        u, v = latlong.uv_from_direction(state.lobes.axis_z[index])
        centre = ImVec2(origin.x + float(u) * points[0], origin.y + float(v) * points[1])
        draw.add_circle_filled(centre, 3.0 if is_selected else 2.0, colour)
    draw.pop_clip_rect()


@lru_cache(maxsize=2)
def _outlines(lobes: Held[Lobes]) -> list[outlines.Outline]:
    """Return the outlines of a frame; a thousandth of a second each, so that they are kept."""
    return outlines.outlines(lobes.value)


@lru_cache(maxsize=2)
def _cards(keys: Held[Lobes]) -> list[outlines.Outline]:
    """Return the rectangles of keys, likewise."""
    return key_cards.outlines(keys.value)


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
