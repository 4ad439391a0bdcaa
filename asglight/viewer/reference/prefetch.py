# SPDX-License-Identifier: Apache-2.0
"""The images around the playhead, decoded by threads before they are shown.

Nothing is queued: whenever a thread is free it takes the frame that is wanted most at that moment,
so a jump of the playhead leaves nothing behind but the images that are being decoded.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Self

import numpy as np

from asglight.errors import InputError

THREADS = 2
"""Decoders: one alone leaves the disk idle while it decompresses, and more take the processor from
a fit that is running."""

AHEAD_RUN = 4
"""Frames fetched ahead of a moving playhead for each one behind it: playing asks for what is ahead,
and a stop is often followed by a step or two back."""


class FrameCache:
    """Keeps the images nearest to the playhead within a budget of bytes.

    No method waits for an image but `wait`. The images that are being decoded, one a thread, come
    on top of the budget. The one at the playhead is kept even where it alone is over the budget.
    """

    def __init__(
        self,
        read: Callable[[int], np.ndarray],
        frames: Sequence[int],
        *,
        byte_budget: int,
        threads: int = THREADS,
    ) -> None:
        """Start to decode, from the first frame on.

        Args:
            read: Returns the radiance of a frame, float32 [H, W, 3]; called in several threads.
            frames: The frame numbers, ascending, at least one.
            byte_budget: Bytes to fill with images.
            threads: How many frames are decoded at a time.
        """
        self._read = read
        self._frames = tuple(frames)
        self._places = {frame: place for place, frame in enumerate(self._frames)}
        self._byte_budget = byte_budget
        self._playhead, self._direction = 0, 0
        self._order = self._order_anew()  # gone through once until the playhead moves
        self._images: dict[int, np.ndarray] = {}  # these three by place in the frames
        self._messages: dict[int, str] = {}
        self._decoding: set[int] = set()
        self._largest = 1
        self._is_closed = False
        self._changed = threading.Condition()
        self._threads = [
            threading.Thread(target=self._work, name=f"asglight-decode-{k}", daemon=True)
            for k in range(threads)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        """Return the cache."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the cache."""
        self.close()

    def look_at(self, frame: int, direction: int = 0) -> None:
        """Move the playhead.

        Args:
            frame: The shown frame; one that is not there leaves the playhead where it is.
            direction: 1 while playing forward, -1 while playing backward, 0 at rest.
        """
        with self._changed:
            place = self._places.get(frame, self._playhead)
            if (place, direction) != (self._playhead, self._direction):
                self._playhead, self._direction = place, direction
                self._order = self._order_anew()
                self._changed.notify_all()

    def get(self, frame: int) -> np.ndarray | None:
        """Return the image of a frame if it is there, [H, W, 3], without waiting."""
        with self._changed:
            return self._images.get(self._places.get(frame, -1))

    def message(self, frame: int) -> str | None:
        """Return why the image of a frame cannot be had; None while that is not known."""
        with self._changed:
            return self._messages.get(self._places.get(frame, -1))

    def wait(self, frame: int, timeout: float) -> np.ndarray | None:
        """Wait until a frame has an image or a message.

        Args:
            frame: The frame, near the playhead: one that the budget has no room for takes all the
                time. One that is not there returns at once.
            timeout: Seconds to wait at most.

        Returns:
            Its image, [H, W, 3]; None where there is none.
        """
        with self._changed:
            place = self._places.get(frame)
            if place is None:
                return None
            self._changed.wait_for(
                lambda: place in self._images or place in self._messages or self._is_closed,
                timeout,
            )
            return self._images.get(place)

    def cached_ranges(self) -> list[tuple[int, int]]:
        """Return the runs of frames whose images are there, as first and last frame numbers."""
        with self._changed:
            places = sorted(self._images)
        ranges: list[tuple[int, int]] = []
        for before, place in zip([None, *places], places, strict=False):
            frame = self._frames[place]
            first = ranges.pop()[0] if before is not None and place == before + 1 else frame
            ranges.append((first, frame))
        return ranges

    def close(self) -> None:
        """End the threads, each after the image that it is decoding, and forget every image."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join()
        self._images.clear()

    def _work(self) -> None:
        """Decode what is wanted most, again and again."""
        while True:
            with self._changed:
                place = self._next()
                while place is None and not self._is_closed:
                    self._changed.wait()
                    place = self._next()
                if place is None or self._is_closed:
                    return
                self._decoding.add(place)
            image, message = self._decoded(self._frames[place])
            with self._changed:
                self._decoding.remove(place)
                if image is None:
                    self._messages[place] = message
                else:
                    self._keep(place, image)
                self._changed.notify_all()

    def _decoded(self, frame: int) -> tuple[np.ndarray | None, str]:
        """Return the image of a frame, or why there is none."""
        try:
            return self._read(frame), ""
        except InputError as error:
            return None, str(error)
        except Exception as error:  # one bad frame must not end the others
            kind = type(error).__name__
            return None, f"frame {frame}: cannot be decoded ({kind}: {error})."

    def _next(self) -> int | None:
        """Return the place that is wanted most and not there yet, if the budget has room for it."""
        room = max(1, self._byte_budget // self._largest)
        for wanted, place in self._order:
            if wanted >= room:
                break  # what follows is wanted less, and the room never grows
            if not (place in self._images or place in self._messages or place in self._decoding):
                return place
        return None

    def _order_anew(self) -> Iterator[tuple[int, int]]:
        """Return how much each place is wanted, 0 most, and the place."""
        return enumerate(reading_order(len(self._frames), self._playhead, self._direction))

    def _keep(self, place: int, image: np.ndarray) -> None:
        """Take an image in and drop the least wanted ones that the budget has no room for."""
        self._images[place] = image
        self._largest = max(self._largest, image.nbytes)
        held = sum(image.nbytes for image in self._images.values())
        if held <= self._byte_budget:
            return
        count = len(self._frames)
        for farthest in sorted(
            self._images,
            key=lambda place: turn(count, self._playhead, self._direction, place),
            reverse=True,
        )[:-1]:
            held -= self._images.pop(farthest).nbytes
            if held <= self._byte_budget:
                return


def reading_order(count: int, playhead: int, direction: int) -> Iterator[int]:
    """Yield every place in the order in which images are wanted.

    At rest the nearest come first, of two equally near ones the later. While playing, four ahead
    are followed by one behind. What follows the last place is the first one, as playback loops.

    Args:
        count: Number of places.
        playhead: Where playback is, from 0.
        direction: 1 forward, -1 backward, 0 at rest.
    """
    step, run = direction or 1, AHEAD_RUN if direction else 1
    ahead = ((playhead + step * k) % count for k in range(1, count))
    behind = ((playhead - step * k) % count for k in range(1, count))
    yield playhead
    for k in range(count - 1):
        yield next(behind if k % (run + 1) == run else ahead)


def turn(count: int, playhead: int, direction: int, place: int) -> int:
    """Return when `reading_order` comes to a place, from 0."""
    if place == playhead:
        return 0
    step, run = direction or 1, AHEAD_RUN if direction else 1
    ahead = step * (place - playhead) % count
    return min(ahead + (ahead - 1) // run, (count - ahead) * (run + 1))
