# SPDX-License-Identifier: Apache-2.0
"""What closed-form GGX shading needs to know of a ball and of how a sheet lies to the view.

Nothing here depends on the point of a surface: a viewer computes it once for each ball and sheet.
`ggx_lobes` has the formulas that use it. Sheets may have a dimension of points
(`Sheets.over_points`); all broadcasts.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.shading.ggx_lobes_constants import KERNEL, MOVE, SHARE
from asglight.shading.rectified import cosine
from asglight.shading.sheets import Sheets, Window

ROUGHNESS_MIN, ROUGHNESS_MAX = 0.05, 1.0
"""Where the constants are fitted; beyond, the nearer end's are taken."""

SHARE_MIN = 1e-3
"""A smaller share is taken as 0, so that a shader can leave the branch out."""

HALF_MIN = 1e-4
"""Least |view + axis_z|; for a light straight behind the surface there is no half vector."""

UNSHARP_MIN = 1e-6
"""Least 1 - alpha^2: at a roughness of 1 the distribution of slopes is infinitely wide."""

_NODES, _NODE_WEIGHTS = (-math.sqrt(3), 0.0, math.sqrt(3)), (1 / 6, 2 / 3, 1 / 6)
"""For the mean of a function of a normal variable: exact for polynomials up to degree 5."""

SHARE_MOVES = {Window.COSINE: 0.0, Window.STEP: MOVE[0], Window.NONE: MOVE[1]}
"""What is added to the centre of `share`."""


class Layer(NamedTuple):
    """What a roughness decides.

    Attributes:
        alpha: Roughness squared.  [...]
        kernel: Cubic polynomials of n.v, from the constant on.  [..., 4 K, 4]
        share: Centre, log slope, weight of the ratio, log gain.  [..., 4]
    """

    alpha: Tensor
    kernel: Tensor
    share: Tensor


class Tilt(NamedTuple):
    """How sheets spread half vectors; constant over a ball seen from far away.

    Attributes:
        half: Half vector of view and axis_z.  [..., 3]
        grazing: Mean of Schlick's (1 - v.h)^5 over the sheet.  [...]
        slope_x: Change of the half vector by one deviation along axis_x, times sqrt 2.  [..., 3]
        slope_y: The same along axis_y.  [..., 3]
    """

    half: Tensor
    grazing: Tensor
    slope_x: Tensor
    slope_y: Tensor


def layer(roughness: Tensor) -> Layer:
    """Take the fitted constants at a roughness.  [...]."""
    kernel, share = (
        torch.tensor(constants, dtype=torch.float64).to(roughness) for constants in (KERNEL, SHARE)
    )
    return layer_from(roughness, kernel, share)


def layer_from(roughness: Tensor, kernel: Tensor, share: Tensor) -> Layer:
    """Sum Chebyshev polynomials of log(roughness).

    Args:
        roughness: [...]
        kernel: Coefficients by degree.  [D, 4 K, 4]
        share: Coefficients by degree.  [D, 4]
    """
    inside = roughness.clamp(ROUGHNESS_MIN, ROUGHNESS_MAX)
    u = 2 * torch.log(inside / ROUGHNESS_MIN) / math.log(ROUGHNESS_MAX / ROUGHNESS_MIN) - 1
    degrees = torch.arange(len(kernel), device=u.device)
    basis = torch.cos(degrees * torch.acos(u.clamp(-1, 1))[..., None])
    return Layer(
        roughness**2,
        torch.einsum("...d,dfk->...fk", basis, kernel),
        torch.einsum("...d,df->...f", basis, share),
    )


def slopes(alpha: Tensor) -> Tensor:
    """Return P, what the distribution of slopes is as wide as: alpha^2 / (1 - alpha^2).  [...]."""
    alpha2 = alpha * alpha
    return alpha2 / (1 - alpha2).clamp(min=UNSHARP_MIN)


def share(spread: Sheets, layer: Layer, moved: float | Tensor) -> Tensor:
    """Return the share of `narrow`; exactly 0 or 1 where it is within SHARE_MIN.

    It rises with log(s P) for P of `narrow`, which says how narrow the sheet is to the layer; at a
    roughness of 1, where only `narrow` is nearly exact, P has no bound and the share is 1.
    `moved` is the `SHARE_MOVES` of the window. The shapes of
    sheets and layer broadcast.  [..., M].
    """
    centre, log_slope, by_ratio, _ = layer.share.unbind(-1)
    vx, vy = spread.disc_variance.unbind(-1)
    narrowness = 0.5 * slopes(layer.alpha) / (vx * vy).sqrt()  # s P
    place = torch.log10(narrowness) + by_ratio * torch.log10(vx / vy).abs()
    part = torch.sigmoid(torch.exp(log_slope) * (place - centre - moved))
    return torch.where(part < SHARE_MIN, 0.0, torch.where(part > 1 - SHARE_MIN, 1.0, part))


def tilt(spread: Sheets, view: Tensor, layer: Layer) -> Tilt:
    """Return half vectors of view and sheets, and how the sheets spread them.

    Of h = (v + w) / |v + w| the derivative by w is (1 - h h^T) / |v + w|, and |v + w| = 2 v.h.
    """
    axis_x, axis_y, axis_z = spread.axes.unbind(-2)
    total = axis_z + view
    length = total.norm(dim=-1, keepdim=True).clamp(min=HALF_MIN)
    # A light straight behind has its half vectors across the view, one as good as another.
    half = torch.where(length > HALF_MIN, total / length, axis_x)
    gain = torch.exp(layer.share[..., 3])
    deviations = (2 * gain[..., None] * spread.variance).sqrt() / length
    slope_x, slope_y = (
        (axis - half * _dot(half, axis)[..., None]) * deviations[..., i : i + 1]
        for i, axis in enumerate((axis_x, axis_y))
    )
    return Tilt(half, _grazing(spread, view, layer.alpha), slope_x, slope_y)


def _grazing(spread: Sheets, view: Tensor, alpha: Tensor) -> Tensor:
    """Return the mean of (1 - v.h)^5 over sheets [Schlick 1994], weighted by 1 + v.w.

    The weight stands for how much of a ball a light from w reaches that is seen. v.w is taken as
    normal, at the three nodes of Gauss and Hermite; v.h is sqrt((1 + v.w) / 2).  [...].
    """
    mean, deviation = cosine(spread, view)
    deviation = alpha * deviation
    nodes = torch.tensor(_NODES, dtype=torch.float64).to(mean)
    weights = torch.tensor(_NODE_WEIGHTS, dtype=torch.float64).to(mean)
    cos_half = (0.5 + 0.5 * (mean[..., None] + deviation[..., None] * nodes)).clamp(0, 1).sqrt()
    weights = weights * cos_half.square().clamp(min=HALF_MIN**2)
    return (weights * (1 - cos_half) ** 5).sum(-1) / weights.sum(-1)


def _dot(a: Tensor, b: Tensor) -> Tensor:
    return (a * b).sum(-1)
