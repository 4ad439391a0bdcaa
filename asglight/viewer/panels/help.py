# SPDX-License-Identifier: Apache-2.0
"""The list of keys, and the line at the bottom of the window."""

import itertools

from imgui_bundle import imgui

from asglight.viewer.panels import widgets
from asglight.viewer.state.commands import COMMANDS, FLIP_KEY
from asglight.viewer.state.session import Session
from asglight.viewer.state.viewer_state import ViewerState

_MOUSE = (
    ("drag on the balls", "orbit; on the wipe line: move it"),
    ("right drag on the balls", "turn the environment"),
    ("wheel on the balls", "exposure"),
    ("click in the map or list", "select a lobe; with Ctrl more than one"),
    ("Shift+click in the list", "select all between"),
    ("double click in the list", "rename"),
    ("drag the edge below the list", "height of the list; double click: as high as fits"),
    ("drag a lobe in the map", "turn it, and all that are selected"),
    ("Ctrl+click or drag on a ball", "put the highlight of the selected lobe there"),
    ("drop a file or folder", "open a stage, or compare with an image or sequence"),
)


def keys_window(state: ViewerState) -> None:
    """Show all keys while asked for."""
    if not state.has_help:
        return
    imgui.set_next_window_pos(
        imgui.get_main_viewport().get_center(), imgui.Cond_.appearing, imgui.ImVec2(0.5, 0.5)
    )
    flags = imgui.WindowFlags_.always_auto_resize | imgui.WindowFlags_.no_docking
    _, is_open = imgui.begin("Keys", True, flags)
    state.has_help = bool(is_open)
    if imgui.begin_table("keys", 2, imgui.TableFlags_.row_bg | imgui.TableFlags_.sizing_fixed_fit):
        for group, commands in itertools.groupby(COMMANDS, key=lambda entry: entry.group):
            _heading(group)
            for entry in commands:
                _line(entry.keys, entry.name)
            if group == "Compare":
                _line(f"hold {FLIP_KEY}", "Flip to the other picture")
        _heading("Mouse")
        for gesture, effect in _MOUSE:
            _line(gesture, effect)
        imgui.end_table()
    imgui.end()


def status_line(state: ViewerState, session: Session) -> None:
    """Show the last message, or how far a running fit has come."""
    imgui.text(said(state, session))
    tail = f"{_rate(state)}F1: keys"
    imgui.same_line(imgui.get_window_width() - imgui.calc_text_size(tail).x - widgets.em(1))
    imgui.text_disabled(tail)


def said(state: ViewerState, session: Session) -> str:
    """Return the line: what was done last, as long as that is new, then what is amiss."""
    status = session.source.status()
    missing = None
    if state.references is not None:
        missing = state.references.message(state.playback.frame)
    done = f"lobes of {status.frames_done} of {status.frames_total} frames"
    if not state.tracks.lobes.count and not state.is_fitting:
        done = "no lobes"
    return state.message or status.failure or missing or status.message or done


def _rate(state: ViewerState) -> str:
    """Return the frames a second that are reached, and how many were dropped since it plays."""
    fps = state.playback.achieved_fps
    if fps is None:
        return ""
    dropped = state.playback.dropped
    return f"{fps:.1f} fps{f', {dropped} dropped' if dropped else ''}   "


def _heading(text: str) -> None:
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.text_colored(widgets.ACCENT, text)
    imgui.table_next_column()


def _line(keys: str, effect: str) -> None:
    imgui.table_next_row()
    imgui.table_next_column()
    imgui.text(keys)
    imgui.table_next_column()
    imgui.text(effect)
