# SPDX-License-Identifier: Apache-2.0
"""What closed-form GGX shading needs to know of a ball and of how a sheet lies to the view.

Nothing here depends on the point of a surface: a viewer computes it once for each ball and sheet.
`ggx_lobes` has the formulas that use it. Sheets may have a dimension of points
(`Sheets.over_points`); all broadcasts.
"""

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.shading.ggx_lobes_constants import KERNEL, SHARE
from asglight.shading.rectified import cosine
from asglight.shading.sheets import Sheets, Window

ROUGHNESS_MIN, ROUGHNESS_MAX = 0.05, 1.0
"""Where the constants are fitted; beyond, the nearer end is taken, as the exported include does. At
a roughness of 0 the distribution is 0 / 0."""

SHARE_MIN = 2e-3
"""A smaller share is taken as 0, so that a shader can leave the branch out: half a
step of 8 bits."""

HALF_MIN = 1e-4
"""Least |view + axis_z|; for a light straight behind the surface there is no half vector."""

UNSHARP_MIN = 1e-6
"""Least 1 - alpha^2: at a roughness of 1 the distribution of slopes is infinitely wide."""

GAIN_REACH = 2.0
"""Narrowness beyond which the gain stays: the light is 10 times as wide as the layer, or as
narrow."""

_NODES, _NODE_WEIGHTS = (-math.sqrt(3), 0.0, math.sqrt(3)), (1 / 6, 2 / 3, 1 / 6)
"""For the mean of a function of a normal variable: exact for polynomials up to degree 5."""

_MOVES = {Window.STEP: 7, Window.NONE: 8}
"""Which number of `Layer.share` is added to the centre for a window."""


class Layer(NamedTuple):
    """What a roughness decides.

    Attributes:
        alpha: Roughness squared, of one in its range.  [...]
        kernel: Cubic polynomials of n.v, from the constant on.  [..., 4 K, 4]
        share: Centre, log slope, weights of the ratio and of v.h; log gain and its slope; log of
            what `kept` loses; what windows STEP and NONE add to the centre.  [..., 9]
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
        share: Coefficients by degree.  [D, 9]
    """
    inside = roughness.clamp(ROUGHNESS_MIN, ROUGHNESS_MAX)
    u = 2 * torch.log(inside / ROUGHNESS_MIN) / math.log(ROUGHNESS_MAX / ROUGHNESS_MIN) - 1
    degrees = torch.arange(len(kernel), device=u.device)
    basis = torch.cos(degrees * torch.acos(u.clamp(-1, 1))[..., None])
    return Layer(
        inside**2,
        torch.einsum("...d,dfk->...fk", basis, kernel),
        torch.einsum("...d,df->...f", basis, share),
    )


def window_shares(window: Window) -> np.ndarray:
    """Return the coefficients of `Layer.share` with the move of a window in the centre.  [D, 7]."""
    fitted = np.array(SHARE)
    if window in _MOVES:
        fitted[:, 0] += fitted[:, _MOVES[window]]
    return fitted[:, :7]


def slopes(alpha: Tensor) -> Tensor:
    """Return P, what the distribution of slopes is as wide as: alpha^2 / (1 - alpha^2).  [...]."""
    alpha2 = alpha * alpha
    return alpha2 / (1 - alpha2).clamp(min=UNSHARP_MIN)


def share(spread: Sheets, view: Tensor, layer: Layer) -> Tensor:
    """Return the share of `narrow`; exactly 0 or 1 where it is within SHARE_MIN.

    The shapes of sheets and layer broadcast.  [..., M].
    """
    part = torch.sigmoid(torch.exp(layer.share[..., 1]) * _narrowness(spread, view, layer))
    return torch.where(part < SHARE_MIN, 0.0, torch.where(part > 1 - SHARE_MIN, 1.0, part))


def kept(spread: Sheets, view: Tensor, layer: Layer) -> Tensor:
    """Return how much of `broad` is left of a light behind the ball.

    Half or more of what its Gaussians take from there lies below the surface's horizon, where they
    do not end. It is much where v.h, the least n.v and n.l of a highlight, is less than alpha.
    [..., M].
    """
    lost = torch.exp(layer.share[..., 6]) * layer.alpha * layer.alpha
    return -torch.expm1(-_cos_half2(spread, view) / lost)


def _cos_half2(spread: Sheets, view: Tensor) -> Tensor:
    """Return the mean of (v.h)^2 over sheets, which is (1 + v.w) / 2.  [..., M]."""
    mean = 0.5 + 0.5 * spread.mean * _dot(spread.axes[..., 2, :], view)
    return mean.clamp(min=HALF_MIN**2)


def _narrowness(spread: Sheets, view: Tensor, layer: Layer) -> Tensor:
    """Return how narrow sheets are to the layer: 0 where both approximations count the same.

    It rises with log(s P) for P of `narrow`; at a roughness of 1, where only `narrow` is nearly
    exact, P has no bound. Half vectors move by 1 / (2 v.h) of the light across the plane of both,
    so a light behind the ball is wider than it is in front of it; v.h is of the light's mean.
    [..., M].
    """
    centre, _, by_ratio, by_tilt, *_ = layer.share.unbind(-1)
    if spread.window in _MOVES:
        centre = centre + layer.share[..., _MOVES[spread.window]]
    vx, vy = spread.disc_variance.unbind(-1)
    narrow = torch.log10(0.5 * slopes(layer.alpha) / (vx * vy).sqrt())  # s P
    tilted = 0.5 * torch.log10(_cos_half2(spread, view))
    return narrow + by_ratio * torch.log10(vx / vy).abs() + by_tilt * tilted - centre


def tilt(spread: Sheets, view: Tensor, layer: Layer) -> Tilt:
    """Return half vectors of view and sheets, and how the sheets spread them.

    Of h = (v + w) / |v + w| the derivative by w is (1 - h h^T) / |v + w|, and |v + w| = 2 v.h.
    """
    axis_x, axis_y, axis_z = spread.axes.unbind(-2)
    total = axis_z + view
    length = total.norm(dim=-1, keepdim=True).clamp(min=HALF_MIN)
    # A light straight behind has its half vectors across the view, one as good as another.
    half = torch.where(length > HALF_MIN, total / length, axis_x)
    narrowness = _narrowness(spread, view, layer).clamp(-GAIN_REACH, GAIN_REACH)
    gain = torch.exp(layer.share[..., 4] + layer.share[..., 5] * narrowness)
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
