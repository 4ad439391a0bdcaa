# SPDX-License-Identifier: Apache-2.0
"""Texels of a dome, made for renderers that interpolate between them, as nearly all do.

Linear interpolation shows a texel as a tent two texels wide. It leaves flux and direction as they
are and adds 1/6 square texel to the variance each way, which on 256 rows is 0.3 degrees: as much as
a sun has. Mean radiances over texels would also move a sun by up to half a texel. So the texels
hold narrower lobes, and what interpolation makes of them has the lobes' own second moments:

- A lobe of a texel or more is taken at the texel centres, narrowed by the tent.
- A smaller one is cut into points, and each point shared by the four texels around it, as
  interpolation would weigh them there. Sharing adds 1/6 square texel once more, so the lobe is
  narrowed twice as much, to a line or a point at the least. A point between two texels takes both,
  and shows 1/4 square texel wider than one in the middle; nothing not negative is narrower. A flat
  lobe so small is taken for an asg one: no texel can tell.

Rows next to a pole count as all others; a renderer has no texel beyond them.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes import asg, texels
from asglight.lobes.data import Form, Lobes
from asglight.sphere import latlong

TENT = 1 / 6
"""Variance of a tent two texels wide, in square texels."""

SAMPLED_WIDTH_TEXELS = 1.0
"""Sigma from which a lobe is taken at the centres: narrowed it has variance 5/6, and the sum over
a grid is right to 2 exp(-2 pi^2 5/6) = 1e-7 (Poisson's summation formula)."""

GAUSSIAN_WIDTH = 0.05
"""Sigma in radians below which a lobe of the form sg is taken for an asg one of its flux: at two
sigma the exponents are 0.5 % apart."""

REACH = 5.0
"""Sigmas to which the points of a lobe go: 6e-7 of a Gaussian lies beyond each way."""


def interpolated(lobes: Lobes, height: int) -> Tensor:
    """Return texels that show the lobes where a renderer interpolates between them.

    Args:
        lobes: N lobes of one frame.  [N, .]
        height: Rows; there are twice as many columns.

    Returns:
        Linear RGB radiance, float32.  [H, 2H, 3]
    """
    texel = math.pi / height
    width = texels.lobe_width(lobes.to("cpu", torch.float64))
    if lobes.form is Form.SG:
        narrow = width < max(GAUSSIAN_WIDTH, SAMPLED_WIDTH_TEXELS * texel)
        gaussian = _as_asg(lobes.select(narrow))
        return _samples(lobes.select(~narrow), height) + interpolated(gaussian, height)
    small = width < SAMPLED_WIDTH_TEXELS * texel
    if lobes.form is Form.FLAT and bool(small.any()):
        alike = _as_asg(lobes.select(small))
        return interpolated(lobes.select(~small), height) + interpolated(alike, height)
    sampled = _samples(narrowed(lobes.select(~small), texel, TENT), height)
    shared = torch.zeros(2 * height * height, 3, dtype=torch.float64)
    for index in small.nonzero().flatten():
        _share(shared, narrowed(lobes.select(index[None]), texel, 2 * TENT), height)
    solid_angles = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64)[..., None]
    return sampled + (shared.view(height, 2 * height, 3) / solid_angles).float()


