# SPDX-License-Identifier: Apache-2.0
"""The menus: File, Edit, View, Help."""

import re
from pathlib import Path

from imgui_bundle import hello_imgui, imgui

from asglight.viewer.io.documents import Documents
from asglight.viewer.state.commands import command
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Theme

_OF_SELECTED = (
    "Solo the selected lobe",
    "Mute the selected lobe",
    "Rename the selected lobe",
    "The selected lobe as it was fitted",
    "Delete the selected lobe",
)


def menus(documents: Documents) -> None:
    """Draw the menus."""
    _file(documents)
    state = documents.state
    if imgui.begin_menu("Edit"):
        history = state.history
        _item(state, "Undo", is_enabled=history.can_undo)
        _item(state, "Redo", is_enabled=history.can_redo)
        imgui.separator()
        for name in _OF_SELECTED:
            _item(state, name, is_enabled=bool(state.selected))
        imgui.separator()
        _item(state, "Add a lobe at the pointer", "Add a lobe")
        _item(state, "Select every lobe")
        imgui.end_menu()
    if imgui.begin_menu("View"):
        for name in ("Next view transform", "Next channel", "Next comparison"):
            _item(state, name)
        _item(state, "Camera and environment at rest", "Reset camera and environment")
        imgui.separator()
        _item(state, "Panels", "Show or hide the panels")
        _panels()
        imgui.separator()
        for theme in Theme:
            if imgui.menu_item_simple(f"{theme.capitalize()} theme", "", state.theme is theme):
                state.theme = theme
        imgui.end_menu()
    if imgui.begin_menu("Help"):
        _, state.has_help = imgui.menu_item("Keys", "F1", state.has_help)
        imgui.end_menu()


def _file(documents: Documents) -> None:
    state = documents.state
    if not imgui.begin_menu("File"):
        return
    _item(state, "Open", "Open...")
    _item(state, "Open another stage as B", "Open another stage as B...")
    _item(state, "End A and B", is_enabled=state.against is not None)
    if imgui.begin_menu("Recent", bool(documents.recent)):
        for path in list(documents.recent):
            # A label ends before `##`; `%04d` says the same.
            name = re.sub("#+", lambda pad: f"%0{len(pad[0])}d", Path(path).name)
            if imgui.menu_item_simple(f"{name}##{path}"):
                documents.open(path)
            imgui.set_item_tooltip(path)
        imgui.end_menu()
    imgui.separator()
    is_edited = state.history.is_changed
    _item(state, "Save the edits as a layer", "Save the edits as a layer...", is_enabled=is_edited)
    _item(state, "Save the picture", "Save the picture...")
    for name in ("Render the frames", "Render the frames with labels", "Render a turntable"):
        _item(state, name, f"{name}...")
    imgui.separator()
    _item(state, "Quit")
    imgui.end_menu()


def _panels() -> None:
    """Show which panels there are, and bring back where they were at first."""
    docking = hello_imgui.get_runner_params().docking_params
    for panel in docking.dockable_windows:
        _, panel.is_visible = imgui.menu_item(panel.label, "", panel.is_visible)
    imgui.separator()
    if imgui.menu_item_simple("Panels where they were at first"):
        docking.layout_reset = True
        for panel in docking.dockable_windows:
            panel.is_visible = True


def _item(state: ViewerState, name: str, label: str = "", *, is_enabled: bool = True) -> None:
    """Show a menu item that runs a command."""
    entry = command(name)
    if imgui.menu_item_simple(label or name, entry.keys, False, is_enabled):
        entry.run(state)
