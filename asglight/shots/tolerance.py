# SPDX-License-Identifier: Apache-2.0
"""A shot with a tolerance: the fewest lobes with which every frame stays within it.

The number is searched on a few frames, each fitted by itself, and what the hardest needs is given
to the shot. When the shot is fitted every frame is measured; where one misses the tolerance, since
lobes that follow a map are not free to start anew, the shot is fitted again with more.

Doubling, then halving the interval, over fits from nothing found fewer lobes or as few as taking
them away one by one from a fit with 30, in the same time: 8, 15, 10, 3 lobes beside 8, 17, 10, 3 on
venice, workshop, night and studio at 2 %.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from torch import Tensor

from asglight.fitting.loss.measures import ALLOWANCE, MEASURED, Shown, errors, shown
from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.images import Sequence
from asglight.lobes import Lobes
from asglight.shots.events import OnProgress, Searched
from asglight.shots.kept.kept_frames import KeptFrames
from asglight.threads import one_thread

SEARCHED_FRAMES = 5
"""Frames on which the number is searched: the ends, the middle, and the middles between."""

FIRST_TRY = 4
"""Lobes tried first: few, for such a fit takes a second, and one with 30 takes four."""

GROWTH_MAX = 1.1
"""Factor on the number from one fit of the shot to the next, at most. The error falls at least as
the number grows where it is near; far off it is that of one frame in which a lamp was lost, and
whether one is lost does not depend on the number alone. At 2 % 48 frames of `tunnel` and `day` come
to 15 and 11 lobes with 1.25, to 10 and 10 with 1.1 (`asglight fit DIR --tolerance 0.02`), in about
the same time."""


@dataclass(frozen=True)
class Worst:
    """The largest value of one error.

    Attributes:
        name: `irr` or `r0.5`.
        value: The error.
        frame: Its frame.
    """

    name: str
    value: float
    frame: int


class Accuracy:
    """Measures the frames of a shot against its tolerance.

    Attributes:
        tolerance: Largest error.
        limit: Largest error as it is measured here: `ALLOWANCE` below the tolerance.
    """

    def __init__(self, tolerance: float) -> None:
        """Know no frame yet."""
        self.tolerance = tolerance
        self.limit = (1 - ALLOWANCE) * tolerance
        self._shown: dict[int, Shown] = {}

    def see(self, frame: int, radiance: Tensor) -> None:
        """Keep what the probes show of a frame.  [H, 2 H, 3]."""
        if frame not in self._shown:
            with one_thread():
                self._shown[frame] = shown(radiance)

    def see_all(self, kept: KeptFrames, frames: list[int]) -> None:
        """Read those of some frames that are not known yet.

        Raises:
            InputError: One cannot be read.
        """
        unknown = [frame for frame in frames if frame not in self._shown]
        with contextlib.closing(kept.again(unknown)) as images:
            for frame, read in zip(unknown, images, strict=True):
                self.see(frame, read.radiance)

    def errors(self, frames: list[int], lobes: Lobes) -> list[dict[str, float]]:
        """Return the errors of frames that are known.  [F, N, .] -> F."""
        with one_thread():
            return [errors(lobes[k], self._shown[frame]) for k, frame in enumerate(frames)]


def worst(frames: list[int], found: list[dict[str, float]]) -> list[Worst]:
    """Return the largest value of each error and its frame."""
    places = {name: max(range(len(found)), key=lambda k: found[k][name]) for name in MEASURED}
    return [Worst(name, found[place][name], frames[place]) for name, place in places.items()]


def fewest_lobes(
    sequence: Sequence,
    images: KeptFrames,
    options: FitOptions,
    accuracy: Accuracy,
    on_progress: OnProgress,
) -> int:
    """Search the number of lobes that the hardest of some frames needs.

    Args:
        sequence: The shot.
        images: What it shows.
        options: Its settings, with `max_lobes`.
        accuracy: Knows the tolerance.
        on_progress: Called with each number that is tried.

    Raises:
        InputError: A frame cannot be read.
    """
    assert options.max_lobes is not None
    count = 0
    for frame in spread_frames(sequence.frames):
        (read,) = images.first([frame])
        radiance = read.image.radiance
        accuracy.see(frame, radiance)

        def error(lobes: int, frame: int = frame, radiance: Tensor = radiance) -> float:
            there = radiance.to(options.device)
            fit = fit_frame(there, replace(options, lobes=lobes), None)
            (found,) = accuracy.errors([frame], fit.lobes.to("cpu")[None])
            on_progress(Searched(frame, lobes, max(found.values())))
            return max(found.values())

        start = min(count or FIRST_TRY, options.max_lobes)
        count = fewest(error, start, max(count, 1), options.max_lobes, accuracy.limit)
    return count


def spread_frames(frames: tuple[int, ...]) -> list[int]:
    """Return at most `SEARCHED_FRAMES` frames, evenly from the first to the last."""
    count = min(SEARCHED_FRAMES, len(frames))
    last = len(frames) - 1
    return [frames[round(k * last / max(count - 1, 1))] for k in range(count)]


def fewest(error: Callable[[int], float], start: int, low: int, high: int, limit: float) -> int:
    """Search the least number from `low` to `high` whose error is within a limit.

    The error is taken to fall with the number.

    Args:
        error: Of a number.
        start: Tried first.
        low: Least number.
        high: Largest number, which is returned where none is within the limit.
        limit: Largest error.
    """
    failed, passed = low - 1, start
    while error(passed) > limit:
        if passed == high:
            return high
        failed, passed = passed, min(2 * passed, high)
    while passed - failed > 1:
        middle = (failed + passed) // 2
        if error(middle) <= limit:
            passed = middle
        else:
            failed = middle
    return passed


def more_lobes(count: int, excess: float, most: int) -> int:
    """Return a larger number of lobes for a shot whose error is `excess` times the limit."""
    growth = min(excess, GROWTH_MAX)
    return min(max(count + 1, math.ceil(count * growth)), most)
