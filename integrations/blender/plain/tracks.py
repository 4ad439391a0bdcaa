# SPDX-License-Identifier: GPL-3.0-or-later
"""Values over time, as plain arrays: T times, K components."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAME = 1e-7
"""Relative: values nearer than float32 can tell are one constant."""

TURN_MAX = np.radians(2.0)
"""Between two keys of a rotation. Blender interpolates each component of a quaternion by itself;
over 2 degrees that is off the even turn by 1e-5 degrees at the most, and a place that is
interpolated lies 1.5e-4 of its distance within its circle."""


@dataclass(frozen=True)
class Track:
    """A value at its times, linear between them and constant outside.

    Attributes:
        times: Ascending; a constant has one.  [T]
        values: [T, K]
    """

    times: Array
    values: Array

    @property
    def is_constant(self) -> bool:
        """Whether there is one value for all times."""
        return len(self.times) == 1

    def at(self, times: Array) -> Array:
        """Return the values at other times.  [S] to [S, K]."""
        columns = [np.interp(times, self.times, column) for column in self.values.T]
        return np.stack(columns, axis=-1)

    def held_at(self, times: Array) -> Array:
        """Return the values at other times where each holds until the next.  [S] to [S, K]."""
        places = np.searchsorted(self.times, times, side="right") - 1
        return self.values[places.clip(0)]


def constant(*values: float) -> Track:
    """Return a track of one value.  K numbers."""
    return Track(np.zeros(1), np.array([values], dtype=np.float64))


def track(times: Iterable[float], value_at: Callable[[float], Iterable[float]]) -> Track:
    """Sample a function, and keep one sample where all are the same.

    Args:
        times: Any order, some twice; with none of them the value at 0 counts.
        value_at: From a time to K numbers.
    """
    ordered = np.array(sorted(set(times)) or [0.0])
    return reduced(Track(ordered, np.array([list(value_at(time)) for time in ordered.tolist()])))


def reduced(given: Track) -> Track:
    """Return a track with one sample where all are the same, or the track itself."""
    spread = np.ptp(given.values, axis=0)
    if (spread <= SAME * np.abs(given.values).max(axis=0)).all():
        return Track(given.times[:1], given.values[:1])
    return given


def in_one_hemisphere(quaternions: Array) -> Array:
    """Return the same rotations, each with the sign nearer to the one before.  [T, 4]."""
    dots = (quaternions[1:] * quaternions[:-1]).sum(-1)
    signs = np.cumprod(np.where(dots < 0, -1.0, 1.0))
    return quaternions * np.concatenate([[1.0], signs])[:, None]


def times_between(times: Array, quaternions: Array) -> list[float]:
    """Return the times at which a rotation needs more keys, so that none are far apart.

    Args:
        times: [T]
        quaternions: Rotations at them.  [T, 4]
    """
    dots = np.abs((quaternions[1:] * quaternions[:-1]).sum(-1)).clip(max=1)
    parts = np.ceil(2 * np.arccos(dots) / TURN_MAX).astype(int)
    found: list[float] = []
    for start, end, count in zip(times[:-1], times[1:], parts, strict=True):
        found += np.linspace(start, end, max(count, 1) + 1)[1:-1].tolist()
    return found
