# SPDX-License-Identifier: Apache-2.0
"""The numbers under the pointer."""

import numpy as np
from imgui_bundle import ImVec2, imgui

from asglight.viewer.gl.arrangement import strip
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.panels import widgets
from asglight.viewer.state.display import Comparison, Subject
from asglight.viewer.state.inspector import angles_deg, as_text, stops
from asglight.viewer.state.viewer_state import ViewerState

LOBES_SHOWN = 4


MAGNIFIED = 8
"""Pixels of the magnifier for one of the picture."""

MAGNIFIER_EM = 4.6
"""Height and width of the magnifier."""

WIDTH_EM = 16.0
"""Of the numbers: only in a wider panel there is a magnifier beside them."""


def inspector(state: ViewerState, renderer: Renderer) -> None:
    """Draw the numbers of what the pointer was over last, or of where the probe is pinned."""
    inspected = state.inspected
    if inspected is None:
        imgui.text_disabled("Point at a ball or at the map.")
        return
    azimuth, elevation = angles_deg(inspected.direction)
    name = "let go" if state.is_pinned else "pin"
    widgets.button(state, "Pin the inspector, or let it go", f"{name}###pin", width=3.5)
    imgui.same_line()
    if imgui.button("copy"):
        imgui.set_clipboard_text(as_text(inspected, state.lobe_names))
        state.message = "The numbers of the probe are in the clipboard."
    widgets.tooltip("Put these numbers into the clipboard, apart by tabs.")
    imgui.same_line()
    imgui.text(inspected.place)
    imgui.push_style_var(imgui.StyleVar_.cell_padding, ImVec2(widgets.em(0.25), 0))
    imgui.text_disabled(f"azimuth {azimuth:.1f} deg, elevation {elevation:.1f} deg")
    beside = widgets.em(MAGNIFIER_EM + 0.5) if _magnifier(state, renderer) else 0.0
    width = imgui.get_content_region_avail().x - beside
    flags = imgui.TableFlags_.sizing_stretch_prop
    if imgui.begin_table("radiance", 5, flags, ImVec2(width, 0)):
        for heading in ("", "R", "G", "B", "EV"):
            imgui.table_next_column()
            imgui.text_disabled(heading)
        is_b = state.subject is Subject.AGAINST
        _row("A" if is_b else "fit", inspected.fit)
        _row("B" if is_b else "reference", inspected.reference)
        imgui.end_table()
    imgui.pop_style_var()
    parts = [f"{state.lobe_names[lobe]} {100 * share:.0f} %" for lobe, share in inspected.shares]
    imgui.text_disabled("from " + ", ".join(parts[:LOBES_SHOWN]) if parts else "from no lobe")
    imgui.set_item_tooltip("Lobes that send light from this direction, by share of luminance")


def _magnifier(state: ViewerState, renderer: Renderer) -> bool:
    """Show the pixels around the probe, large, where there is room; tell whether there is."""
    probe, side = state.probe, widgets.em(MAGNIFIER_EM)
    room = imgui.get_content_region_avail()
    if probe is None or room.x < widgets.em(WIDTH_EM + MAGNIFIER_EM):
        return False
    target = renderer.shown(probe.place)
    x, y = probe.x, probe.y
    if probe.place == "map":
        left, top, wide, high = state.map_frame.area(1.0, 1.0)
        x, y = left + x * wide, top + y * high
    else:
        top, rows = strip(target.height, state.parts)
        first = 0 if state.shown is Comparison.ROWS else top
        y = (first + y * rows) / target.height
    across, down = (0.5 * side / MAGNIFIED / length for length in target.size)
    before = imgui.get_cursor_pos()
    imgui.set_cursor_pos(ImVec2(before.x + room.x - side, before.y))
    corner = imgui.get_cursor_screen_pos()
    texture = imgui.ImTextureRef(target.color_attachments[0].glo)
    uv0, uv1 = ImVec2(x - across, y - down), ImVec2(x + across, y + down)
    imgui.image(texture, ImVec2(side, side), uv0, uv1)
    widgets.cross(corner.x + 0.5 * side, corner.y + 0.5 * side)
    imgui.set_cursor_pos(before)
    return True


def _row(name: str, radiance: np.ndarray | None) -> None:
    imgui.table_next_column()
    imgui.text_disabled(name)
    if radiance is None:
        for _ in range(4):
            imgui.table_next_column()
            imgui.text_disabled("-")
        return
    for value in radiance:
        imgui.table_next_column()
        imgui.text(f"{value:.4g}")
    imgui.table_next_column()
    imgui.text(f"{stops(radiance):+.2f}")
