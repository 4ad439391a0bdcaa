# SPDX-License-Identifier: Apache-2.0
"""The edits one after the other: click one to go back to it, or forward."""

from imgui_bundle import imgui

from asglight.viewer.panels import widgets
from asglight.viewer.state.edits.edit import Edit
from asglight.viewer.state.edits.history import Step
from asglight.viewer.state.viewer_state import ViewerState


def history(state: ViewerState) -> None:
    """Draw the list of edits; those that are undone are faint."""
    edits = state.history
    position = edits.position
    if widgets.line("##step0", "As it was opened", position == 0):
        edits.go_to(0)
    for place, step in enumerate(edits.steps, start=1):
        text = _words(state, step)
        is_undone = place > position
        if is_undone:
            faint = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
            imgui.push_style_color(imgui.Col_.text, faint)
        if widgets.line(f"##step{place}", text, place == position):
            edits.go_to(place)
        if is_undone:
            imgui.pop_style_color()


def _words(state: ViewerState, step: Step) -> str:
    """Say what a step does to which lobes, and where."""
    edit = step[0]
    count = len(step)
    names = state.lobe_names
    # a lobe whose adding is undone has no name at the moment
    name = names[edit.lobe] if edit.lobe < len(names) else "lobe"
    who = name if count == 1 else f"{count} lobes"
    span = edit.span if isinstance(edit, Edit) else None
    where = "" if span is None else f", {span.words(state.playback.frames)}"
    return f"{who}: {edit.what}{where}"
