# SPDX-License-Identifier: Apache-2.0
"""What it costs two tracks of a lamp to exchange their later frames (main_tracks.py).

A shot is looked at lobe by lobe, a few at a time: plain numbers take a fifth of the time of arrays.

Symbols: F frames, N tracks.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from asglight.sphere.turns import OPPOSITE

Vector = Sequence[float]


@dataclass(frozen=True, eq=False)
class Shot:
    """What is asked of lobes, and which lobe each track has.

    Attributes:
        lit: Which send light.  F of N
        axis_z: Their directions.  F of N of 3
        width: Sigma along the longer axis and along the shorter, a texel at least.  F of N of 2
        lamp: Number of the lobe's lamp in its frame; -1 for a dark one.  F of N
        centre: Where that is.  F of N of 3
        within: Whether the lobe is within the lamp's width.  F of N
        order: The lobe that a track has in a frame; changed in place.  F of N
        led: The lamps of each frame that have a main track.  F
    """

    lit: list[list[bool]]
    axis_z: list[list[list[float]]]
    width: list[list[list[float]]]
    lamp: list[list[int]]
    centre: list[list[list[float]]]
    within: list[list[bool]]
    order: list[list[int]]
    led: list[set[int]]

    def lobe(self, frame: int, track: int) -> int | None:
        """Return the lobe of a track; None where it is dark, or there is no such frame."""
        if not 0 <= frame < len(self.lit):
            return None
        lobe = self.order[frame][track]
        return lobe if self.lit[frame][lobe] else None

    def is_led(self, frame: int, lobe: int) -> bool:
        """Tell whether a lobe's lamp has a main track."""
        return self.lamp[frame][lobe] in self.led[frame]


class _End(NamedTuple):
    """Where a track comes from or goes to.

    Attributes:
        known: Whether it is lit there, or waits there for a frame.
        lit: Whether it is lit there.
        axis_z: Its direction.  3
        width: Sigma along both axes.  2
    """

    known: bool
    lit: bool
    axis_z: Vector
    width: Vector


class Exchanges:
    """What it costs two tracks to exchange their frames after one frame, in which a lamp moves on.

    A track that is dark in one frame alone waits where it was, and its way from there counts by
    half, as its light does; one that is dark for longer begins its path where it is needed.
    """

    def __init__(self, shot: Shot, frame: int, kept: Sequence[int]) -> None:
        """Look at how the lamp moves.

        Args:
            shot: The shot.
            frame: The frame.
            kept: Tracks of the lamp that are lit in both frames.
        """
        self._shot, self._frame = shot, frame
        self._motion = [_middle(shot, at, kept) for at in (frame, frame + 1)]
        self._ends: dict[int, tuple[_End, _End]] = {}
        self._ways: dict[tuple[int, int], float] = {}

    def price(self, one: int, other: int) -> float:
        """Return how much farther both have to go than without an exchange."""
        exchanged = self._from_to(one, other) + self._from_to(other, one)
        return exchanged - self._from_to(one, one) - self._from_to(other, other)

    def _from_to(self, before: int, after: int) -> float:
        """Return the way from where one track is to where another is in the next frame."""
        pair = before, after
        if pair not in self._ways:
            self._ways[pair] = _way(self._both(before)[0], self._both(after)[1])
        return self._ways[pair]

    def _both(self, track: int) -> tuple[_End, _End]:
        """Return where a track would be if it moved on with the lamp, and where it is then."""
        if track not in self._ends:
            before = _moved_on(_end(self._shot, self._frame, -1, track), *self._motion)
            self._ends[track] = before, _end(self._shot, self._frame + 1, 1, track)
        return self._ends[track]


def _end(shot: Shot, frame: int, step: int, track: int) -> _End:
    """Return a track in a frame; one that is dark there is where it is a step beyond."""
    lobe = shot.order[frame][track]
    if shot.lit[frame][lobe]:
        return _End(True, True, shot.axis_z[frame][lobe], shot.width[frame][lobe])
    beyond = min(max(frame + step, 0), len(shot.lit) - 1)
    waits = shot.order[beyond][track]
    is_known = shot.lit[beyond][waits]
    return _End(is_known, False, shot.axis_z[beyond][waits], shot.width[beyond][waits])


def _way(before: _End, after: _End) -> float:
    """Return how far it is from one end to another, by what counts of the light (main_tracks.py).

    0 where one of them is not known.
    """
    if not (before.known and after.known):
        return 0.0
    (long, short), (long_then, short_then) = before.width, after.width
    angle = math.acos(min(max(dot(before.axis_z, after.axis_z), -1.0), 1.0))
    wider = (long - long_then) ** 2 + (short - short_then) ** 2
    square = (angle**2 + wider) / (long**2 + long_then**2)
    return square * (before.lit + after.lit) / 2


def _middle(shot: Shot, frame: int, tracks: Sequence[int]) -> Vector:
    """Return the mean direction of tracks in a frame; all zeros for none.  3."""
    order, axis_z = shot.order[frame], shot.axis_z[frame]
    x, y, z = (sum(axis_z[order[track]][axis] for track in tracks) for axis in range(3))
    length = math.hypot(x, y, z) or 1.0
    return x / length, y / length, z / length


def _moved_on(end: _End, before: Vector, now: Vector) -> _End:
    """Turn an end as little as turns one direction to another [Rodrigues 1840].

    As `turn_between`, of one direction; without directions it stays.
    """
    part = 1 / max(1 + dot(before, now), OPPOSITE)
    x, y, z = end.axis_z
    across_x, across_y, across_z = across = _across(end.axis_z, before, now)
    again_x, again_y, again_z = _across(across, before, now)
    moved = (
        x + across_x + part * again_x,
        y + across_y + part * again_y,
        z + across_z + part * again_z,
    )
    return _End(end.known, end.lit, moved, end.width)


def _across(direction: Vector, before: Vector, now: Vector) -> Vector:
    """Return the cross product of (before x now) with a direction.  3."""
    onto_before, onto_now = dot(before, direction), dot(now, direction)
    (bx, by, bz), (nx, ny, nz) = before, now
    return (
        nx * onto_before - bx * onto_now,
        ny * onto_before - by * onto_now,
        nz * onto_before - bz * onto_now,
    )


def dot(one: Vector, other: Vector) -> float:
    """Return the scalar product of two vectors of three numbers."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
