# SPDX-License-Identifier: Apache-2.0
"""Light between frames: lobes at a time that was left out of the fit, against the map of that time.

Four ways to know the light of such a time from its two neighbours are judged side by side:

    stage   the stage as a program reads it: each attribute interpolated by itself
    rule    the tracks in continuous time (lobes/motion.py)
    fits    the maps of the two fits, dissolved: lamps fade out here and in there
    maps    the two true maps, dissolved: what a dome texture gives at best

What each is worth shows in its ratio to `fits`, which no program needs lobes for.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.judging.metrics import maps_errors
from asglight.lobes import Lobes, LobeTracks, motion, texels

STAGE, RULE, FITS, MAPS = "stage", "rule", "fits", "maps"
WAYS = (STAGE, RULE, FITS, MAPS)
METRICS = ("flux", "irr", "r0.5", "r0.25")

Errors = dict[str, dict[str, float]]
"""By way, then by metric."""


@dataclass(frozen=True)
class BetweenErrors:
    """The errors of times between the frames of a fit.

    Attributes:
        times: Those of each time, by way and metric.
    """

    times: Mapping[int, Errors]

    @property
    def ways(self) -> tuple[str, ...]:
        """The ways that were judged."""
        return tuple(next(iter(self.times.values())))

    @property
    def mean(self) -> Errors:
        """Mean over the times, by way and metric."""
        rows = list(self.times.values())
        return {
            way: {name: sum(row[way][name] for row in rows) / len(rows) for name in METRICS}
            for way in self.ways
        }

    @property
    def ratios(self) -> Errors:
        """The mean of each way over that of the dissolved fits; infinite where those are exact."""
        mean = self.mean
        return {
            way: {name: _ratio(mean[way][name], mean[FITS][name]) for name in METRICS}
            for way in self.ways
            if way != FITS
        }


def left_out(fitted: Sequence[int], frames: Iterable[int]) -> tuple[int, ...]:
    """Return the frames that lie between fitted ones without being fitted."""
    own = set(fitted)
    return tuple(
        frame for frame in sorted(frames) if fitted[0] < frame < fitted[-1] and frame not in own
    )


def between_errors(
    tracks: LobeTracks,
    times: Iterable[int],
    read: Callable[[int], Tensor],
    stage: Lobes | None = None,
) -> BetweenErrors:
    """Judge tracks at frames that were left out of them.

    Args:
        tracks: A fit of the other frames.
        times: Frames between those of the tracks, ascending.
        read: Returns the repaired radiance of any frame.  [H, W, 3]
        stage: What a program reads of the tracks' stage at the times; None leaves that way out.
            [T, N, .]
    """
    return BetweenErrors(dict(judged(tracks, times, read, stage)))


def judged(
    tracks: LobeTracks,
    times: Iterable[int],
    read: Callable[[int], Tensor],
    stage: Lobes | None = None,
) -> Iterator[tuple[int, Errors]]:
    """Judge one time after the other, as `between_errors`; two maps are kept at a time."""
    held = lru_cache(maxsize=2)(read)  # a neighbour serves the time before it and the one after

    @lru_cache(maxsize=2)
    def fit(frame: int) -> Tensor:
        return _map(tracks.at(frame), held(frame))

    for place, time in enumerate(times):
        before, after = neighbours(tracks.frames, time)
        part = (time - before) / (after - before)
        truth = read(time)
        shown = {RULE: _map(motion.at(tracks, [time])[0], truth)}
        if stage is not None:
            shown = {STAGE: _map(stage[place], truth)} | shown
        shown[FITS] = torch.lerp(fit(before), fit(after), part)
        shown[MAPS] = torch.lerp(held(before).float(), held(after).float(), part)
        found = maps_errors(torch.stack(list(shown.values())), truth)
        yield (
            time,
            {
                way: {name: one.values[name] for name in METRICS}
                for way, one in zip(shown, found, strict=True)
            },
        )


def neighbours(frames: Sequence[int], time: float) -> tuple[int, int]:
    """Return the frames before and after a time between them.

    Raises:
        ValueError: There are none.
    """
    if not frames[0] < time < frames[-1]:
        raise ValueError(f"time {time:g}: not between {frames[0]} and {frames[-1]}")
    return max(f for f in frames if f < time), min(f for f in frames if f > time)


def _map(lobes: Lobes, like: Tensor) -> Tensor:
    """Return the texel means of lobes on the grid of a map.  [H, W, 3]."""
    return texels.texel_means(lobes.to(torch.float32), *like.shape[:2])


def _ratio(part: float, whole: float) -> float:
    if whole > 0:
        return part / whole
    return 1.0 if part == 0 else float("inf")
