# SPDX-License-Identifier: Apache-2.0
"""Tracks at another rate: the same light, at the times of other frames.

New frame F + k is the light of the old tracks at the time

    t(k) = F + k speed fps / fps'

in old frame numbers, by the rule of motion.py. F is the first old frame that is taken, and keeps
its number. A frame lasts until the next one, so the shot keeps its length in seconds: 48 frames at
24 a second become 120 at 60. After the last old frame of a shot its light holds.
"""

import math
from dataclasses import replace

import torch

from asglight.errors import InputError, check_number
from asglight.lobes import motion
from asglight.lobes.data import FRAMES_MAX, LobeTracks

WHOLE = 1e-6
"""In frames: times that near to an old frame are its own. Rates are float64, whose rounding over
`FRAMES_MAX` frames stays a thousand times below."""


def resampled(
    tracks: LobeTracks,
    fps: float | None = None,
    speed: float = 1.0,
    frames: tuple[int, int] | None = None,
) -> LobeTracks:
    """Return tracks at another rate, or faster or slower, or some of their frames.

    Examples:
        >>> asglight.resampled(tracks, fps=48).frames
        (1001, 1002, 1003, 1004)

    Args:
        tracks: Lobes of F frames.
        fps: New frames per second; None for those of the tracks.
        speed: How fast the light moves: 0.5 takes twice the time and as many more frames.
        frames: First and last old frame to take; None for all.

    Returns:
        Tracks of the new frames, with lobes in float64 on the CPU; names and metadata are the old.

    Raises:
        InputError: A rate is none, the range is not one of the tracks, or one frame or too many
            would come of it.
    """
    times = resampled_times(tracks, fps, speed, frames)
    first = int(times[0])
    return replace(
        tracks,
        frames=tuple(range(first, first + len(times))),
        fps=tracks.fps if fps is None else fps,
        lobes=motion.at(tracks, times),
    )


def resampled_times(
    tracks: LobeTracks,
    fps: float | None = None,
    speed: float = 1.0,
    frames: tuple[int, int] | None = None,
) -> list[float]:
    """Return the time of each new frame in old frame numbers; arguments as `resampled`.

    Raises:
        InputError: As `resampled`.
    """
    fps = tracks.fps if fps is None else fps
    for name, value in (("fps", fps), ("speed", speed)):
        check_number(name, value)
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: {value:g}; expected a finite number above 0.")
    first, last = _range(tracks, frames)
    step = tracks.fps / fps * speed
    times = first + step * torch.arange(_count(first, last, step), dtype=torch.float64)
    near = times.round()
    return torch.where((times - near).abs() < WHOLE, near, times).tolist()


def _range(tracks: LobeTracks, frames: tuple[int, int] | None) -> tuple[int, int]:
    """Return the first and the last old frame to take."""
    whole = tracks.frames[0], tracks.frames[-1]
    first, last = frames or whole
    if not whole[0] <= first <= last <= whole[1]:
        raise InputError(
            f"frames: {first} to {last}; expected a first and a last frame within {whole[0]} to "
            f"{whole[1]}."
        )
    return first, last


def _count(first: int, last: int, step: float) -> int:
    """Return how many new frames there are.

    Args:
        first: First old frame.
        last: Last old frame.
        step: From one new frame to the next, in old ones.
    """
    steps = (last + 1 - first) / step - WHOLE
    if steps <= 1:
        raise InputError(
            f"frames: {first} to {last} become one at {step:g} a new frame; expected two or more. "
            "Take a lower speed, more frames per second or a longer range."
        )
    if steps > FRAMES_MAX:
        raise InputError(
            f"frames: {first} to {last} become {steps:.3g} at {step:g} a new frame; expected at "
            f"most {FRAMES_MAX:,}. Take a higher speed or fewer frames per second."
        )
    return math.ceil(steps)
