# SPDX-License-Identifier: Apache-2.0
"""Wall and CPU seconds of a part of a run: recording what it does does not count."""

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

import numpy as np

_P = ParamSpec("_P")
_T = TypeVar("_T")
Point = dict[str, float]
"""Numbers by name, such as `wall_seconds` and `cpu_seconds`."""


class Clock:
    """Wall and CPU seconds since it was made, less the pauses."""

    def __init__(self) -> None:
        """Start."""
        self._start = self._now()

    def seconds(self, at: np.ndarray | None = None) -> Point:
        """Return the seconds by name, now or at a time that was taken."""
        wall, cpu = ((self._now() if at is None else at) - self._start).tolist()
        return {"wall_seconds": wall, "cpu_seconds": cpu}

    @contextlib.contextmanager
    def paused(self) -> Iterator[Point]:
        """Stand still at the seconds that are handed out."""
        stopped = self._now()
        yield self.seconds(stopped)
        self._start += self._now() - stopped

    @staticmethod
    def _now() -> np.ndarray:
        return np.array([time.perf_counter(), time.process_time()])


def timed(call: Callable[_P, _T], *args: _P.args, **kwargs: _P.kwargs) -> tuple[_T, Point]:
    """Return what a call returns, and its seconds."""
    clock = Clock()
    result = call(*args, **kwargs)
    return result, clock.seconds()
