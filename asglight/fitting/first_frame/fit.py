# SPDX-License-Identifier: Apache-2.0
"""A first frame: an EM start, steps under narrowing corners, the flux made exact."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from asglight.fitting.first_frame import multi_start, other_forms, reweighting, seeding
from asglight.fitting.first_frame.split_merge import split_and_merge
from asglight.fitting.loss import adaptive_cells, objective
from asglight.fitting.loss.grid import grid
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import light, newton
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions
from asglight.threads import once, one_thread

Splitting = Callable[
    [newton.Outcome, objective.Target, objective.Target, int, float, newton.OnStep | None],
    newton.Outcome,
]
"""Tries splits and merges: the arguments of `split_and_merge` in their order."""


@dataclass(frozen=True)
class Level:
    """Some steps under one pair of corners.

    Attributes:
        steps: Steps, at most.
        corners: phi's corners: from wide ones, with few minima, to those that the metrics ask for.
        rounds: Rounds of splits and merges after that.
    """

    steps: int
    corners: Corners
    rounds: int = 0


@dataclass(frozen=True)
class FirstFrameSettings:
    """How much is spent on a first frame.

    Attributes:
        spreads_deg: `seeding.seed_lobes`' spread of each initial guess; the best end is taken
            (multi_start.py).
        levels: What is done with each, one level after the other.
        left: Shares of the errors of an even mixture that a fit is to leave; errors that lag
            behind are brought forward (reweighting.py).
        finishing: Steps after the levels, on more adaptive cells.
        again: Starts that go once more where what materials show lags behind (multi_start.py).
        several_max: Lobes up to which all starts are followed; of more, only the first is: with 120
            on two maps the end of `FAST`'s second has a J larger by a sixth.
    """

    spreads_deg: tuple[float | None, ...]
    levels: tuple[Level, ...]
    left: tuple[float, ...]
    finishing: int
    again: int = 0
    several_max: float = math.inf

    def spreads_of(self, count: int) -> tuple[float | None, ...]:
        """Return the spread of each start that is followed with so many lobes."""
        return self.spreads_deg if count <= self.several_max else self.spreads_deg[:1]


LAST = Level(15, Corners(0.1, 0.002))
"""Under the sharpest corners; what they ask for is what the metrics ask for."""


def soft_to_sharp(rounds: int) -> tuple[Level, ...]:
    """Return the levels of a first frame, from soft corners to sharp ones.

    The materials start soft as well: with corners as wide as all they show, J is nearly a quadratic
    of the lobes' images, and what is lit wrong counts more than what is drawn wrong.

    Args:
        rounds: Rounds of splits and merges. They come last: under soft corners what glossy balls
            show wrong counts next to nothing, and splits would serve the map at their cost. And
            what takes more than half of the time begins with a fit that is good by itself.
    """
    return (
        Level(6, Corners(1.0, 1.0)),
        Level(6, Corners(1.0, 0.3)),
        Level(6, Corners(1.0, 0.1)),
        Level(6, Corners(0.3, 0.03)),
        Level(8, Corners(0.1, 0.02)),
        Level(8, Corners(0.1, 0.01)),
        Level(25, Corners(0.1, 0.005)),
        replace(LAST, rounds=rounds),
    )


FAST = FirstFrameSettings(
    (math.inf, None),
    soft_to_sharp(rounds=4),
    (0.9, 0.42, 0.42, 0.5, 0.75),
    finishing=8,
    several_max=newton.TOGETHER,
)
"""Before rounds came last, J of four was 2 to 4 % lower than with two over ten maps, of one a
sixth; six gained less than 1 % more."""

BEST = FirstFrameSettings(
    (math.inf, 4.0, None),
    soft_to_sharp(rounds=30),
    (0.816, 0.317, 0.317, 0.384, 0.672),
    finishing=40,
    again=3,
)
"""Rounds in which every split can be tried; over ten maps J still falls by 2 % after 12 of them, in
one fit by a fifth. Aims are 4 % below what `best` is to keep to on every map, 0.85, 0.33, 0.33, 0.4
and 0.7, for adaptive cells tell errors to a few percent. Each gives way until all lag alike, so an
aim with less room than others is missed first: with 2 % for env, that of a room with two lamps
was. Of ten maps one ends at 0.857 for env, a forest: to 0.85 it would go at the price of a third
more irr and a quarter more r0.25."""

FINE_ROWS, FINE_REFINED = 128, 256
"""Of the adaptive cells of the last steps. After splits a lobe may have become a streak so thin
that the usual ones see it between their centres: on one map a twentieth of the light was in one,
and J 8 % larger than they showed."""

ROWS_MIN = 16
"""Of the grid that a map is fitted on. Lobes are seen at the centres of cells, which tells little
of them on a coarser one: fitted on their own grids, maps of 1 to 5 rows are 9 to 14 % off in irr,
split to 16 rows about 1 %, and to 32 rows half a percent, for twice the time."""

FLUX_CORRECTION_MAX = 10.0
"""Largest factor on a channel. The loss leaves a percent or less; where a map is beyond what the
lobes can hold, its energy still is theirs."""


@dataclass(frozen=True)
class FrameFit:
    """The lobes of one frame, and how well they match it.

    Attributes:
        lobes: The lobes.  [N, .]
        loss: The preset's own loss.
        flux_error: Flux of the lobes over that of the map, minus 1.
    """

    lobes: Lobes
    loss: float
    flux_error: float


@dataclass(frozen=True)
class Exposed:
    """A map in units of its mean radiance.

    Attributes:
        radiance: Reference over `exposure`, on `ROWS_MIN` rows at least.  [1, 3, H * 2 H]
        exposure: Mean radiance over the sphere and RGB; 0 for a black map.
        flux: RGB flux of `radiance`, in steradians.  [3]
        height: H.
    """

    radiance: Tensor
    exposure: float
    flux: Tensor
    height: int


_LEAST = torch.finfo(torch.float32).smallest_normal * torch.finfo(torch.float32).eps
"""Of the mean radiance: the smallest number of float32. What is darker is black."""


def exposed(reference: Tensor) -> Exposed:
    """Bring a map to a mean of 1, the texels of one of few rows split.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
    """
    reference = latlong.split(reference, ROWS_MIN)
    height = reference.shape[0]
    share = grid(height, str(reference.device)).share.double()
    mean = share @ reference.flatten(0, 1).double()
    exposure = float(mean.mean())
    if exposure < _LEAST:
        exposure, mean = 0.0, torch.zeros_like(mean)
    unit = exposure if exposure > 0 else 1.0
    radiance = (reference / unit).permute(2, 0, 1).reshape(1, 3, -1).contiguous()
    return Exposed(radiance, exposure, 4 * math.pi * mean / unit, height)


def fit_first_frame(
    reference: Tensor,
    count: int,
    form: Form | None,
    settings: FirstFrameSettings = FAST,
    on_step: newton.OnStep | None = None,
    threads: int = 1,
    *,
    in_shot: bool = False,
) -> FrameFit:
    """Fit lobes to a map from nothing.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        count: N.
        form: Lobe function; None for asg, or what shows the map better (other_forms.py).
        settings: How much is spent.
        on_step: Called after each step of the first start, and each round of splits of it that is
            kept, perhaps on another thread, with lobes in mean radiances of the map.  [1, N, .]
        threads: Starts followed at once; the fit does not depend on it.
        in_shot: Whether frames follow: it is then lit as they are, on adaptive cells. A still is
            reweighted (reweighting.py), and lit once more by exact means over texels.
    """
    frame = exposed(reference)
    first = form or Form.ASG
    if frame.exposure <= 0:
        return FrameFit(dark_lobes(count, first, reference), 0.0, 0.0)
    cells = seeding.cells(reference / frame.exposure)
    whole, coarse = objective.target(frame.radiance), objective.trial_target(frame.radiance)
    last = on_fine_cells(frame)
    width_min = narrowest(frame.height)

    def finish(seed: Lobes, weights: Tensor | None, report: newton.OnStep | None) -> newton.Outcome:
        """Follow a start to its end (`multi_start.Finish`)."""
        frames = [whole, coarse, last]
        if weights is not None:
            frames = [reweighting.with_weights(each, weights) for each in frames]
        found = descend(seed[None], frames[0], frames[1], settings.levels, width_min, report)
        return newton.minimise(
            found.lobes, frames[2], settings.finishing, width_min=width_min, on_step=report
        )

    spreads = settings.spreads_of(count)
    # starts of all forms have them in common, and that from even directions is the yardstick too
    mixtures = {
        spread: once(partial(seeding.mixture, cells, count, spread)) for spread in {*spreads, None}
    }

    def seed(form: Form, spread: float | None) -> Lobes:
        return seeding.lobes_of(mixtures[spread](), cells, form)

    @once
    def aim() -> Tensor:
        """Return what errors are to come to on the last adaptive cells."""
        return reweighting.aims(seed(Form.SG, None), last, settings.left)

    def fitted(form: Form) -> reweighting.Measured:
        """Return the end of the best start."""
        seeds = [partial(seed, form, spread) for spread in spreads]
        return multi_start.best_end(
            seeds, finish, last, aim, width_min, on_step, settings.again, threads, mends=not in_shot
        )

    best = fitted(first)
    if form is None:
        promising = other_forms.promising(best.found.lobes, seed(Form.SG, None), whole, width_min)
        best = other_forms.best_of(best, map(fitted, promising))
    lit = best.lit if in_shot else light.last_by_texel_means(best.lit, last)
    return with_flux_of(lit.lobes[0], frame, float(best.found.value))


def prepare() -> None:
    """Make the tables that first frames have in common; those of `fit_first_frame` are kept."""
    with one_thread(), torch.inference_mode():
        dark = torch.zeros(1, 3, 2 * FINE_ROWS**2)
        objective.target(dark)
        objective.trial_target(dark)
        on_fine_cells(Exposed(dark, 0.0, dark.sum(-1)[0], FINE_ROWS))


def on_fine_cells(frame: Exposed) -> objective.Target:
    """Return a map on the adaptive cells of the last steps, under the last corners."""
    places = adaptive_cells.adaptive_cells(frame.radiance, FINE_ROWS, FINE_REFINED)
    return objective.target(frame.radiance, LAST.corners, places)


def descend(
    start: Lobes,
    frame: objective.Target,
    coarse: objective.Target,
    levels: tuple[Level, ...],
    width_min: float,
    on_step: newton.OnStep | None = None,
    splitting: Splitting = split_and_merge,
) -> newton.Outcome:
    """Take the steps of each level in turn.

    Args:
        start: Where to start.  [F, N, .]
        frame: The maps; each level brings its own corners.
        coarse: The same on few adaptive cells.
        levels: What is done.
        width_min: Sigma of the narrowest lobe allowed, radians.
        on_step: Called with the lobes after each step, and each round of splits that is kept.
        splitting: Tries splits; `split_and_merge` is for one map.
    """
    state = newton.Outcome(
        start, torch.empty(0), torch.tensor(newton.DAMPING_START, dtype=torch.float32)
    )
    for level in levels:
        softened = replace(frame, corners=level.corners)
        state = newton.minimise(
            state.lobes,
            softened,
            level.steps,
            damping=state.damping,
            width_min=width_min,
            on_step=on_step,
        )
        if level.rounds:
            fewer = replace(coarse, corners=level.corners)
            state = splitting(state, softened, fewer, level.rounds, width_min, on_step)
    return state


def narrowest(height: int) -> float:
    """Return sigma of the narrowest lobe on a map of `height` rows, in radians."""
    return seeding.WIDTH_MIN_TEXELS * math.pi / height


def mean_radiance(reference: Tensor) -> float:
    """Return the mean over the sphere and RGB, the unit in which a frame is fitted.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
    """
    return exposed(reference).exposure


def with_flux_of(lobes: Lobes, frame: Exposed, loss: float) -> FrameFit:
    """Give each channel exactly the map's flux, and undo the exposure.

    Args:
        lobes: Fitted to `frame`.  [N, .]
        frame: The map.
        loss: Passed on.
    """
    found = asg.flux(lobes.to(torch.float64)).sum(0)
    factor = (frame.flux / found.clamp(min=1e-30)).clamp(max=FLUX_CORRECTION_MAX)
    error = float((found * factor).sum() / frame.flux.sum()) - 1
    amplitude = lobes.amplitude * (factor * frame.exposure).to(lobes.amplitude)
    return FrameFit(replace(lobes, amplitude=amplitude), loss, error)


def dark_lobes(count: int, form: Form, reference: Tensor) -> Lobes:
    """Return black lobes spread over the sphere, ready for a light to come.  [N, .]."""
    axis_z = fibonacci_directions(count).to(reference)
    black = torch.zeros(count, 3).to(reference)
    return Lobes(axes_around(axis_z), torch.full((count, 2), 4.0).to(reference), black, form)
