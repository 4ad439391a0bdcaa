# SPDX-License-Identifier: Apache-2.0
"""A live fit without a fitter: for tests of the process that it runs in.

The process need not load torch, which takes most of the time of a short fit.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from asglight.cli.sources.live_source import LiveJob

FRAMES = tuple(range(1001, 3001))
"""So many that the fit is in the middle, whatever a test does."""


class StandInJob(LiveJob):
    """A job whose lobes are made up; without lobes it is a bug."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Let the process that takes it do without the fitter."""
        return _taken, (self.frames, self.lobes)


def _taken(frames: tuple[int, ...], lobes: int | None) -> LiveJob:
    module: Any = ModuleType("asglight.shots.live")
    module.live_fits = _live_fits
    sys.modules[module.__name__] = module
    return LiveJob(frames, lobes=lobes)


class _Values(np.ndarray):
    def numpy(self) -> np.ndarray:
        return np.asarray(self)


@dataclass(frozen=True)
class _Lobes:
    axes: np.ndarray
    sharpness: np.ndarray
    amplitude: np.ndarray


def _live_fits(_: object, frames: tuple[int, ...], lobes: int | None) -> Iterator[tuple[int, Any]]:
    if not lobes:
        raise ValueError("no lobes")
    for frame in frames:
        shapes = ((lobes, 3, 3), (lobes, 2), (lobes, 3))
        yield frame, _Lobes(*(np.ones(shape, np.float32).view(_Values) for shape in shapes))
        time.sleep(0.05)  # as long as a frame takes
