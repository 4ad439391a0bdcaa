# SPDX-License-Identifier: Apache-2.0
"""The part of a shot that the timeline shows, and which frames it numbers."""

import math

FRAMES_MIN = 4.0
"""Frames across the timeline at least: there a half frame is easily hit."""

_FACTORS = (1, 2, 5)


class TimeSpan:
    """A part of a shot; frame `f` takes the room from `f` to `f + 1`.

    Attributes:
        begin: Where it begins, in frame numbers.
        end: Where it ends.
    """

    def __init__(self, first: float, last: float) -> None:
        """Show all of a shot.

        Args:
            first: Number of its first frame.
            last: One more than that of its last.
        """
        self._all = float(first), float(last)
        self.begin, self.end = self._all

    @property
    def length(self) -> float:
        """Frames that are shown."""
        return self.end - self.begin

    def show_all(self) -> None:
        """Show all of the shot."""
        self.begin, self.end = self._all

    def zoom(self, factor: float, about: float) -> None:
        """Show `1 / factor` as much; the frame `about` stays where it is."""
        whole = self._all[1] - self._all[0]
        length = min(max(self.length / factor, min(FRAMES_MIN, whole)), whole)
        share = (about - self.begin) / self.length
        self._show(about - share * length, length)

    def pan(self, frames: float) -> None:
        """Show what lies so many frames later."""
        self._show(self.begin + frames, self.length)

    def follow(self, time: float) -> None:
        """Turn the page where the playhead is outside."""
        if not self.begin <= time < self.end:
            self._show(time - 0.05 * self.length, self.length)  # a little of what was before it

    def ticks(self, room: float) -> list[int]:
        """Return the frames that are numbered, round ones.

        Args:
            room: Frames that a number takes at least.
        """
        step = tick_step(room)
        first = math.ceil(self.begin / step) * step
        return list(range(first, math.ceil(self.end), step))

    def _show(self, begin: float, length: float) -> None:
        first, last = self._all
        self.begin = min(max(begin, first), last - length)
        self.end = self.begin + length


def tick_step(room: float) -> int:
    """Return the smallest of 1, 2, 5, 10, 20, 50, ... that is no smaller than the room."""
    power = 1
    while True:
        for factor in _FACTORS:
            if factor * power >= room:
                return factor * power
        power *= 10
