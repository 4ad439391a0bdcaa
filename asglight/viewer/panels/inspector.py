# SPDX-License-Identifier: Apache-2.0
"""The numbers under the pointer."""

import numpy as np
from imgui_bundle import imgui

from asglight.viewer.state.display import Subject
from asglight.viewer.state.inspector import angles_deg, stops
from asglight.viewer.state.viewer_state import ViewerState

LOBES_SHOWN = 4


def inspector(state: ViewerState) -> None:
    """Draw the numbers of what the pointer was over last."""
    inspected = state.inspected
    if inspected is None:
        imgui.text_disabled("Point at a ball or at the map.")
        return
    longitude, latitude = angles_deg(inspected.direction)
    x, y, z = inspected.direction
    imgui.text(inspected.place)
    imgui.same_line()
    imgui.text_disabled(
        f"lon {longitude:+.1f} deg  lat {latitude:+.1f} deg   ({x:+.2f}, {y:+.2f}, {z:+.2f})"
    )
    if imgui.begin_table("radiance", 5, imgui.TableFlags_.sizing_stretch_prop):
        for heading in ("", "R", "G", "B", "EV"):
            imgui.table_next_column()
            imgui.text_disabled(heading)
        is_b = state.subject is Subject.AGAINST
        _row("A" if is_b else "fit", inspected.fit)
        _row("B" if is_b else "reference", inspected.reference)
        imgui.end_table()
    parts = [f"{state.lobe_names[lobe]} {100 * share:.0f} %" for lobe, share in inspected.shares]
    imgui.text_disabled("from " + ", ".join(parts[:LOBES_SHOWN]) if parts else "from no lobe")
    imgui.set_item_tooltip("Lobes that send light from this direction, by share of luminance")


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
