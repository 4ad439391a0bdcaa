# SPDX-License-Identifier: Apache-2.0
"""How many threads of the processor a part of the work computes on."""

import contextlib
import time
from collections.abc import Callable, Iterator

import torch

Threads = Callable[[], contextlib.AbstractContextManager[None]]
"""Opens what is computed on so many threads."""

TEAM = 2
"""Threads of a team: the tensors of a frame are too small to share among more."""

FREE = 1.75
"""CPU seconds in a second of two threads below which one of them had to wait for another program:
1.9 to 2.1 were seen on idle cores, 1.5 where one of two was busy."""

REST_MIN, REST_MAX = 4, 256
"""Turns of one thread after one such turn, and after many in a row."""


def _seconds() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread, which leaves the others to reading, and to other fits."""
    with _threads(1):
        yield


class Team:
    """Two threads while no other program wants their cores.

    On idle cores the second one takes an eighth to a fifth off a following frame. Beside another
    program the two wait for each other in every operation, and a frame takes four times as long as
    on one. So after a turn in which they had to wait one thread works alone, for twice as many
    turns each time.
    """

    def __init__(self, seconds: Callable[[], tuple[float, float]] = _seconds) -> None:
        """Start as a team.

        Args:
            seconds: Returns wall and CPU seconds.
        """
        self._seconds = seconds
        self._rest = REST_MIN
        self._alone = 0

    @contextlib.contextmanager
    def turn(self) -> Iterator[None]:
        """Compute on two threads if that was of use, and never on more than were allowed before."""
        count = 1 if self._alone else min(TEAM, torch.get_num_threads())
        self._alone = max(self._alone - 1, 0)
        begin = self._seconds()
        with _threads(count):
            yield
        wall, cpu = (end - start for end, start in zip(self._seconds(), begin, strict=True))
        if count > 1 and cpu < FREE * wall:
            self._alone = self._rest
            self._rest = min(2 * self._rest, REST_MAX)
        elif count > 1:
            self._rest = REST_MIN


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
