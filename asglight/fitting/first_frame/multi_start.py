# SPDX-License-Identifier: Apache-2.0
"""Several starts of a first frame: which end is taken, and which start goes once more.

An end in which no error lags behind comes before one in which any does, and else the one that is
lit best: starts were asked for the map as well, and some end with more of it at the cost of light.
Where the map's error lags in the one that is lit best, steps mend it at such a cost, so the other
ends come into question as they are.
"""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

from torch import Tensor

from asglight.fitting.first_frame import reweighting
from asglight.fitting.first_frame.reweighting import Measured
from asglight.fitting.loss import objective
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes
from asglight.threads import side_by_side

Finish = Callable[[Lobes, Tensor | None, newton.OnStep | None], newton.Outcome]
"""Follows a start [N, .] to its end; with factors of J's weights [5], if they are given. The end is
on the adaptive cells on which ends are compared."""


@dataclass(frozen=True)
class End:
    """Where a start came to.

    Attributes:
        seed: The start.  [N, .]
        end: The lobes that it came to.
        lit_wrong: J's part of what materials show wrong.
    """

    seed: Lobes
    end: Measured
    lit_wrong: float

    @property
    def lag(self) -> Tensor:
        """Its errors over what they are to come to.  [5]."""
        return self.end.lag

    @property
    def behind(self) -> float:
        """How far what materials show lags behind at most; 1 where nothing of it does."""
        return max(1.0, float(self.lag[1:].max()))

    @property
    def order(self) -> tuple[float, float]:
        """The less the better, for ends of which the map's error can still be mended."""
        return self.behind, self.lit_wrong

    @property
    def settled_order(self) -> tuple[float, float]:
        """The less the better, for ends of which it was."""
        return max(self.behind, float(self.lag[0])), self.lit_wrong


def best_end(
    seeds: Iterable[Callable[[], Lobes]],
    finish: Finish,
    frame: objective.Target,
    aim: Callable[[], Tensor],
    width_min: float,
    on_step: newton.OnStep | None = None,
    again: int = 0,
    threads: int = 1,
    *,
    mends: bool = True,
) -> Measured:
    """Follow each start to its end, and return the end to take.

    Where what materials show lags behind in it, starts that came near may go once more with the
    weight of that raised: which lamps get the lobes is settled on the way. What the map lacks is
    made up for by steps alone.

    Args:
        seeds: Each makes a start, one or more.  [N, .] each
        finish: Follows one.
        frame: The map on the adaptive cells on which ends are compared.
        aim: Says what errors are to come to there; asked when a start has come to its end.
        width_min: Sigma of the narrowest lobe allowed, radians.
        on_step: Called with the lobes of the first start, perhaps on another thread.
        again: Starts that go once more where what materials show lags behind, the nearest first.
        threads: Starts followed at once, each on a thread of its own: the end does not depend on
            it. On a GPU it is one at a time, for steps there are recorded.
        mends: Whether what lags behind is brought forward at all; else the nearest end is taken.
    """
    threads = 1 if frame.radiance.is_cuda else threads

    def reached(made: Callable[[], Lobes], report: newton.OnStep | None) -> End:
        seed = made()
        found = finish(seed, None, report)
        return ended(seed, reweighting.measured(found, frame, aim()), frame)

    def once_more(end: End) -> End:
        """Return where a start comes to with what lags behind in its end raised."""
        weights = reweighting.raised(end.lag)
        found = reweighting.measured(finish(end.seed, weights, None), frame, aim())
        return settled(end.seed, found, frame, aim(), width_min, weights)

    reports = itertools.chain([on_step], itertools.repeat(None))
    calls = (partial(reached, *each) for each in zip(seeds, reports, strict=False))
    nearest = sorted(side_by_side(calls, threads), key=lambda each: each.order)
    if not mends:
        return nearest[0].end
    mended = settled(nearest[0].seed, nearest[0].end, frame, aim(), width_min)
    best = min([mended, *nearest[1:]], key=lambda each: each.settled_order)
    if best.behind > 1:
        going = (partial(once_more, end) for end in nearest[:again])
        for other in side_by_side(going, threads):
            best = min(best, other, key=lambda each: each.settled_order)
            if best.settled_order[0] <= 1:
                break
    return best.end


def settled(
    seed: Lobes,
    end: Measured,
    frame: objective.Target,
    aim: Tensor,
    width_min: float,
    weights: Tensor | None = None,
) -> End:
    """Return an end after the steps of `reweighting.reweighted`."""
    found = reweighting.reweighted(end, frame, aim, width_min, weights)
    return ended(seed, found, frame)


def ended(seed: Lobes, end: Measured, frame: objective.Target) -> End:
    """Judge an end.

    Args:
        seed: The start.  [N, .]
        end: The lobes that it came to.
        frame: The map, with J's own weights.
    """
    return End(seed, end, float(lit_wrong(end.lit, frame)))


def lit_wrong(lit: Images, frame: objective.Target) -> Tensor:
    """Return J's part of what materials show wrong in the end.  [F].

    Args:
        lit: Lobes with the last solution for their light.
        frame: The maps, with J's own weights.
    """
    sharp = replace(frame, corners=light.CORNERS)
    return objective.of_materials(objective.loss_terms(lit.radiance, sharp).seen, sharp)
