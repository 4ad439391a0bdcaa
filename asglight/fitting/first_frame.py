# SPDX-License-Identifier: Apache-2.0
"""A first frame: EM starts, then coarse to fine, then the light solved and the flux made exact."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import light, newton, objective, seeding
from asglight.fitting.objective import Corners
from asglight.fitting.regroup import regroup
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions


@dataclass(frozen=True)
class Level:
    """Some steps on one grid.

    Attributes:
        rows: Rows of the grid; the map's own where it has fewer.
        steps: Steps, at most.
        corners: phi's corners: from wide ones, with few minima, to those that the metrics ask for.
    """

    rows: int
    steps: int
    corners: Corners


@dataclass(frozen=True)
class Effort:
    """How much is spent on a first frame.

    Attributes:
        spreads_deg: `seeding.split`'s spread of each start.
        coarse: Levels that each start gets; the one with the least J goes on.
        trials: Splits and merges tried on the grid of the first fine level.
        fine: Levels that follow.
    """

    spreads_deg: tuple[float, ...]
    coarse: tuple[Level, ...]
    trials: int
    fine: tuple[Level, ...]


COARSE = (Level(64, 8, Corners(1.0, 0.05)), Level(64, 6, Corners(0.3, 0.02)))

FAST = Effort(
    (seeding.SPREAD_DEG,),
    COARSE,
    0,
    (
        Level(64, 8, Corners(0.1, 0.02)),
        Level(128, 8, Corners(0.1, 0.01)),
        Level(256, 8, Corners(0.1, 0.005)),
    ),
)

BEST = Effort(
    (2.0, 3.5, 5.0, 8.0, 15.0, 60.0),
    (*COARSE, Level(128, 10, Corners(0.1, 0.01))),
    16,
    (
        Level(128, 10, Corners(0.1, 0.01)),
        Level(256, 40, Corners(0.05, 0.005)),
    ),
)

LIGHT = Corners(0.1, 0.002)
"""phi's corners of the last solution for the light alone: what it can mend of what balls show."""

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


def fit_first_frame(
    reference: Tensor,
    count: int,
    form: Form,
    effort: Effort = FAST,
    on_step: newton.OnStep | None = None,
) -> FrameFit:
    """Fit lobes to a map from nothing.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        count: N.
        form: Lobe function.
        effort: How much is spent.
        on_step: Called with the lobes after each step, in units of the map's mean radiance.
    """
    exposure = mean_radiance(reference)
    if exposure <= 0:
        return FrameFit(dark_lobes(count, form, reference), 0.0, 0.0)
    scaled, height = reference / exposure, reference.shape[0]
    cells = seeding.cells(scaled)
    coarse, fine = levels_for(effort.coarse, height, last=False), levels_for(effort.fine, height)
    started: list[newton.Outcome] = []
    for spread_deg in effort.spreads_deg:
        seeds = seeding.seed_lobes(cells, count, form, spread_deg)
        start = newton.Outcome(seeds, math.inf, newton.DAMPING_START)
        started.append(_descend(scaled, start, coarse, on_step))
    chosen = min(started, key=lambda outcome: outcome.value)
    if effort.trials:
        level = fine[0]
        frame = objective.target(latlong.reduce(scaled, level.rows, 2 * level.rows), level.corners)
        chosen = regroup(chosen, frame, effort.trials, narrowest(height))
    found = _descend(scaled, chosen, fine, on_step)
    lobes = light.relight(found.lobes, objective.target(scaled, LIGHT))
    return with_flux_of(lobes, scaled, exposure, found.value)


def levels_for(levels: tuple[Level, ...], height: int, *, last: bool = True) -> list[Level]:
    """Return the levels for a map of so many rows.

    Levels as fine as the map or finer fall together, with the corners of the last and the most
    steps.

    Args:
        levels: From coarse to fine.
        height: Rows of the map.
        last: The last level is on the map's own rows, however many.
    """
    coarser = [level for level in levels if level.rows < height]
    finer = levels[len(coarser) :]
    if not finer and not last:
        return coarser
    finer = finer or levels[-1:]
    return [*coarser, Level(height, max(level.steps for level in finer), finer[-1].corners)]


def _descend(
    scaled: Tensor, start: newton.Outcome, levels: list[Level], on_step: newton.OnStep | None
) -> newton.Outcome:
    """Take the steps of each level in turn."""
    state = start
    for level in levels:
        frame = objective.target(latlong.reduce(scaled, level.rows, 2 * level.rows), level.corners)
        state = newton.minimise(
            state.lobes,
            frame,
            level.steps,
            damping=state.damping,
            width_min=narrowest(scaled.shape[0]),
            on_step=on_step,
        )
    return state


def narrowest(height: int) -> float:
    """Return sigma of the narrowest lobe on a map of `height` rows, in radians."""
    return seeding.WIDTH_MIN_TEXELS * math.pi / height


def mean_radiance(reference: Tensor) -> float:
    """Return the mean over the sphere and RGB, the unit in which a frame is fitted."""
    weight = latlong.texel_solid_angles(*reference.shape[:2], dtype=torch.float64)
    return float((weight[..., None].to(reference.device) * reference).sum()) / (12 * math.pi)


def with_flux_of(lobes: Lobes, scaled: Tensor, exposure: float, loss: float) -> FrameFit:
    """Give each channel exactly the map's flux, and undo the exposure.

    Args:
        lobes: Fitted to `scaled`.
        scaled: Reference over `exposure`.  [H, W, 3]
        exposure: Mean radiance of the reference.
        loss: Passed on.
    """
    height, width, _ = scaled.shape
    weight = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    weight = weight.to(scaled.device)
    wanted = (weight * scaled).sum((0, 1))
    found = (weight * texels.texel_means(lobes, height, width)).sum((0, 1))
    factor = (wanted / found.clamp(min=1e-30)).clamp(max=FLUX_CORRECTION_MAX)
    error = float((found * factor).sum() / wanted.sum()) - 1
    amplitude = lobes.amplitude * (factor * exposure).to(lobes.amplitude)
    return FrameFit(replace(lobes, amplitude=amplitude), loss, error)


def dark_lobes(count: int, form: Form, reference: Tensor) -> Lobes:
    """Return black lobes spread over the sphere, ready for a light to come.  [N, .]."""
    axis_z = fibonacci_directions(count).to(reference)
    black = torch.zeros(count, 3).to(reference)
    return Lobes(axes_around(axis_z), torch.full((count, 2), 4.0).to(reference), black, form)
