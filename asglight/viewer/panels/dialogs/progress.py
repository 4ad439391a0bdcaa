# SPDX-License-Identifier: Apache-2.0
"""How far something has come that the window waits for."""

from typing import Protocol

from imgui_bundle import ImVec2, imgui

from asglight.viewer.panels import widgets


class Counted(Protocol):
    """Something that is done piece by piece."""

    count: int
    done: int


def progress(title: str, work: Counted) -> bool:
    """Show how much of some work is done; return whether it is to end now, also by Escape."""
    if not imgui.is_popup_open("###progress"):
        imgui.open_popup("###progress")
    centre = imgui.get_main_viewport().get_center()
    imgui.set_next_window_pos(centre, imgui.Cond_.appearing, ImVec2(0.5, 0.5))
    flags = imgui.WindowFlags_.always_auto_resize
    if not imgui.begin_popup_modal(f"{title}###progress", None, flags)[0]:
        return False
    text = f"{work.done} of {work.count}"
    imgui.progress_bar(work.done / max(work.count, 1), ImVec2(widgets.em(20), 0), text)
    is_left = imgui.button("Stop") or imgui.is_key_pressed(imgui.Key.escape, False)
    imgui.end_popup()
    return is_left