def narrowed(lobes: Lobes, texel: float, squares: float) -> Lobes:
    """Take the variance of so many square texels from lobes, their flux kept.

    Args:
        lobes: Lobes of the form asg, bingham or flat.  [N, .]
        texel: Height of a row, in radians.
        squares: Variance along rows and columns, in square texels.

    Returns:
        Lobes in float64; a variance that is used up becomes that of the sharpest lobe.  [N, .]
    """
    lobes = lobes.to("cpu", torch.float64)
    axis_z = lobes.axis_z
    level = axis_z[..., [0, 2]].norm(dim=-1)  # cosine of latitude: how wide a texel is
    # at a pole a texel has no width, and it does not matter where east is
    east = torch.stack([axis_z[..., 2], torch.zeros_like(level), -axis_z[..., 0]], dim=-1)
    east = east / level.clamp(min=1e-12)[..., None]
    grid = torch.stack([east * level[..., None], torch.linalg.cross(axis_z, east)], dim=-2)
    across = lobes.axes[..., :2, :]
    along = across @ grid.mT  # [N, 2, 2]
    per_variance = asg.per_variance(lobes.form)
    variance = torch.diag_embed(1 / (per_variance * lobes.sharpness.clamp(min=asg.SHARPNESS_MIN)))
    variance -= squares * texel**2 * along @ along.mT
    values, vectors = torch.linalg.eigh(variance)
    axis_x = (vectors.mT @ across)[..., 0, :]
    axes = torch.stack([axis_x, torch.linalg.cross(axis_z, axis_x), axis_z], dim=-2)
    narrowest = 1 / (per_variance * asg.SHARPNESS_MAX)
    sharpness = 1 / (per_variance * values.clamp(min=narrowest))
    result = replace(lobes, axes=axes, sharpness=sharpness)
    ratio = asg.integral(lobes) / asg.integral(result)
    return replace(result, amplitude=lobes.amplitude * ratio[..., None])


def _samples(lobes: Lobes, height: int) -> Tensor:
    """Return the radiance at the texel centres.  [H, 2H, 3]."""
    directions = latlong.directions(height, 2 * height).view(-1, 3)
    return asg.evaluate(lobes.to("cpu", torch.float32), directions).view(height, 2 * height, 3)


def _as_asg(lobes: Lobes) -> Lobes:
    """Return narrow lobes as such of the form asg, of the same flux and variances."""
    found = replace(lobes.to("cpu", torch.float64), form=Form.ASG)
    found = replace(found, sharpness=found.sharpness * asg.per_variance(lobes.form) / 2)
    ratio = asg.integral(lobes.to("cpu", torch.float64)) / asg.integral(found)
    return replace(found, amplitude=found.amplitude * ratio[..., None])


def _share(shared: Tensor, lobe: Lobes, height: int) -> None:
    """Add the flux of one lobe to the texels around its points.

    Args:
        shared: Flux of every texel, added to.  [2HH, 3]
        lobe: One lobe, its x axis the narrower one.  [1, .]
        height: Rows.
    """
    directions, flux = _points(lobe, math.pi / height)
    u, v = latlong.uv_from_direction(directions)
    row, column = v * height - 0.5, u * 2 * height - 0.5
    above, left = row.floor(), column.floor()
    for down in (0, 1):
        for right in (0, 1):
            share = (1 - (row - above - down).abs()) * (1 - (column - left - right).abs())
            # rows of the caps above the first centre and below the last are their neighbour's
            place = (above.long() + down).clamp(0, height - 1) * 2 * height
            place += (left.long() + right) % (2 * height)
            shared.index_add_(0, place, share[:, None] * flux)


def _points(lobe: Lobes, texel: float) -> tuple[Tensor, Tensor]:
    """Cut one lobe into points, evenly in x and in t where d = (x, r sin t, r cos t).

    With r = sqrt(1 - x^2), dw = dx dt. Steps of sigma sum a Gaussian to 1e-8, steps of half a texel
    its product with a tent.

    Returns:
        Directions [T, 3]; flux of each [T, 3], which sums to the lobe's.
    """
    sigma = (2 * lobe.sharpness[0]).rsqrt().tolist()
    reach = [math.asin(min(1.0, REACH * one)) for one in sigma]
    x, t = (
        torch.linspace(-far, far, 2 * math.ceil(far / min(one, texel / 2)) + 1, dtype=torch.float64)
        for far, one in zip(reach, sigma, strict=True)
    )
    x, t = (grid.flatten() for grid in torch.meshgrid(x, t, indexing="ij"))
    radius = (1 - x * x).clamp(min=0).sqrt()
    local = torch.stack([x, radius * t.sin(), radius * t.cos()])
    share = asg.local_values(lobe, local[None])[0]
    flux = (share / share.sum())[:, None] * asg.flux(lobe)
    directions = local.mT @ lobe.axes[0]
    if lobe.form is Form.BINGHAM:
        return torch.cat([directions, -directions]), torch.cat([flux, flux]) / 2
    return directions, flux
