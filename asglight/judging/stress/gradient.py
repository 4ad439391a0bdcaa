# SPDX-License-Identifier: Apache-2.0
"""The fit's derivative against central differences in float64.

The fit's loss J (asglight/fitting/loss/objective.py) is written down once more, plainly: the
materials as one matrix each instead of Fourier transforms, everything in float64. Its differences
along random directions of the lobes' coordinates are what `equations.normal_equations` foretells.
"""

import functools
import math
from dataclasses import fields, replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import exposed
from asglight.fitting.loss import adaptive_cells, lobe_images, objective, probes
from asglight.fitting.loss.coordinates import UNKNOWNS, advance
from asglight.fitting.loss.grid import POWERS, Grid
from asglight.fitting.steps import equations
from asglight.lobes import Lobes, asg
from asglight.shading import kernels
from asglight.sphere import latlong

ROWS, REFINED = adaptive_cells.BASE_ROWS, adaptive_cells.REFINED
"""Of the adaptive cells: the fit's own."""

MOVE = 0.1
"""Lobes are moved by a tenth of their widths first: at a fit's end the gradient is nearly 0."""

STEP = 1e-5
"""Of the differences, in widths: their error is STEP^2, and 1e-16 / STEP of rounding."""

KINDS = (slice(0, 2), slice(2, 5), slice(5, 8))
"""Directions, shapes and light of all lobes: each is checked by itself, for the light's part of a
gradient is the largest."""

SHARE_MIN = 0.05
"""Of the whole gradient: where a kind has less, for lobes that may not move, it is compared with
this instead."""

DIM = 1e-3
"""Of a lobe's brightness: a channel this near to 0 stays, for a step may not cross it."""


class _DoubleCells(adaptive_cells.AdaptiveCells):
    """Adaptive cells whose coarse grid is in float64."""

    @property
    def cells(self) -> Grid:
        """The coarse grid."""
        return _double_grid(self.rows)


def gradient_error(lobes: Lobes, radiance: Tensor) -> float | None:
    """Return how far the fit's derivative of J is from differences in float64.

    Args:
        lobes: N lobes.  [N, .]
        radiance: Repaired map.  [H, 2 H, 3]

    Returns:
        The largest difference along a random direction of each kind, relative to the length of that
        part of the gradient in natural units (widths, relative brightness); None where a black map
        leaves nothing to differentiate.
    """
    frame = exposed(radiance)
    if frame.exposure <= 0:
        return None
    places = adaptive_cells.adaptive_cells(frame.radiance, ROWS, REFINED)
    target = objective.target(frame.radiance, objective.Corners(), places)
    own = replace(lobes, amplitude=lobes.amplitude.double() / frame.exposure)
    own = own.to(torch.float32)[None]
    generator = torch.Generator().manual_seed(0)
    moved = torch.randn(own.count, UNKNOWNS, generator=generator, dtype=torch.float64)
    own = advance(own, (MOVE * _units(own) * moved).float())
    shown = lobe_images.images(own, places)
    found = objective.loss_gradient(shown.radiance, target)
    gradient = equations.normal_equations(shown, found, target)[1].reshape(1, own.count, -1)
    exact, units = own.to(torch.float64), _units(own)
    whole = float((gradient * units).norm())
    errors = []
    for kind in KINDS:
        of_kind = torch.zeros(UNKNOWNS, dtype=torch.float64)
        of_kind[kind] = 1
        length = max(float((gradient * units * of_kind).norm()), SHARE_MIN * whole)
        drawn = torch.randn(own.count, UNKNOWNS, generator=generator, dtype=torch.float64) * of_kind
        way = units * drawn
        ahead, behind = (_loss(advance(exact, side * STEP * way), target) for side in (1, -1))
        difference = float(ahead - behind) / (2 * STEP)
        apart = abs(float((gradient * way).sum()) - difference)
        errors.append(apart / (float(drawn.norm()) * length) if length > 0 else math.inf)
    error = max(errors)
    return error if math.isfinite(error) else math.inf


def _units(lobes: Lobes) -> Tensor:
    """Return a natural step of each coordinate, 0 where it is at a bound.  [1, N, 8]."""
    widths = asg.per_variance(lobes.form) * lobes.sharpness.double()
    tilt = widths.clamp(min=1).rsqrt()
    sharpness = lobes.sharpness.double()
    free = (sharpness > 1.1 * asg.SHARPNESS_MIN) & (sharpness < 0.9 * asg.SHARPNESS_MAX)
    amplitude = lobes.amplitude.double()
    brightest = amplitude.amax(-1, keepdim=True)
    light = torch.where(amplitude > DIM * brightest, brightest, 0.0)
    return torch.cat([tilt, free.double(), free.all(-1, keepdim=True).double(), light], dim=-1)


def _loss(lobes: Lobes, target: objective.Target) -> Tensor:
    """Return J but for a constant, in float64.  [1]."""
    places = _double(target.places)
    radiance = lobe_images.images(lobes, places).radiance
    corner = target.env_corner.double()
    part = radiance[:, None, :, : places.count] - target.parts.double()
    parts = objective.phi(part, corner[:, None, None]).mean(1)
    residual = radiance - target.radiance.double()
    texels = objective.phi(residual[..., places.count :], corner[:, None])
    error = (places.cell_share * parts).sum(-1) + (places.texel_share * texels).sum(-1)
    total = objective.ENV_WEIGHT * error / target.env_scale.double()
    on_cells = adaptive_cells.to_cells(residual, places)
    corners = probes.split(target.view_corner, places.rows)  # one for all views of a probe
    for index, source in enumerate(probes.PROBES):
        share, operator = _material(source, places.rows)
        size = objective.phi(on_cells @ operator.mT, corners[index][:, :1].double())
        weight = source.weight / target.probe_scale[:, index].double()
        total = total + weight * (share * size).sum(-1)
    return total


@functools.lru_cache(maxsize=8)
def _material(source: probes.Probe, rows: int) -> tuple[Tensor, Tensor]:
    """Return the shares of a material's views [D] and its filter [D, C], in float64."""
    cells = _double_grid(rows)
    views = torch.nn.functional.normalize(probes.directions(source, rows).double(), dim=-1)
    cosine = views @ cells.directions.mT
    values = kernels.kernel_values(source.kernel, cosine).double() * cells.share
    share = probes.shares(rows, "cpu", (source,)).double()
    return share, values / values.sum(-1, keepdim=True)


@functools.lru_cache(maxsize=8)
def _double_grid(rows: int) -> Grid:
    directions = latlong.directions(rows, 2 * rows, dtype=torch.float64).reshape(-1, 3)
    x, y, z = directions.unbind(-1)
    monomials = torch.stack([x**i * y**j * z**k for i, j, k in POWERS])
    share = latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64) / (4 * math.pi)
    return Grid(rows, directions, monomials, share.reshape(-1))


def _double(places: adaptive_cells.AdaptiveCells) -> _DoubleCells:
    values = {field.name: getattr(places, field.name) for field in fields(places)}
    for name, value in values.items():
        if isinstance(value, Tensor) and value.is_floating_point():
            values[name] = value.double()
    return _DoubleCells(**values)
