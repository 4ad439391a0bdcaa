# SPDX-License-Identifier: Apache-2.0
"""A highlight under the hand: with Ctrl, a click or drag on a ball turns the selected light there.

A mirror shows at a point of the ball what lies in the reflected direction; the light goes to it.
"""

import numpy as np
from imgui_bundle import ImVec2, imgui

from asglight.viewer.gl.arrangement import cells, hit, mirroring, strip
from asglight.viewer.panels import widgets
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.viewer_state import ViewerState

_RING_EM = 0.45
"""Radius of the ring around the highlight."""


def highlight(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> bool:
    """Let the highlight be put where the pointer is; to follow the item of the picture.

    Args:
        state: The session.
        origin: Top left corner of the picture, in points.
        points: Its width and height.

    Returns:
        Whether the hand does so now, and nothing else with the picture.
    """
    editing, is_held = state.editing, imgui.get_io().key_ctrl
    if imgui.is_item_activated():
        editing.aims = is_held and imgui.is_mouse_down(imgui.MouseButton_.left)
    if is_held and (imgui.is_item_hovered() or editing.aims):
        _rings(state, origin, points)
    if not editing.aims:
        return False
    if imgui.is_item_active():
        _aim(state, origin, points)
    if imgui.is_item_deactivated():
        editing.commit(state.history)
        editing.aims = False
    return True


def _aim(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Turn the selected lights so that the first is reflected at the pointer."""
    if not state.selected:
        state.message = "No lobe is selected. Click one in the map or in the list."
        return
    if state.playback.is_between or not state.editing.reaches(state.moment):
        state.message = "A highlight is put in a frame that the edit reaches, not between frames."
        return
    mouse = imgui.get_mouse_pos()
    tops, rows = _strips(state, points[1])
    x, y = mouse.x - origin.x, mouse.y - origin.y
    y -= max((top for top in tops if top <= y), default=tops[0])
    found = hit(cells((points[0], rows), len(state.balls)), x, y)
    if found is None:  # beside the balls: the light stays where it was last
        return
    direction = state.camera.from_environment().T @ found.mirrored
    state.editing.aim(state.history, state.selected, state.moment, direction.tolist())


def _rings(state: ViewerState, origin: ImVec2, points: tuple[int, int]) -> None:
    """Mark where each ball mirrors the selected light."""
    if not state.selected:
        return
    draw = imgui.get_window_draw_list()
    axis = state.lobes.axis_z[state.selected[0]].numpy().astype(np.float64)
    normal = mirroring(state.camera.from_environment() @ axis)
    if normal is None:
        return
    tops, rows = _strips(state, points[1])
    for top in tops:
        for cell in cells((points[0], rows), len(state.balls)):
            x = origin.x + cell.x + (1 + normal[0]) / 2 * cell.size
            y = origin.y + top + cell.y + (1 - normal[1]) / 2 * cell.size
            colour = widgets.colour(widgets.ACCENT)
            draw.add_circle(ImVec2(x, y), widgets.em(_RING_EM), colour, 0, 2.0)


def _strips(state: ViewerState, rows: int) -> tuple[list[int], int]:
    """Return where the rows of balls begin, and how high each is."""
    top, each = strip(rows, state.parts)
    if state.shown is not Comparison.ROWS:
        return [top], each
    return [part * each for part in range(state.parts)], each
