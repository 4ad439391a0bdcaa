# SPDX-License-Identifier: Apache-2.0
"""The lobes by energy: select, solo, mute, and edit the selected one."""

from collections.abc import Callable

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.viewer import picking
from asglight.viewer.commands import command
from asglight.viewer.editing import SHARPNESS_STOPS
from asglight.viewer.edits import EditHistory
from asglight.viewer.panels import widgets
from asglight.viewer.state import INTENSITY_EV_MAX, ViewerState

_TABLE = (
    imgui.TableFlags_.scroll_y | imgui.TableFlags_.row_bg | imgui.TableFlags_.sizing_stretch_prop
)


def lobes(state: ViewerState) -> None:
    """Draw the list, and under it the controls of the selected lobe."""
    if state.tracks.lobes.count == 0:
        imgui.text_wrapped("No lobes yet. Fit them with: asglight fit INPUT -o shot.usda")
        return
    room = imgui.get_content_region_avail()
    controls = widgets.em(13)
    imgui.begin_child("list", ImVec2(0, max(room.y - controls, widgets.em(6))))
    _list(state)
    imgui.end_child()
    _edits(state)


def _list(state: ViewerState) -> None:
    energies = picking.energies(state.lobes)
    total = max(float(energies.sum()), 1e-30)  # 1e-30: a black frame has shares of 0
    if not imgui.begin_table("lobes", 4, _TABLE):
        return
    for name, width in (("lobe", 2.2), ("energy", 3.0), ("solo", 1.0), ("mute", 1.0)):
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_stretch, width)
    imgui.table_setup_scroll_freeze(0, 1)
    imgui.table_headers_row()
    for lobe in energies.argsort(descending=True, stable=True).tolist():
        _row(state, lobe, float(energies[lobe]) / total)
    imgui.end_table()


def _row(state: ViewerState, lobe: int, share: float) -> None:
    selection = state.selection
    imgui.push_id(lobe)
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.color_button(
        "##colour",
        ImVec4(*_hue(state.lobes.amplitude[lobe].numpy()), 1.0),
        int(imgui.ColorEditFlags_.no_tooltip),
        ImVec2(widgets.em(0.8), widgets.em(0.8)),
    )
    imgui.same_line()
    clicked, _ = imgui.selectable(state.lobe_names[lobe], selection.lobe == lobe)
    if clicked:
        state.select(lobe)
    imgui.set_item_tooltip("Click to select. A star marks what was edited")
    if lobe in state.history.edited_lobes:
        imgui.same_line(imgui.get_content_region_avail().x)
        imgui.text_colored(widgets.ACCENT, "*")
    imgui.table_next_column()
    imgui.progress_bar(share, ImVec2(-1, imgui.get_font_size()), f"{100 * share:.1f} %")
    for chosen, label, name in (
        (selection.solo, "S", "Solo the selected lobe"),
        (state.history.muted, "M", "Mute the selected lobe"),
    ):
        imgui.table_next_column()
        if _switch(label, lobe in chosen):
            if label == "M":
                state.toggle_mute(lobe)
            else:
                selection.solo.symmetric_difference_update({lobe})
        entry = command(name)
        widgets.tooltip(entry.name.replace("the selected", "this"), f"{entry.keys}, when selected")
    imgui.pop_id()


def _switch(label: str, is_on: bool) -> bool:
    """Show a small button that stays lit; return whether it was pressed."""
    if is_on:
        imgui.push_style_color(imgui.Col_.button, widgets.ACCENT)
    pressed = imgui.small_button(label)
    if is_on:
        imgui.pop_style_color()
    return pressed


def _hue(amplitude: np.ndarray) -> tuple[float, float, float]:
    """Return the colour of a light without its strength, for sRGB."""
    peak = max(float(amplitude.max()), 1e-30)  # 1e-30: a dark lobe is black
    red, green, blue = (float(value) for value in np.clip(amplitude / peak, 0, 1) ** (1 / 2.2))
    return red, green, blue


def _edits(state: ViewerState) -> None:
    """Draw the sliders of the selected lobe."""
    lobe = state.selection.lobe
    title = "Edit" if lobe is None else f"Edit {state.lobe_names[lobe]}"
    imgui.separator_text(title)
    imgui.push_item_width(-widgets.em(6.5))
    imgui.begin_disabled(lobe is None)
    editing = state.editing
    editing.scope = widgets.choice(
        "frames", editing.scope, "Where an edit holds: in every frame, or in the shown one."
    )
    changed, editing.gain_ev = widgets.slider(
        "amplitude",
        editing.gain_ev,
        (-INTENSITY_EV_MAX, INTENSITY_EV_MAX),
        "EV",
        "Stops added to the lobe's radiance.",
    )
    _live(state, changed, editing.light)
    flags = int(imgui.ColorEditFlags_.float)
    changed, (red, green, blue) = imgui.color_edit3("tint", list(editing.tint), flags)
    editing.tint = red, green, blue
    widgets.tooltip("Linear RGB factors of the lobe's radiance")
    _live(state, changed, editing.light)
    for label, name in (("sharpness x", "sharpness_x"), ("sharpness y", "sharpness_y")):
        changed, value = widgets.slider(
            label,
            getattr(editing, name),
            (-SHARPNESS_STOPS, SHARPNESS_STOPS),
            "stops",
            "A stop doubles the sharpness along this axis; the lobe has 0.7 of its width then.",
        )
        setattr(editing, name, value)
        _live(state, changed, editing.sharpen)
    imgui.end_disabled()
    imgui.pop_item_width()
    widgets.button(state, "Undo", "undo")
    imgui.same_line()
    widgets.button(state, "Redo", "redo")
    imgui.same_line()
    imgui.begin_disabled(not state.history.is_changed)
    explanation = "Write the edits as a layer over the stage, which stays as it is."
    widgets.button(state, "Save the edits as a layer", "save layer...", explanation)
    imgui.end_disabled()


def _live(state: ViewerState, changed: bool, show: Callable[[EditHistory, int, int], None]) -> None:
    """Show an edit while its control moves; when it is let go, make it one step of the history."""
    if changed and state.selection.lobe is not None:
        show(state.history, state.selection.lobe, state.playback.index)
    if imgui.is_item_deactivated_after_edit():
        state.editing.commit(state.history)
