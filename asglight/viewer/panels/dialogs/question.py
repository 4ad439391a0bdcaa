# SPDX-License-Identifier: Apache-2.0
"""A question that has to be answered before anything else."""

from imgui_bundle import ImVec2, imgui

from asglight.viewer.io.documents import Documents
from asglight.viewer.panels import widgets


def question(documents: Documents) -> None:
    """Show the question that waits; Escape gives its last answer."""
    asked = documents.question
    if asked is None:
        return
    title = f"{asked.title}###question"
    if not imgui.is_popup_open("###question"):
        imgui.open_popup("###question")
    centre = imgui.get_main_viewport().get_center()
    imgui.set_next_window_pos(centre, imgui.Cond_.appearing, ImVec2(0.5, 0.5))
    if not imgui.begin_popup_modal(title, None, imgui.WindowFlags_.always_auto_resize)[0]:
        return
    imgui.push_text_wrap_pos(widgets.em(28))
    imgui.text(asked.text)
    imgui.pop_text_wrap_pos()
    imgui.separator()
    answer = None
    for place, (label, action) in enumerate(asked.answers):
        if place:
            imgui.same_line()
        if imgui.button(label):
            answer = action
    if imgui.is_key_pressed(imgui.Key.escape, False):
        answer = asked.answers[-1][1]
    if answer is not None:
        documents.question = None
        imgui.close_current_popup()
        answer()
    imgui.end_popup()
