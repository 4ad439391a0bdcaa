# SPDX-License-Identifier: Apache-2.0
"""The playhead: which time is shown, and how it moves. Clocks are arguments, never asked for."""

import math
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from enum import StrEnum

ROUNDING = 1e-6
"""Frame times by which a timer may miss a frame's beginning."""

MEASURED = 25
"""Pictures over which the rate is measured: a second, at the usual rate."""


class Pace(StrEnum):
    """What gives way when pictures take longer than a frame lasts."""

    REAL_TIME = "real time"
    """Frames are dropped, so that the shot keeps its length."""
    EVERY_FRAME = "every frame"
    """The time stretches, so that no frame is missed."""


class Playback:
    """The playhead over the frames of a shot.

    Attributes:
        frames: Frame numbers, ascending, at least one; gaps are held on the frame before them.
        fps: Frames per second.
        index: Place in `frames` of the frame at the playhead, or of the last one before it.
        part: How far the playhead is from that frame to the next one, from 0 to below 1.
        dropped: Frames that were left out since playing began.
        pace: What gives way when pictures are slow.
        loops: Whether the last frame is followed by the first.
        first: In point, a place in `frames`.
        last: Out point, a place in `frames`.
    """

    def __init__(self, frames: Sequence[int], fps: float) -> None:
        """Start at the first frame, paused."""
        self.frames = tuple(frames)
        self.fps = fps
        self.index = 0
        self.part = 0.0
        self.dropped = 0
        self.pace = Pace.REAL_TIME
        self.loops = True
        self.first, self.last = 0, len(self.frames) - 1
        self._now = 0.0
        self._clock: tuple[float, int] | None = None
        """When the playhead left which frame number; None while paused."""
        self._arrivals: deque[float] = deque(maxlen=MEASURED)

    @property
    def frame(self) -> int:
        """The number of the frame at the playhead, or of the last one before it."""
        return self.frames[self.index]

    @property
    def next_frame(self) -> int:
        """The number of the frame after it; at the last frame its own."""
        return self.frames[min(self.index + 1, len(self.frames) - 1)]

    @property
    def time(self) -> float:
        """The playhead in frame numbers; fractions lie between frames."""
        return self.frame + self.part * (self.next_frame - self.frame)

    @property
    def is_between(self) -> bool:
        """Whether the playhead stands between two frames."""
        return self.part > 0

    @property
    def achieved_fps(self) -> float | None:
        """Frames a second that were shown of late while playing; None until that is known."""
        if self._clock is None or len(self._arrivals) < 2:
            return None
        return (len(self._arrivals) - 1) / max(self._arrivals[-1] - self._arrivals[0], 1e-9)

    @property
    def is_playing(self) -> bool:
        """Whether the playhead moves by itself."""
        return self._clock is not None

    def go_to(self, frame: int) -> None:
        """Move to the frame nearest to a number, of two equally near ones the earlier; play on."""
        self.index, self.part = self._nearest(frame), 0.0
        self._go_on_from_here()

    def go_to_time(self, time: float) -> None:
        """Move to a time between frames, and pause.

        Args:
            time: In frame numbers, held within the shot.
        """
        self.pause()
        time = min(max(time, self.frames[0]), self.frames[-1])
        self.index = min(bisect_right(self.frames, time), len(self.frames)) - 1
        self.part = (time - self.frame) / max(self.next_frame - self.frame, 1)

    def step_half(self, sign: int) -> None:
        """Pause, and go half a frame forward or back: to the next half or whole frame."""
        halves = self.time * 2
        self.go_to_time((math.floor(halves) + 1 if sign > 0 else math.ceil(halves) - 1) / 2)

    def step(self, count: int) -> None:
        """Pause, and go forward or back by so many frames that exist, stopping at the ends."""
        self.pause()
        if self.is_between and count < 0:  # back to the frame before it
            count += 1
        self.part = 0.0
        self.index = max(0, min(len(self.frames) - 1, self.index + count))

    def play(self, now: float) -> None:
        """Start at the playhead, or at the in point when it stands outside or at the end.

        Args:
            now: Seconds on any steady clock.
        """
        if not self.first <= self.index < self.last:
            self.index = self.first
        self.part = 0.0
        self.dropped = 0
        self._arrivals.clear()
        self._arrivals.append(now)
        self._now = now
        self._clock = now, self.frame

    def pause(self) -> None:
        """Hold the frame that is shown."""
        self._clock = None

    def tick(self, now: float) -> None:
        """Move the playhead to where it belongs at a time; call it once for every picture.

        Args:
            now: Seconds on the clock of `play`.
        """
        self._now = now
        before = self.index
        self._advance(now)
        if self._clock is not None and self.index != before:
            self._arrivals.append(now)
            if not self.first <= before <= self.last:
                return
            if self.index > before:
                self.dropped += self.index - before - 1
            else:  # around the end
                self.dropped += self.last - before + self.index - self.first

    def seconds_to_next(self, now: float) -> float | None:
        """Return how long the shown frame stays, at most; None where nothing plays.

        Args:
            now: Seconds on the clock of `play`.
        """
        if self._clock is None:
            return None
        start, _ = self._clock
        shown = (max(self._now, start) - start) * self.fps + ROUNDING
        following = int(shown) + 1  # a picture that took longer than a frame is followed at once
        if self.pace is Pace.EVERY_FRAME:
            following = self._distance(self._after(self.index))
        return max(start + following / self.fps - now, 0.0)

    def _advance(self, now: float) -> None:
        if self._clock is None:
            return
        start, origin = self._clock
        passed = (now - start) * self.fps
        if self.pace is Pace.EVERY_FRAME:
            following = self._after(self.index)
            wait = self._distance(following)
            if passed + ROUNDING >= wait:
                # A picture that is only a little late does not put off all that follow.
                self._arrive(following, start + wait / self.fps if passed < wait + 1 else now)
            return
        begin, length = self.frames[self.first], self._length()
        position = origin - begin
        if position < 0 or (position >= length and self.loops):
            position = -1  # a frame outside is looked at for its time; the in point follows
        position += int(passed + ROUNDING)
        if position < 0:
            return
        if position >= length and not self.loops:
            self.index = self.last
            self.pause()
            return
        self.index = bisect_right(self.frames, begin + position % length) - 1

    def mark_in(self) -> None:
        """Put the in point at the playhead, and the out point behind it."""
        self.first = self.index
        self.last = max(self.first, self.last)
        self._go_on_from_here()

    def mark_out(self) -> None:
        """Put the out point at the playhead, and the in point before it."""
        self.last = self.index
        self.first = min(self.first, self.last)
        self._go_on_from_here()

    def clear_marks(self) -> None:
        """Play all frames."""
        self.first, self.last = 0, len(self.frames) - 1
        self._go_on_from_here()

    def _go_on_from_here(self) -> None:
        """Count from the shown frame on, not from where playing began some loops ago."""
        if self._clock is not None:
            self._clock = self._now, self.frame

    def _nearest(self, frame: int) -> int:
        after = bisect_left(self.frames, frame)
        candidates = range(max(after - 1, 0), min(after + 1, len(self.frames)))
        return min(candidates, key=lambda place: abs(self.frames[place] - frame))

    def _after(self, place: int) -> int:
        if self.first <= place < self.last:
            return place + 1
        return self.first if self.loops else place

    def _distance(self, following: int) -> int:
        """Return how many frame times the playhead stays before the next place."""
        is_within = self.first <= self.index < following
        return self.frames[following] - self.frame if is_within else 1

    def _length(self) -> int:
        """Return the frame times from the in point to the end of the out point's frame."""
        return self.frames[self.last] - self.frames[self.first] + 1

    def _arrive(self, place: int, when: float) -> None:
        if place == self.index and not self.loops:
            self.pause()
            return
        self.index = place
        self._clock = when, self.frame
