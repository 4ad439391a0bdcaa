# SPDX-License-Identifier: Apache-2.0
"""The edits one after the other: click one to go back to it, or forward."""

from imgui_bundle import imgui

from asglight.viewer.panels import widgets
from asglight.viewer.state.viewer_state import ViewerState


def history(state: ViewerState) -> None:
    """Draw the list of edits; those that are undone are faint."""
    edits = state.history
    position = edits.position
    if widgets.line("##step0", "As it was opened", position == 0):
        edits.go_to(0)
    for place, edit in enumerate(edits.steps, start=1):
        frame = edit.frame_index
        where = "" if frame is None else f", frame {state.playback.frames[frame]}"
        text = f"{state.lobe_names[edit.lobe]}: {edit.what}{where}"
        is_undone = place > position
        if is_undone:
            faint = imgui.get_style_color_vec4(imgui.Col_.text_disabled)
            imgui.push_style_color(imgui.Col_.text, faint)
        if widgets.line(f"##step{place}", text, place == position):
            edits.go_to(place)
        if is_undone:
            imgui.pop_style_color()
