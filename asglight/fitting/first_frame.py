# SPDX-License-Identifier: Apache-2.0
"""The first frame of the `fast` preset: EM start, then coarse to fine, then the flux made exact."""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import newton, objective, seeding
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

LEVELS = ((64, 12), (128, 8), (256, 8))
"""Rows and steps. A level finer than the map is replaced by the map's own rows."""

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


def fit_first_frame(reference: Tensor, count: int, form: Form) -> FrameFit:
    """Fit lobes to a map from nothing.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        count: N.
        form: Lobe function.
    """
    exposure = mean_radiance(reference)
    if exposure <= 0:
        return FrameFit(dark_lobes(count, form, reference), 0.0, 0.0)
    scaled = reference / exposure
    lobes = seeding.seed_lobes(scaled, count, form)
    height = reference.shape[0]
    width_min = narrowest(height)
    damping, loss = newton.DAMPING_START, math.inf
    for rows, steps in levels(height):
        frame = objective.target(latlong.reduce(scaled, rows, 2 * rows))
        outcome = newton.minimise(lobes, frame, steps, damping=damping, width_min=width_min)
        lobes, damping, loss = outcome.lobes, outcome.damping, outcome.value
    return with_flux_of(lobes, scaled, exposure, loss)


def levels(height: int) -> list[tuple[int, int]]:
    """Return rows and steps of each level, ending at the map's own rows."""
    coarser = [level for level in LEVELS if level[0] < height]
    return [*coarser, (height, LEVELS[min(len(coarser), len(LEVELS) - 1)][1])]


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
