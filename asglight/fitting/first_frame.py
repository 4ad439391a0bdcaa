# SPDX-License-Identifier: Apache-2.0
"""A first frame: EM starts, then steps under narrowing corners, then the flux made exact."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import flat_tops, light, lobe_images, newton, objective, seeding
from asglight.fitting.grid import grid
from asglight.fitting.objective import Corners
from asglight.fitting.regroup import regroup
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions


@dataclass(frozen=True)
class Level:
    """Some steps under one pair of corners.

    Attributes:
        steps: Steps, at most.
        corners: phi's corners: from wide ones, with few minima, to those that the metrics ask for.
        kept: Starts that go on after the steps, at most: those with the least J.
        rounds: Rounds of splits and merges after that.
        matrices: Gauss-Newton matrices computed, at most (newton.py); None for one a step.
    """

    steps: int
    corners: Corners
    kept: int = 1
    rounds: int = 0
    matrices: int | None = None


@dataclass(frozen=True)
class Effort:
    """How much is spent on a first frame.

    Attributes:
        spreads_deg: `seeding.split`'s spread of each start.
        levels: What is done with the starts, one level after the other.
    """

    spreads_deg: tuple[float, ...]
    levels: tuple[Level, ...]


def soft_to_sharp(steps: int, kept: tuple[int, int], rounds: int) -> tuple[Level, ...]:
    """Return the levels down to corners at which most of the lobes have found their lamps.

    The materials start soft as well: with corners as wide as all they show, J is nearly a quadratic
    of the lobes' images, and what is lit wrong counts more than what is drawn wrong.

    Args:
        steps: Steps of a level.
        kept: Starts that go on after the first and the second level.
        rounds: Rounds of splits and merges, where J is still soft: there a trial needs few steps.
    """
    return (
        Level(steps, Corners(1.0, 1.0), kept[0]),
        Level(steps, Corners(1.0, 0.3), kept[1]),
        Level(steps, Corners(1.0, 0.1), 1, rounds),
        Level(steps, Corners(0.3, 0.03)),
    )


FINE = (
    Level(12, Corners(0.1, 0.02)),
    Level(12, Corners(0.1, 0.01)),
    Level(25, Corners(0.1, 0.005)),
    Level(15, Corners(0.1, 0.002)),
)

FAST = Effort(
    (1.0, 4.0, 12.0),
    (*soft_to_sharp(8, (2, 1), 1), replace(FINE[0], rounds=1), *FINE[1:]),
)

BEST = Effort(
    (1.0, 2.0, 4.0, 8.0, 16.0, 60.0),
    (*soft_to_sharp(12, (6, 3), 20), replace(FINE[0], rounds=20), *FINE[1:]),
)

LIGHT = Corners(0.1, 0.002)
"""phi's corners of the last solution for the light alone: what it can mend of what balls show."""

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
    unit = exposure if exposure > 0 else 1.0
    radiance = (reference / unit).permute(2, 0, 1).reshape(1, 3, -1).contiguous()
    return Exposed(radiance, exposure, 4 * math.pi * mean / unit, height)


def fit_first_frame(
    reference: Tensor,
    count: int,
    form: Form | None,
    effort: Effort = FAST,
    on_step: newton.OnStep | None = None,
) -> FrameFit:
    """Fit lobes to a map from nothing.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        count: N.
        form: Lobe function; None for asg, or flat where that shows the map better (flat_tops.py).
        effort: How much is spent.
        on_step: Called with the lobes [F, N, .] after each step, in units of the map's mean
            radiance; F starts at first, then one.
    """
    frame = exposed(reference)
    first = form or Form.ASG
    if frame.exposure <= 0:
        return FrameFit(dark_lobes(count, first, reference), 0.0, 0.0)
    cells = seeding.cells(reference / frame.exposure)
    whole = objective.target(frame.radiance)
    width_min = narrowest(frame.height)

    def fitted(form: Form) -> newton.Outcome:
        seeds = [seeding.seed_lobes(cells, count, form, spread) for spread in effort.spreads_deg]
        starts = newton.Outcome(stack(seeds), torch.empty(0), torch.tensor(newton.DAMPING_START))
        return descend(starts, whole, effort.levels, width_min, on_step)

    found = fitted(first)
    if form is None and flat_tops.promises(found.lobes, whole, width_min):
        flat = fitted(Form.FLAT)
        found = flat if flat_tops.gains(flat, found) else found
    shown = lobe_images.images(found.lobes, whole.places)
    lit = light.relight(shown, replace(whole, corners=LIGHT), passes=1)
    return with_flux_of(lit.lobes[0], frame, float(found.value))


def descend(
    start: newton.Outcome,
    frame: objective.Target,
    levels: tuple[Level, ...],
    width_min: float,
    on_step: newton.OnStep | None = None,
) -> newton.Outcome:
    """Take the steps of each level in turn, and drop the starts that it leaves behind.

    Args:
        start: One or more starts for one frame.
        frame: The map; each level brings its own corners.
        levels: What is done.
        width_min: Sigma of the narrowest lobe allowed, radians.
        on_step: Called with the lobes of all starts after each step.
    """
    state = start
    for level in levels:
        softened = replace(frame, corners=level.corners)
        state = newton.minimise(
            state.lobes,
            softened.repeated(len(state.lobes.axes)),
            level.steps,
            damping=state.damping,
            matrices=level.matrices,
            width_min=width_min,
            on_step=on_step,
        )
        kept = state.value.argsort(stable=True)[: level.kept]
        state = newton.Outcome(state.lobes[kept], state.value[kept], state.damping[kept])
        if level.rounds:
            state = regroup(state, softened, level.rounds, width_min)
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
