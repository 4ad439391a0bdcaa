# SPDX-License-Identifier: Apache-2.0
"""Amplitude, sharpness and direction of the lobes over the frames, with the shared playhead."""

import math
from functools import lru_cache

import numpy as np
import torch
from imgui_bundle import ImVec2, ImVec4, imgui, implot

from asglight.lobes import Lobes, LobeTracks
from asglight.luminance import LUMINANCE
from asglight.viewer.panels import widgets
from asglight.viewer.state.held import Held
from asglight.viewer.state.viewer_state import ViewerState

DECADES = 12
"""Below the brightest lobe at most; what is out runs along the floor."""

BELOW_PEAK = 0.1
"""Of the weakest lobe's own peak: the floor, so that each lobe is in view where it is brightest."""

_MIDDLE_EM = 11.0
"""Width of a plot from which its middle frame is numbered as well."""

NUMBERS = 5
"""On a logarithmic axis about so many, which the lowest plot has room for."""

_NO_GROUND = ImVec4(0, 0, 0, 0)

TITLES = ("amplitude", "sharpness", "direction")


def curves(state: ViewerState) -> None:
    """Draw three plots side by side; dragging in one scrubs."""
    finding = without_curves(state)
    if finding:
        imgui.text_disabled(finding)
        return
    values = track_curves(Held(state.tracks), state.fitted)
    room = imgui.get_content_region_avail()
    frames = np.asarray(state.tracks.frames, dtype=np.float64)
    flags = implot.SubplotFlags_.link_all_x | implot.SubplotFlags_.no_resize
    # Another shot has plots of its own: these would keep the range of the one before.
    name = f"##curves {frames[0]:.0f}-{frames[-1]:.0f}"
    # They stand on the panel's ground: without a GPU an area costs what it is painted again for.
    for colour in (implot.Col_.frame_bg, implot.Col_.plot_bg):
        implot.push_style_color(colour, _NO_GROUND)
    if implot.begin_subplots(name, 1, 3, ImVec2(room.x, room.y), flags):
        for title, tracks in zip(TITLES, values, strict=True):
            _plot(state, title, frames, tracks, is_logarithmic=title != TITLES[2])
        implot.end_subplots()
    implot.pop_style_color(2)


def without_curves(state: ViewerState) -> str:
    """Return why there is nothing to plot; empty where there is something."""
    if len(state.tracks.frames) < 2:
        return "One frame only: nothing changes over time."
    if state.tracks.lobes.count and (state.fitted is None or state.fitted):
        return ""
    return "The first lobes are being fitted ..." if state.is_fitting else "No lobes."


