# SPDX-License-Identifier: Apache-2.0
"""The timeline: scrub, play, marks, and which reference frames are in memory."""

from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.viewer.commands import command
from asglight.viewer.panels import widgets
from asglight.viewer.state import ViewerState

FPS_LIMITS = (1.0, 240.0)

_TICK_STEPS = (1, 2, 5, 10, 20, 24, 48, 50, 100, 200, 500, 1000, 2000, 5000, 10000)


def timeline(state: ViewerState) -> None:
    """Draw the buttons and the bar."""
    _buttons(state)
    _bar(state)


def _buttons(state: ViewerState) -> None:
    playback = state.playback
    widgets.button(state, "First frame", "|<")
    imgui.same_line()
    widgets.button(state, "Previous frame", "<")
    imgui.same_line()
    playing = "Pause###play" if playback.is_playing else "Play###play"
    widgets.button(state, "Play or pause", playing)
    imgui.same_line()
    widgets.button(state, "Next frame", ">")
    imgui.same_line()
    widgets.button(state, "Last frame", ">|")
    imgui.same_line()
    imgui.set_next_item_width(widgets.em(6))
    entered, frame = imgui.input_int(
        "##frame", playback.frame, 0, 0, imgui.InputTextFlags_.enter_returns_true
    )
    widgets.tooltip("Frame. Type a number and press Enter")
    if entered:
        playback.go_to(frame)
    imgui.same_line()
    first, last = playback.frames[0], playback.frames[-1]
    imgui.text_disabled(f"of {first}-{last}")
    imgui.same_line(spacing=widgets.em(1.5))
    loop = command("Loop")
    playback.loops = widgets.checkbox("loop", playback.loops, loop, "Play the range again.")
    imgui.same_line()
    imgui.set_next_item_width(widgets.em(8))
    pace = command("Real time (drops frames) or every frame")
    chosen = widgets.choice("##pace", playback.pace, f"{pace.name}.", pace.keys)
    if chosen is not playback.pace:
        pace.run(state)
    imgui.same_line()
    imgui.set_next_item_width(widgets.em(5))
    changed, fps = imgui.drag_float("##fps", playback.fps, 0.1, *FPS_LIMITS, "%.5g fps")
    widgets.tooltip("Frames a second while playing. Drag, or Ctrl+click and type")
    if changed:
        playback.fps = max(FPS_LIMITS[0], min(FPS_LIMITS[1], fps))
    imgui.same_line(spacing=widgets.em(1.5))
    widgets.button(state, "In point here", "in")
    imgui.same_line()
    widgets.button(state, "Out point here", "out")
    imgui.same_line()
    widgets.button(state, "All frames between in and out", "all")


def _bar(state: ViewerState) -> None:
    playback = state.playback
    origin = imgui.get_cursor_screen_pos()
    width = max(imgui.get_content_region_avail().x, widgets.em(4))
    height = widgets.em(2.2)
    imgui.invisible_button("##bar", ImVec2(width, height))
    widgets.tooltip("Drag to scrub. The bright line below marks reference frames in memory")
    first, last = playback.frames[0], playback.frames[-1]
    slot = width / (last - first + 1)
    if imgui.is_item_active():
        # As soon as the mouse moves, whatever has been drawn by then.
        playback.go_to(first + int((imgui.get_mouse_pos().x - origin.x) / slot))
    draw = imgui.get_window_draw_list()

    def box(begin: float, end: float, rows: tuple[float, float], colour: ImVec4) -> None:
        draw.add_rect_filled(
            ImVec2(origin.x + (begin - first) * slot, origin.y + rows[0] * height),
            ImVec2(origin.x + (end - first) * slot, origin.y + rows[1] * height),
            imgui.get_color_u32(colour),
        )

    box(first, last + 1, (0.0, 1.0), ImVec4(1, 1, 1, 0.06))
    marks = playback.frames[playback.first], playback.frames[playback.last]
    box(marks[0], marks[1] + 1, (0.0, 1.0), ImVec4(1, 1, 1, 0.08))
    if state.references is not None:
        for begin, end in state.references.cached_ranges():
            box(max(begin, first), min(end, last) + 1, (0.92, 1.0), ImVec4(0.35, 0.7, 0.95, 0.9))
    step = _tick_step(slot)
    for frame in range(-(-first // step) * step, last + 1, step):
        x = origin.x + (frame - first) * slot
        draw.add_line_v(x, origin.y, origin.y + 0.3 * height, widgets.colour(widgets.FAINT))
        draw.add_text(
            ImVec2(x + 3, origin.y + 0.12 * height), widgets.colour(widgets.FAINT, 1.4), str(frame)
        )
    middle = playback.frame + 0.5
    half = max(0.5, 1.0 / slot)  # two points at least
    box(middle - half, middle + half, (0.0, 1.0), ImVec4(1, 0.62, 0.18, 0.35))
    x = origin.x + (middle - first) * slot
    draw.add_line_v(x, origin.y, origin.y + height, widgets.colour(widgets.ACCENT), 2.0)


def _tick_step(slot: float) -> int:
    """Return the frames between two numbers that do not touch."""
    room = widgets.em(3.2)
    return next((step for step in _TICK_STEPS if step * slot >= room), _TICK_STEPS[-1])
