# SPDX-License-Identifier: Apache-2.0
"""The lobes by energy: select, solo, mute; under them the controls of the selected one."""

from functools import lru_cache

from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.lobes import LobeTracks
from asglight.viewer.panels import widgets
from asglight.viewer.panels.lights.controls import edit_controls
from asglight.viewer.panels.lights.keys import ROWS_BESIDE, beside_keys
from asglight.viewer.state import picking
from asglight.viewer.state.commands import command
from asglight.viewer.state.edits import acting
from asglight.viewer.state.edits.editing import rename
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Renaming

_ROW_EM = 1.2
"""Height of a row: that of its letters, for many to be in view."""

_LIST_EM = 6.0
"""Height of the list at least; where list and controls do not fit, the panel scrolls."""

_LIST_SHARE = 0.42
"""Of the panel that a long list has at least, until its lower edge is dragged."""

_TABLE = (
    imgui.TableFlags_.scroll_y | imgui.TableFlags_.row_bg | imgui.TableFlags_.sizing_stretch_prop
)


def lobes(state: ViewerState) -> None:
    """Draw the list, and under it the controls of the selected lobe."""
    if state.tracks.lobes.count == 0 and state.keyed is None:
        imgui.text_wrapped(_no_lobes(state))
        return
    room = imgui.get_window_height()
    top = imgui.get_cursor_screen_pos().y
    imgui.begin_child("list", ImVec2(0, _list_height(state, room)))
    imgui.push_style_var(imgui.StyleVar_.cell_padding, ImVec2(widgets.em(0.25), 0))
    _list(state)
    imgui.pop_style_var()
    imgui.end_child()
    widgets.split(state.list_room, top, room)
    below = imgui.get_cursor_pos_y()
    edit_controls(state)
    state.list_room.controls = imgui.get_cursor_pos_y() - below


def _list_height(state: ViewerState, room: float) -> float:
    """Return the height of the list: what its edge was dragged to, else what it needs and may."""
    least, share = widgets.em(_LIST_EM), state.list_room.share
    if share is not None:
        return max(share * room, least)
    rows = _rows_height(state) + (0 if state.keyed is None else widgets.em(1.7) * ROWS_BESIDE)
    left = room - state.list_room.controls - widgets.em(4.5)  # the panel's tab, the edge between
    return max(min(rows, max(left, _LIST_SHARE * room)), least)


def _rows_height(state: ViewerState) -> float:
    return widgets.em(_ROW_EM) * (len(state.history.present) + 1.5)


def _list(state: ViewerState) -> None:
    energies = picking.energies(state.lobes)
    order = _listed(state)
    light = float(energies[order].sum()) + state.rest_energy
    total = max(light, 1e-30)  # 1e-30: a black frame has shares of 0
    kind = "lobe" if state.keyed is None else "key"
    room = ImVec2(0, 0 if state.keyed is None else _rows_height(state))
    if not imgui.begin_table("lobes", 4, _TABLE, room):
        return
    for name, width in ((kind, 2.6), ("energy", 2.4)):
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_stretch, width)
    for name in ("##solo", "##mute"):
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_fixed, widgets.em(1.5))
    imgui.table_setup_scroll_freeze(0, 1)
    imgui.table_headers_row()
    shares, hues = (energies / total).tolist(), widgets.hues(state.lobes.amplitude.numpy())
    for lobe in order:
        _row(state, lobe, shares[lobe], ImVec4(*hues[lobe], 1.0), order)
    imgui.end_table()
    if state.keyed is not None:
        beside_keys(state, total)


def _listed(state: ViewerState) -> list[int]:
    """Return the lobes that are there: those added first, the newest on top, then those fitted."""
    fitted = state.history.original.lobes.count
    added = range(state.tracks.lobes.count - 1, fitted - 1, -1)
    present = set(state.history.present)
    order = [*added, *_order(Held(state.history.original))]
    return [lobe for lobe in order if lobe in present]


