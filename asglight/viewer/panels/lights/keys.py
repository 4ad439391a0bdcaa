# SPDX-License-Identifier: Apache-2.0
"""What the list says of a keyed stage under its keys: the rest, and the lobes that do not light."""

import torch
from imgui_bundle import ImVec2, imgui

from asglight.viewer.panels import widgets
from asglight.viewer.state import picking
from asglight.viewer.state.viewer_state import ViewerState

_TABLE = imgui.TableFlags_.row_bg | imgui.TableFlags_.sizing_stretch_prop

ROWS_BESIDE = 4
"""Rows of the list below the keys, as high as those of lobes."""


def beside_keys(state: ViewerState, total: float) -> None:
    """List the rest with its share of the light, and then the lobes.

    Args:
        state: Of a keyed stage.
        total: Energy of keys and rest.
    """
    assert state.keyed is not None
    if imgui.begin_table("rest", 2, _TABLE):
        for name, width in (("rest", 2.6), ("energy", 2.4)):
            imgui.table_setup_column(name, imgui.TableColumnFlags_.width_stretch, width)
        imgui.table_headers_row()
        imgui.table_next_row()
        imgui.table_next_column()
        imgui.text("images without the keys")
        imgui.table_next_column()
        share = state.rest_energy / total
        imgui.progress_bar(share, ImVec2(-1, imgui.get_font_size()), f"{100 * share:.1f} %")
        imgui.end_table()
    lobes = state.keyed.lobes
    if imgui.collapsing_header(f"{lobes.lobes.count} lobes, not lit"):
        imgui.text_wrapped(
            "Keys and rest are the light that this stage shows. Open a variant of its lobes to see "
            "them."
        )
        energies = picking.energies(lobes.lobes[state.playback.index])
        order = torch.argsort(energies, descending=True).tolist()
        imgui.begin_disabled()
        light = max(float(energies.sum()), 1e-30)  # 1e-30: black ones have shares of 0
        for lobe in order:
            imgui.text(f"{lobes.names[lobe]}  {100 * float(energies[lobe]) / light:.1f} %")
        imgui.end_disabled()
    widgets.tooltip("Lobes", "What the fit found, which keys and rest stand in for")
