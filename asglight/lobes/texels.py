# SPDX-License-Identifier: Apache-2.0
"""Lobes on a latlong grid: the mean radiance over each texel, also for lobes narrower than one.

A lobe as wide as four texels or more is sampled at the texel centres. A narrower one is averaged
over sub-texels, no larger than a quarter of its width, of the texels it reaches; so its energy
counts in full wherever it lies between the centres.

Width means sigma = 1 / sqrt(2 sharpness), in radians, of the sharper axis; for the sg form
sigma = 1 / sqrt(sharpness).
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Form, Lobes
from asglight.sphere import latlong

NARROW_WIDTH_TEXELS = 4.0
"""In texels at the equator. Sampled at the centres, a lobe this wide is 0.26 % an axis off at its
peak, and 0.26 % off in flux at a pole (the midpoint rule's (texel / sigma)^2 / 24); elsewhere its
flux is exact to (texel in radians)^2 / 24, 6e-6 on 256 rows."""

SUBTEXELS_PER_WIDTH = 4.0
"""Sub-texels per sigma: the same bound for narrow lobes as for those just wide enough."""

CUTOFF = 18.0
"""Exponent beyond which a narrow lobe is left out: exp(-18) = 1.5e-8, below float32 rounding."""

SUBTEXELS_AT_ONCE = 1 << 21
"""Directions evaluated in one piece: 24 MB of float32 triples."""


def texel_means(lobes: Lobes, height: int, width: int) -> Tensor:
    """Return the mean radiance of all lobes together over each texel.

    Args:
        lobes: N lobes of one frame.  [N, .]
        height: Rows of the grid.
        width: Columns of the grid.

    Returns:
        Linear RGB radiance.  [H, W, 3]
    """
    values = unit_texel_means(lobes, height, width)  # [N, P]
    return (values.mT @ lobes.amplitude).reshape(height, width, 3)


def unit_texel_means(lobes: Lobes, height: int, width: int) -> Tensor:
    """Return the mean of each unit-amplitude lobe over each texel.  [N, H * W]."""
    directions = latlong.directions(
        height, width, dtype=lobes.sharpness.dtype, device=lobes.sharpness.device
    ).reshape(-1, 3)
    narrow = is_narrow(lobes, height)
    values = directions.new_zeros(lobes.count, height * width)
    values[~narrow] = asg.unit_lobes(lobes.select(~narrow), directions)
    for index in torch.nonzero(narrow).flatten().tolist():
        lobe = lobes.select(torch.tensor([index], device=lobes.axes.device))
        texels = texels_reached(lobe, directions, (height, width))
        means = mean_over_texels(
            lambda d, lobe=lobe: asg.unit_lobes(lobe, d), lobe, texels, (height, width)
        )
        values[index, texels] = means[0]
    return values


def is_narrow(lobes: Lobes, height: int) -> Tensor:
    """Tell which lobes are narrower than four texels of a grid of `height` rows.  [..., N]."""
    return lobe_width(lobes) < NARROW_WIDTH_TEXELS * math.pi / height


def lobe_width(lobes: Lobes) -> Tensor:
    """Return sigma of the sharper axis, in radians.  [..., N]."""
    factor = 1.0 if lobes.form is Form.SG else 2.0
    return (factor * lobes.sharpness.amax(-1)).rsqrt()


def texels_reached(lobe: Lobes, directions: Tensor, grid: tuple[int, int]) -> Tensor:
    """Return the indices of the texels in which one lobe exceeds exp(-CUTOFF) of its peak.

    Args:
        lobe: One lobe.  [1, .]
        directions: Texel centres.  [P, 3]
        grid: Rows and columns, (H, W); half a texel's diagonal is the margin.
    """
    margin = math.hypot(math.pi / grid[0], 2 * math.pi / grid[1]) / 2
    if lobe.form is Form.SG:
        chord = (directions - lobe.axis_z).square().sum(-1).sqrt()
        reached = 0.5 * lobe.sharpness[0, 0] * (chord - margin).clamp(min=0).square() < CUTOFF
    else:
        x, y, z = (lobe.axes[0] @ directions.mT).unbind(0)
        sx, sy = lobe.sharpness[0]
        exponent = (
            sx * (x.abs() - margin).clamp(min=0).square()
            + sy * (y.abs() - margin).clamp(min=0).square()
        )
        reached = exponent < CUTOFF
        if lobe.form is Form.ASG:
            reached &= z > -margin
    return torch.nonzero(reached).flatten()


def mean_over_texels(
    function: Callable[[Tensor], Tensor],
    lobe: Lobes,
    texels: Tensor,
    grid: tuple[int, int],
) -> Tensor:
    """Average a function of direction over texels, finely enough for one narrow lobe.

    Args:
        function: Maps directions [P, 3] to values [K, P].
        lobe: The lobe whose width sets the step.  [1, .]
        texels: Indices into the flattened grid.  [T]
        grid: Rows and columns, (H, W).

    Returns:
        Means, exactly weighted by solid angle between sub-rows.  [K, T]
    """
    height, width = grid
    texel = max(math.pi / height, 2 * math.pi / width)
    per_side = math.ceil(SUBTEXELS_PER_WIDTH * texel / float(lobe_width(lobe)))
    step = max(1, SUBTEXELS_AT_ONCE // per_side**2)
    pieces = [
        _mean_over_piece(function, texels[start : start + step], per_side, height, width, lobe)
        for start in range(0, len(texels), step)
    ]
    return torch.cat(pieces, dim=-1)


def _mean_over_piece(
    function: Callable[[Tensor], Tensor],
    texels: Tensor,
    per_side: int,
    height: int,
    width: int,
    lobe: Lobes,
) -> Tensor:
    offsets = (torch.arange(per_side, dtype=torch.float64) + 0.5) / per_side
    place = texels.cpu()
    u = ((place % width)[:, None] + offsets) / width  # [T, k]
    total = lobe.axes.new_zeros(())
    norm = torch.zeros(len(place), 1, dtype=torch.float64)
    for rows in offsets.split(max(1, SUBTEXELS_AT_ONCE // (per_side * len(place)))):
        v = ((place // width)[:, None] + rows) / height  # [T, r]
        weight = torch.sin(math.pi * v)  # solid angle of a sub-row, but for a common factor
        directions = latlong.direction_from_uv(u[:, None, :], v[:, :, None]).to(lobe.axes)
        values = function(directions.reshape(-1, 3))
        values = values.reshape(-1, len(place), len(rows), per_side)
        total = total + (values.mean(-1) * weight.to(lobe.axes)).sum(-1)
        norm += weight.sum(-1, keepdim=True)
    return total / norm[:, 0].to(lobe.axes)