@lru_cache(maxsize=2)
def track_curves(
    tracks: Held[LobeTracks], fitted: frozenset[int] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what the plots show; NaN, which cuts a curve, in frames without lobes yet.

    Args:
        tracks: Lobes of every frame of the timeline.
        fitted: Frames whose lobes are known; None for all.

    Returns:
        Luminance of the amplitude, sharpness (the geometric mean of both axes), and the angle to
        the lobe's direction in the first of those frames in degrees.  [N, F] each
    """
    frames = tracks.value.frames
    known = np.array([fitted is None or frame in fitted for frame in frames])
    found = _of_known(tracks.value.lobes[torch.from_numpy(known)])
    first, second, third = (np.full((len(rows), len(frames)), np.nan) for rows in found)
    for every, rows in zip((first, second, third), found, strict=True):
        every[:, known] = rows
    return first, second, third


def _of_known(lobes: Lobes) -> list[np.ndarray]:
    """Return the curves of frames that have their lobes.  [F, N, .] -> [N, F] each."""
    amplitude = lobes.amplitude.numpy().astype(np.float64) @ LUMINANCE  # [F, N]
    sharpness = lobes.sharpness.numpy().astype(np.float64).prod(-1) ** 0.5
    axis = lobes.axis_z.numpy().astype(np.float64)
    chord = np.linalg.norm(axis - axis[:1], axis=-1)
    turn = np.degrees(2 * np.arcsin(np.minimum(chord / 2, 1)))
    peak = amplitude.max(initial=np.finfo(np.float32).tiny)  # all black: a flat line
    peaks = amplitude.max(0)  # [N]
    weakest = peaks[peaks > 0].min(initial=peak)
    floor = max(BELOW_PEAK * weakest, peak * 10.0**-DECADES)
    return [values.T for values in (np.maximum(amplitude, floor), sharpness, turn)]


def _plot(
    state: ViewerState,
    title: str,
    frames: np.ndarray,
    tracks: np.ndarray,
    *,
    is_logarithmic: bool,
) -> None:
    flags = implot.Flags_.no_legend | implot.Flags_.no_mouse_text | implot.Flags_.no_menus
    if not implot.begin_plot(title, ImVec2(-1, 0), flags):
        return
    axis_flags = implot.AxisFlags_.no_label
    implot.setup_axes("frame", title, axis_flags, axis_flags)
    implot.setup_axis_limits(implot.ImAxis_.x1, frames[0], frames[-1])
    first, last = float(frames[0]), float(frames[-1])
    ends = [first, float(round((first + last) / 2)), last]
    if imgui.get_content_region_avail().x / len(TITLES) < widgets.em(_MIDDLE_EM):
        ends = [first, last]
    implot.setup_axis_ticks(implot.ImAxis_.x1, ends, [f"{end:.0f}" for end in ends])
    limits = _limits(tracks, is_logarithmic)
    implot.setup_axis_limits(implot.ImAxis_.y1, *limits, imgui.Cond_.always)
    if title == TITLES[2]:
        implot.setup_axis_format(implot.ImAxis_.y1, "%g°")
    if is_logarithmic:
        implot.setup_axis_scale(implot.ImAxis_.y1, implot.Scale_.log10)
        numbers = log_ticks(*limits)
        implot.setup_axis_ticks(implot.ImAxis_.y1, numbers, [short(n) for n in numbers])
    lights, selected, names = _that_light(Held(state.tracks)), state.selected, state.lobe_names
    faint, chosen = implot.Spec(), implot.Spec()
    faint.line_color, chosen.line_color = _faint(), widgets.ACCENT
    faint.line_weight, chosen.line_weight = 1.0, 2.0
    for lobe in state.history.present:
        if lights[lobe]:
            spec = chosen if lobe in selected else faint
            implot.plot_line(names[lobe], frames, tracks[lobe], spec)
    moved, frame, *_ = implot.drag_line_x(0, state.playback.time, widgets.ACCENT)
    if moved:
        state.playback.go_to(round(frame))
    implot.end_plot()


@lru_cache(maxsize=2)
def _that_light(tracks: Held[LobeTracks]) -> list[bool]:
    """Tell which lobes give light in any frame.  [N]."""
    return (tracks.value.lobes.amplitude > 0).any(-1).any(0).tolist()


def _limits(tracks: np.ndarray, is_logarithmic: bool) -> tuple[float, float]:
    """Return the ends of the vertical axis: all curves lie between them.

    Args:
        tracks: What is plotted, NaN where it is cut.  [N, F]
        is_logarithmic: Whether the axis is.
    """
    known = tracks[np.isfinite(tracks)]
    low, high = float(known.min(initial=np.inf)), float(known.max(initial=0.0))
    if not is_logarithmic:
        return 0.0, max(1.05 * high, 1.0)  # at least a degree: rounding is no motion
    tiny = float(np.finfo(np.float32).tiny)
    low, high = max(min(low, high), tiny), max(high, tiny)
    return low / 1.5, high * 1.5


def log_ticks(low: float, high: float) -> list[float]:
    """Return numbers for a logarithmic axis, two at least where there is room for them.

    Args:
        low: Its lower end, above 0.
        high: Its upper end, more than 1.7 times that, so that one is between them.
    """
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    decades = range(first, last + 1, max(1, math.ceil((last - first) / NUMBERS)))
    found: list[float] = []
    for within in ((1.0,), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)):
        numbers = (number * 10.0**decade for decade in decades for number in within)
        found = [number for number in numbers if low < number < high]
        if len(found) > 1:
            break
    return found


def short(number: float) -> str:
    """Return a number, thousands and millions by their sign: narrow plots have room for curves."""
    if 1e4 <= number < 1e6:
        return f"{number / 1e3:g}k"
    return f"{number / 1e6:g}M" if 1e6 <= number < 1e9 else f"{number:g}"


def _faint() -> ImVec4:
    text = imgui.get_style_color_vec4(imgui.Col_.text)
    return ImVec4(text.x, text.y, text.z, 0.3)
