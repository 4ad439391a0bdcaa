# SPDX-License-Identifier: Apache-2.0
"""The timeline: scrub, play, marks, and which reference frames are in memory."""

import math

from imgui_bundle import ImVec2, ImVec4, imgui

from asglight.viewer.panels import widgets
from asglight.viewer.state.commands import command
from asglight.viewer.state.viewer_state import ViewerState

FPS_LIMITS = (1.0, 240.0)

_BUTTONS = int(imgui.ButtonFlags_.mouse_button_left) | int(imgui.ButtonFlags_.mouse_button_middle)

_IN_MEMORY = ImVec4(0.35, 0.7, 0.95, 0.9)

_WIDE_EM = 54.0
"""Width from which the buttons stand apart and the frames of the shot are named beside them."""

_ZOOM = 1.25
"""For one notch of the wheel."""


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
    widgets.button(state, "Play or pause", playing, width=4)
    imgui.same_line()
    widgets.button(state, "Next frame", ">")
    imgui.same_line()
    widgets.button(state, "Last frame", ">|")
    imgui.same_line()
    room = imgui.get_window_width()
    is_narrow = room < widgets.em(_WIDE_EM)
    imgui.set_next_item_width(widgets.em(4.5 if is_narrow else 6))
    entered, time = imgui.input_double(
        "##frame", playback.time, 0, 0, "%.7g", imgui.InputTextFlags_.enter_returns_true
    )
    widgets.tooltip("Frame. Type a number, also one between two as 1012.5, and press Enter")
    if entered and time == int(time):
        playback.go_to(int(time))
    elif entered:
        playback.go_to_time(time)
    gap = widgets.em(0.4 if is_narrow else 1.5)
    if not is_narrow:
        imgui.same_line()
        imgui.text_disabled(f"of {playback.frames[0]}-{playback.frames[-1]}")
    imgui.same_line(spacing=gap)
    loop = command("Loop")
    playback.loops = widgets.checkbox("loop", playback.loops, loop, "Play the range again.")
    imgui.same_line()
    imgui.set_next_item_width(widgets.em(6.5 if is_narrow else 8))
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
    imgui.same_line(spacing=gap)
    widgets.button(state, "In point here", "in")
    imgui.same_line()
    widgets.button(state, "Out point here", "out")
    imgui.same_line()
    widgets.button(state, "All frames between in and out", "all")


def _bar(state: ViewerState) -> None:
    playback, span = state.playback, state.span
    origin = imgui.get_cursor_screen_pos()
    width = max(imgui.get_content_region_avail().x, widgets.em(4))
    height = widgets.em(2.2)
    imgui.invisible_button("##bar", ImVec2(width, height), _BUTTONS)
    widgets.tooltip(
        "Drag to scrub; with Shift between frames. Wheel: zoom. Middle drag: move.\n"
        "The bright line below marks reference frames in memory"
    )
    if playback.is_playing:
        span.follow(playback.time)
    _mouse(state, origin.x, width)
    slot = width / span.length
    draw = imgui.get_window_draw_list()
    draw.push_clip_rect(origin, ImVec2(origin.x + width, origin.y + height), True)

    def place(time: float) -> float:
        return origin.x + (time - span.begin) * slot

    def box(begin: float, end: float, rows: tuple[float, float], colour: int) -> None:
        draw.add_rect_filled(
            ImVec2(place(begin), origin.y + rows[0] * height),
            ImVec2(place(end), origin.y + rows[1] * height),
            colour,
        )

    first, last = playback.frames[0], playback.frames[-1]
    box(first, last + 1, (0.0, 1.0), widgets.ink(0.06))
    marks = playback.frames[playback.first], playback.frames[playback.last]
    box(marks[0], marks[1] + 1, (0.0, 1.0), widgets.ink(0.08))
    if state.references is not None:
        for begin, end in state.references.cached_ranges():
            box(max(begin, first), min(end, last) + 1, (0.92, 1.0), widgets.colour(_IN_MEMORY))
    for frame in span.ticks(widgets.em(3.2) / slot):
        x = place(frame)
        draw.add_line_v(x, origin.y, origin.y + 0.3 * height, widgets.ink(0.45))
        draw.add_text(ImVec2(x + 3, origin.y + 0.12 * height), widgets.ink(0.65), str(frame))
    middle = playback.time + 0.5
    half = max(0.5, 1.0 / slot)  # two points at least
    box(middle - half, middle + half, (0.0, 1.0), widgets.colour(widgets.ACCENT, 0.35))
    x = place(middle)
    draw.add_line_v(x, origin.y, origin.y + height, widgets.colour(widgets.ACCENT), 2.0)
    draw.pop_clip_rect()


def _mouse(state: ViewerState, left: float, width: float) -> None:
    """Scrub, zoom, move."""
    span, io = state.span, imgui.get_io()
    time = span.begin + (io.mouse_pos.x - left) / width * span.length
    if imgui.is_item_hovered() and io.mouse_wheel:
        span.zoom(_ZOOM**io.mouse_wheel, time)
    if not imgui.is_item_active():
        return
    if imgui.is_mouse_down(imgui.MouseButton_.middle):
        span.pan(-io.mouse_delta.x / width * span.length)
    elif io.key_shift:
        state.playback.go_to_time(time - 0.5)  # a frame's time is the middle of its room
    else:
        # As soon as the mouse moves, whatever has been drawn by then.
        state.playback.go_to(math.floor(time))
