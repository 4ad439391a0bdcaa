# SPDX-License-Identifier: Apache-2.0
"""A shot with a preset: its first frame, following it, and the pass over the whole of it."""

from collections.abc import Iterator

from torch import Tensor

from asglight.fitting.first_frame.fit import Exposed, exposed
from asglight.fitting.following.whole_shot import CHUNK, refine_shot
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import REFINEMENT, fit_frame
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.threads import one_thread
from benchmarks.gpu.data import shot
from benchmarks.gpu.rows import Given, Row
from benchmarks.gpu.timing import seconds_of

FRAMES, SHORT_FRAMES = 240, 3
LOBES, SHORT_LOBES = 15, 2

GOAL = 10.0
"""Seconds of the whole, refined."""


def measure(given: Given) -> Iterator[Row]:
    """Fit frames that are in memory, as `asglight fit` does with those it reads."""
    frames = shot(given, SHORT_FRAMES if given.short else FRAMES)
    options = FitOptions(
        SHORT_LOBES if given.short else LOBES,
        Preset(given.choice),
        device=given.device,
        moving=True,
    )
    (lobes, _), first = seconds_of(lambda: _fit(frames[0], options, []), given.device)
    yield Row("first frame", {"s": first})

    def follow() -> tuple[list[Lobes], list[float]]:
        fits, losses = [lobes], []
        for frame in frames[1:]:
            found, loss = _fit(frame, options, fits[-2:])
            fits.append(found)
            losses.append(loss)
        return fits, losses

    (fits, losses), following = seconds_of(follow, given.device)
    each = following / len(losses)
    yield Row(f"{len(losses)} next frames", {"s": following, "s each": each, "J": _mean(losses)})
    refining = 0.0
    if options.preset in REFINEMENT:
        (_, losses), refining = seconds_of(lambda: _refined(fits, frames, options), given.device)
        yield Row("pass over the shot", {"s": refining, "J": _mean(losses)})
    goal = {"s": GOAL} if given.is_gpu and not given.short else {}
    yield Row(f"{len(frames)} frames in all", {"s": first + following + refining}, goal)


def _fit(frame: Tensor, options: FitOptions, before: list[Lobes]) -> tuple[Lobes, float]:
    """Fit a frame; lobes are kept on the host, where a checkpoint keeps them."""
    there = [lobes.to(options.device) for lobes in before]
    previous, earlier = ([None, None, *there][-1], [None, None, *there][-2])
    fit = fit_frame(frame.to(options.device), options, previous, earlier)
    return fit.lobes.to("cpu"), fit.loss


def _refined(
    fits: list[Lobes], frames: list[Tensor], options: FitOptions
) -> tuple[Lobes, list[float]]:
    def read() -> Iterator[list[Exposed]]:
        for first in range(0, len(frames), CHUNK):
            yield [exposed(each.to(options.device)) for each in frames[first : first + CHUNK]]

    with one_thread():
        return refine_shot(stack(fits), read, REFINEMENT[options.preset])


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