@lru_cache(maxsize=2)
def _order(tracks: Held[LobeTracks]) -> list[int]:
    """Return the lobes by their energy over the whole shot as it was fitted, the most first.

    So a line stays where it is while the shot plays and while its lobe is edited.
    """
    energies = picking.energies(tracks.value.lobes).mean(0)  # [N]
    return energies.argsort(descending=True, stable=True).tolist()


def _row(state: ViewerState, lobe: int, share: float, hue: ImVec4, order: list[int]) -> None:
    selection = state.selection
    imgui.push_id(lobe)
    # All of a row on one line: what has padding would push down what follows.
    imgui.push_style_var(imgui.StyleVar_.frame_padding, ImVec2(widgets.em(0.3), 0))
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.color_button(
        "##colour",
        hue,
        int(imgui.ColorEditFlags_.no_tooltip),
        ImVec2(widgets.em(0.8), widgets.em(0.8)),
    )
    imgui.same_line()
    _name(state, lobe, order)
    if lobe in state.history.edited_lobes:
        imgui.same_line(imgui.get_content_region_avail().x - widgets.em(0.5))
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
                state.toggle_mute(*acting.together_with(state, lobe))
            else:
                acting.toggle_solo(state, acting.together_with(state, lobe))
        entry = command(name)
        widgets.tooltip(entry.name.replace("the selected", "this"), f"{entry.keys}, when selected")
    imgui.pop_style_var()
    imgui.pop_id()


def _name(state: ViewerState, lobe: int, order: list[int]) -> None:
    """Show a lobe's name to be selected, or the field in which it is typed."""
    renaming, selection = state.renaming, state.selection
    if renaming is not None and renaming.lobe == lobe:
        _name_field(state, renaming)
        return
    stage_name, shown = state.tracks.names[lobe], state.lobe_names[lobe]
    is_renamed = stage_name != shown
    # A label ends before `##`, and a name may hold any text.
    label = f"{shown.replace('##', '# #')}###{stage_name}" if is_renamed else stage_name
    clicked, _ = imgui.selectable(label, lobe in state.selected)
    if clicked:
        _select(state, lobe, order)
    if imgui.is_item_hovered() and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
        acting.rename(state, lobe)
    if selection.lobe == lobe and selection.is_new:
        selection.is_new = False
        imgui.set_scroll_here_y(0.5)
    imgui.set_item_tooltip(
        (f"In the stage: {stage_name}\n" if is_renamed else "")
        + "Click to select; with Ctrl more than one, with Shift all between. Double click to "
        "rename.\nA star marks what was edited"
    )


def _select(state: ViewerState, lobe: int, order: list[int]) -> None:
    io = imgui.get_io()
    if io.key_ctrl:
        acting.select_also(state, lobe)
    elif io.key_shift:
        acting.select_to(state, lobe, order)
    else:
        state.select(lobe)


def _name_field(state: ViewerState, renaming: Renaming) -> None:
    """Let a name be typed: Enter takes it, Escape leaves it."""
    imgui.set_next_item_width(-1)
    if not renaming.has_begun:
        imgui.set_keyboard_focus_here()
    flags = int(imgui.InputTextFlags_.enter_returns_true) | int(
        imgui.InputTextFlags_.auto_select_all
    )
    entered, renaming.text = imgui.input_text("##name", renaming.text, flags)
    if entered:
        rename(state.history, renaming.lobe, renaming.text.strip())
    if entered or (renaming.has_begun and imgui.is_item_deactivated()):
        state.renaming = None
    renaming.has_begun = renaming.has_begun or imgui.is_item_active()


def _no_lobes(state: ViewerState) -> str:
    if state.is_fitting:
        return "The first lobes are being fitted ..."
    return (
        "No lobes. --live fits these images now; asglight fit INPUT -o shot.usda keeps the lights."
    )


def _switch(label: str, is_on: bool) -> bool:
    """Show a small button that stays lit; return whether it was pressed."""
    if is_on:
        imgui.push_style_color(imgui.Col_.button, widgets.ACCENT)
    pressed = imgui.button(label, ImVec2(widgets.em(1.4), 0))
    if is_on:
        imgui.pop_style_color()
    return pressed
