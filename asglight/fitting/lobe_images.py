# SPDX-License-Identifier: Apache-2.0
"""Images of lobes on leaves: values, slopes of a loss, and the columns of the Gauss-Newton matrix.

The mean of a Gaussian over a texel is, to second order in the texel's size, a wider Gaussian: the
texel's own second moment T adds to the lobe's covariance. With S = diag(sx, sy) in the lobe's frame
it has the sharpness matrix S' = (I + 2 S T)^-1 S and the peak c = det(I + 2 S T)^-1/2. So one
formula serves leaves of any size and lobes of any width, and a lobe narrower than a cell still has
a slope there. T is held in the derivatives.

Sums over leaves are exact to 2 exp(-2 pi^2 sigma'^2) an axis, sigma' in leaves: 39 % for a lobe far
narrower than its leaf, sigma'^2 = 1/12. Narrow lobes are therefore scaled to their exact integral,
and the scale's own change is part of every derivative: without it a narrow lobe that only moves
would seem to change its flux from leaf to leaf, which outweighs what its motion does.

The exponent and each derivative over the value are polynomials in direction of degree 1 and 2, so
an image is one product with the monomials of direction, and the slopes of a loss along all
coordinates come from the moments of lobe times slope.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import torch
from torch import Tensor

from asglight.fitting.coordinates import BROAD, is_round
from asglight.fitting.grid import Grid
from asglight.fitting.leaves import Leaves
from asglight.lobes import Form, Lobes

EXPONENT_MIN = -30.0
"""Of exp: 1e-13 of the peak, beyond sight; its square times a leaf's share is no denormal number,
for which a processor takes many times as long."""

COLUMNS = 6
"""The lobe, two tilts, two widths, one turn."""

NARROW_SHARPNESS, LONG_SHARPNESS = 50.0, 8.0
"""Of the sharper and of the other axis, from which the integral is taken as that of a plane
Gaussian, below a percent off for each form; others are sampled well by any grid of 16 rows."""

SCALE_MIN, SCALE_MAX = 0.5, 3.0
"""Of a narrow lobe's correction: a cell's centre asks for 0.52, the corner of four for 2.63; only
near a pole, where rows of cells are unlike, more is lacking."""


@dataclass(frozen=True)
class Footprint:
    """Lobes as leaves of L sizes see them, as polynomials in the monomials of degree 1 and 2.

    Attributes:
        exponent: Of the value over z: log c - d^T S' d.  [L, F, N, 9]
        derivatives: Of the value over the value, along the five coordinates; for the asg form less
            the tilts of z.  [L, F, N, 5, 9]
    """

    exponent: Tensor
    derivatives: Tensor


@dataclass(frozen=True)
class Images:
    """Lobes of amplitude 1 on leaves.

    Attributes:
        lobes: The lobes.  [F, N, .]
        values: Means over each leaf, but for `scale`.  [F, N, P]
        gaussian: The values over z where z > 0 for the asg form; else the values.  [F, N, P]
        scale: What makes the integrals of narrow lobes exact.  [F, N]
    """

    lobes: Lobes
    values: Tensor
    gaussian: Tensor
    scale: Tensor

    def __getitem__(self, index: Any) -> Self:
        """Index the frames, as one would index each tensor."""
        parts = {name: value[index] for name, value in vars(self).items()}
        return replace(self, **parts)

    @property
    def light(self) -> Tensor:
        """Amplitudes of `values`.  [F, N, 3]."""
        return self.lobes.amplitude * self.scale[..., None]

    @property
    def radiance(self) -> Tensor:
        """What all lobes send together.  [F, 3, P]."""
        return self.light.mT @ self.values


def images(lobes: Lobes, places: Leaves) -> Images:
    """Evaluate lobes on leaves.  [F, N, .]."""
    levels = places.levels
    _, inverse, determinant = _seen(lobes, [rows for rows, _, _ in levels])
    exponents = _exponent(lobes, inverse, determinant)
    parts = [
        _values(lobes, exponent, monomials)
        for exponent, (_, monomials, _) in zip(exponents, levels, strict=True)
    ]
    values = torch.cat([part[0] for part in parts], dim=-1)
    gaussian = values
    if lobes.form is Form.ASG:
        gaussian = torch.cat([part[1] for part in parts], dim=-1)
    return Images(
        lobes, values, gaussian, _scale(lobes, (values @ places.share[..., None])[..., 0])
    )


def _scale(lobes: Lobes, mean: Tensor) -> Tensor:
    """Return what makes the mean over the sphere of narrow lobes exact.  [F, N]."""
    exact = _plane_integral(lobes) / (4 * math.pi)
    scale = (exact / mean.clamp(min=torch.finfo(mean.dtype).tiny)).clamp(SCALE_MIN, SCALE_MAX)
    return torch.where(_is_narrow(lobes), scale, 1.0)


def _scale_slopes(lobes: Lobes, scale: Tensor, change: Tensor) -> Tensor:
    """Return d log scale along the five coordinates, where it is not at a bound.  [F, N, 5].

    Args:
        lobes: The lobes.  [F, N, .]
        scale: Their `_scale`.  [F, N]
        change: d log mean, the mean over the leaves.  [F, N, 5]
    """
    free = _is_narrow(lobes) & (scale > SCALE_MIN) & (scale < SCALE_MAX)
    return torch.where(free[..., None], _plane_integral_slopes(lobes) - change, 0.0)


def _is_narrow(lobes: Lobes) -> Tensor:
    sharpness = lobes.sharpness
    return (sharpness.amax(-1) > NARROW_SHARPNESS) & (sharpness.amin(-1) > LONG_SHARPNESS)


def _plane_integral(lobes: Lobes) -> Tensor:
    """Return the integral of narrow lobes of amplitude 1.  [F, N]."""
    sx, sy = lobes.sharpness.unbind(-1)
    if lobes.form is Form.SG:
        return 2 * math.pi / sx
    plane = math.pi / (sx * sy).sqrt()
    if lobes.form is Form.ASG:  # dx dy = z dw
        return plane
    return 2 * plane * (1 + (1 / sx + 1 / sy) / 4)  # two lobes; dw = dx dy / z, 1 / z ~ 1 + r^2 / 2


def _plane_integral_slopes(lobes: Lobes) -> Tensor:
    """Return d log of it along the five coordinates, of which widths hold it nearly.  [F, N, 5]."""
    sharpness = lobes.sharpness
    found = sharpness.new_zeros(*sharpness.shape[:-1], 5)
    if lobes.form is Form.SG:
        found[..., 2] = -BROAD / sharpness[..., 0]
        return found
    found[..., 2:4] = -BROAD / (2 * sharpness)
    if lobes.form is Form.BINGHAM:
        sides = 4 + (1 / sharpness).sum(-1, keepdim=True)
        found[..., 2:4] -= (sharpness + BROAD) / (sharpness.square() * sides)
    return found


def _values(lobes: Lobes, exponent: Tensor, monomials: Tensor) -> tuple[Tensor, Tensor]:
    """Return values and values over z.  Two [F, N, P']."""
    power = torch.matmul(exponent, monomials[..., 1:, :]).clamp_(min=EXPONENT_MIN)
    if lobes.form is not Form.ASG:
        values = power.exp_()
        return values, values
    z = torch.matmul(lobes.axis_z, monomials[..., 1:4, :])
    gaussian = power.masked_fill_(z <= 0, -math.inf).exp_()
    return z.mul_(gaussian), gaussian


def _seen(lobes: Lobes, rows: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return the second moment of a texel about its centre, (I + 2 S T)^-1 and its determinant.

    A texel of a grid of `rows` rows is pi / rows high and pi / rows times cos(latitude) wide.

    Returns:
        T and the inverse, in each lobe's frame [L, F, N, 2, 2], and the determinant [L, F, N].
    """
    sides = [(math.pi / count) ** 2 / 12 for count in rows]
    side = lobes.sharpness.new_tensor(sides)[:, None, None]
    axis_z, axes = lobes.axis_z, lobes.axes[..., :2, :]
    sin2 = axis_z[..., 1].square()
    cos2 = torch.maximum(1 - sin2, 3 * side)  # within a texel of a pole width has no direction
    # along the row, cos(latitude) long: z x y and its parts on axis_x and axis_y
    along = torch.stack([axis_z[..., 2], torch.zeros_like(sin2), -axis_z[..., 0]], dim=-1)
    part = (axes @ along[..., None])[..., 0]
    shorter = (sin2 / cos2)[..., None, None] * part[..., :, None] * part[..., None, :]
    identity = torch.eye(2, dtype=sin2.dtype, device=sin2.device)
    moment = side[..., None, None] * (identity - shorter)
    trace = shorter[..., 0, 0] + shorter[..., 1, 1]
    if lobes.form is Form.SG:  # stays isotropic
        moment = (side * (1 - trace / 2))[..., None, None] * identity
        inverse = 1 / (1 + lobes.sharpness[..., 0] * moment[..., 0, 0])
        return moment, inverse[..., None, None] * identity, inverse.square()
    a, b, c, d = (2 * lobes.sharpness[..., :, None] * moment).flatten(-2).unbind(-1)
    # det T = side^2 (1 - trace): the difference of products would lose it for sharp lobes
    product = 4 * side.square() * lobes.sharpness.prod(-1) * (1 - trace).clamp(min=0)
    determinant = 1 / (1 + a + d + product)
    inverse = torch.stack([1 + d, -b, -c, 1 + a], dim=-1) * determinant[..., None]
    return moment, inverse.unflatten(-1, (2, 2)), determinant


def _exponent(lobes: Lobes, inverse: Tensor, determinant: Tensor) -> Tensor:
    """Return log c - d^T S' d, or for the sg form log c + s' (z - 1).  [L, F, N, 9]."""
    if lobes.form is Form.SG:
        seen = lobes.sharpness[..., 0] * inverse[..., 0, 0]
        square = (determinant.log() / 2 - seen)[..., None] * _one(inverse)
        return torch.cat([seen[..., None] * lobes.axis_z, square], dim=-1)
    across = lobes.axes[..., :2, :]
    square = _monomials(-across.mT @ _sharpness_seen(lobes, inverse) @ across)
    square = square + determinant.log()[..., None] / 2 * _one(inverse)
    return torch.cat([square.new_zeros(*square.shape[:-1], 3), square], dim=-1)


def _sharpness_seen(lobes: Lobes, inverse: Tensor) -> Tensor:
    """Return S' = (I + 2 S T)^-1 S, symmetric.  [L, F, N, 2, 2]."""
    seen = inverse * lobes.sharpness[..., None, :]
    return (seen + seen.mT) / 2


def footprint(lobes: Lobes, rows: Sequence[int]) -> Footprint:
    """Return what leaves of grids of so many rows see of lobes.  [F, N, .]."""
    moment, inverse, determinant = _seen(lobes, rows)
    exponent = _exponent(lobes, inverse, determinant)
    shifted = lobes.sharpness + BROAD
    if lobes.form is Form.SG:
        return Footprint(exponent, _sg_derivatives(lobes, moment, inverse))
    seen = _sharpness_seen(lobes, inverse)
    across, axis_z = lobes.axes[..., :2, :], lobes.axis_z
    # 2 z (S' (x, y)), a product of two directions for each tilt
    towards = 2 * seen @ across  # [L, F, N, 2, 3]
    tilts = towards[..., :, None] * axis_z[..., None, None, :]
    tilts = (tilts + tilts.mT) / 2
    change = lobes.sharpness.new_zeros(*shifted.shape[:-1], 3, 2, 2)  # dS
    change[..., 0, 0, 0], change[..., 1, 1, 1] = shifted.unbind(-1)
    change[..., 2, 0, 1] = change[..., 2, 1, 0] = turn_speed(lobes)
    # dS' = (I + 2 S T)^-1 dS (I + 2 T S)^-1
    sides = inverse.mT @ across  # [L, F, N, 2, 3]
    shapes = -(sides.mT[..., None, :, :] @ change @ sides[..., None, :, :])
    # d log c = -tr((I + 2 T S)^-1 T dS)
    log_peak = -((moment @ inverse)[..., None, :, :] * change.mT).sum((-2, -1))
    log_peak[..., :2] += 0.5  # a width changes at constant flux (coordinates.py)
    shapes = _monomials(shapes) + log_peak[..., None] * _one(moment)
    square = torch.cat([_monomials(tilts), shapes], dim=-2)
    return Footprint(exponent, torch.cat([square.new_zeros(*square.shape[:-1], 3), square], dim=-1))


def _sg_derivatives(lobes: Lobes, moment: Tensor, inverse: Tensor) -> Tensor:
    """Return the derivatives of the sg form, which has one width and no turn.  [L, F, N, 5, 9]."""
    shifted, inverse = lobes.sharpness[..., 0] + BROAD, inverse[..., 0, 0]
    seen = lobes.sharpness[..., 0] * inverse  # s'
    change = shifted * inverse.square()  # ds'
    log_peak = 1 - shifted * moment[..., 0, 0] * inverse  # at constant flux
    found = inverse.new_zeros(*inverse.shape, 5, 9)
    found[..., :2, :3] = seen[..., None, None] * lobes.axes[..., :2, :]
    found[..., 2, :3] = change[..., None] * lobes.axis_z
    found[..., 2, 3:] = (log_peak - change)[..., None] * _one(moment)
    return found


def _one(like: Tensor) -> Tensor:
    """Return 1 as a polynomial of degree 2: x^2 + y^2 + z^2, in the order of POWERS.  [6]."""
    return like.new_tensor([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def _monomials(matrix: Tensor) -> Tensor:
    """Return d^T M d of symmetric M by monomials of degree 2.  [..., 3, 3] -> [..., 6]."""
    xx, xy, xz, _, yy, yz, _, _, zz = matrix.flatten(-2).unbind(-1)
    return torch.stack([xx, 2 * xy, 2 * xz, yy, 2 * yz, zz], dim=-1)


def turn_speed(lobes: Lobes) -> Tensor:
    """Return sx - sy of a lobe that turns, and what stands for it in one that shears.  [..., N]."""
    shifted = lobes.sharpness + BROAD
    difference = lobes.sharpness[..., 0] - lobes.sharpness[..., 1]
    return torch.where(is_round(lobes), shifted.prod(-1).sqrt(), difference)


def scale_slopes(shown: Images, seen: Footprint, places: Leaves) -> Tensor:
    """Return d log scale along the five coordinates.  [F, N, 5].

    Args:
        shown: The lobes on the leaves.
        seen: Their footprint on the leaves' levels.
        places: The leaves.
    """
    share = places.share[:, None]
    mean = (shown.values @ share.mT).clamp(min=torch.finfo(share.dtype).tiny)
    return _scale_slopes(shown.lobes, shown.scale, _shape_slopes(shown, seen, share, places) / mean)


def slopes(
    shown: Images, seen: Footprint, of_scale: Tensor, slope: Tensor, places: Leaves
) -> Tensor:
    """Contract the derivatives of each lobe with the slope of a loss.

    Args:
        shown: The lobes on the leaves.
        seen: Their footprint on the leaves' levels.
        of_scale: Their `scale_slopes`.  [F, N, 5]
        slope: dJ / d radiance.  [F, 3, P]
        places: The leaves.

    Returns:
        dJ along the five coordinates and the three amplitudes of each lobe.  [F, N, 8]
    """
    along = shown.light @ slope  # dJ / d value  [F, N, P]
    shape = _shape_slopes(shown, seen, along, places)
    light = shown.values @ slope.mT * shown.scale[..., None]
    shape += of_scale * (light * shown.lobes.amplitude).sum(-1, keepdim=True)
    return torch.cat([shape, light], dim=-1)


def _shape_slopes(shown: Images, seen: Footprint, along: Tensor, places: Leaves) -> Tensor:
    """Return the slopes of sum along * value along the five coordinates.  [F, N or 1, P]."""
    lobes = shown.lobes
    valued = shown.values * along
    moments = [valued[..., place] @ mono[..., 1:, :].mT for _, mono, place in places.levels]
    shape = (seen.derivatives @ torch.stack(moments)[..., None])[..., 0].sum(0)
    if lobes.form is Form.ASG:
        tilted = shown.gaussian * along
        vector = sum(tilted[..., place] @ mono[..., 1:4, :].mT for _, mono, place in places.levels)
        shape[..., :2] += (lobes.axes[..., :2, :] @ torch.as_tensor(vector)[..., None])[..., 0]
    return shape


def columns(lobes: Lobes, seen: Footprint, level: int, monomials: Tensor) -> Tensor:
    """Return each lobe and its five derivatives as means over leaves of one size, but for `scale`.

    Args:
        lobes: The lobes.  [F, N, .]
        seen: Their footprint.
        level: Which of the footprint's sizes the leaves have.
        monomials: Of the leaves' centres.  [(F,) 10, P']

    Returns:
        Row 6 i is lobe i, rows 6 i + 1 to 6 i + 5 its derivatives.  [F, 6 N, P']
    """
    values, gaussian = _values(lobes, seen.exponent[level], monomials)
    shape = torch.matmul(seen.derivatives[level].flatten(1, 2), monomials[..., 1:, :])
    shape = shape.unflatten(1, (lobes.count, 5)).mul_(values[:, :, None])
    if lobes.form is Form.ASG:
        across = torch.matmul(lobes.axes[..., :2, :].flatten(1, 2), monomials[..., 1:4, :])
        shape[:, :, :2] += across.unflatten(1, (lobes.count, 2)).mul_(gaussian[:, :, None])
    return torch.cat([values[:, :, None], shape], dim=2).flatten(1, 2)


def grid_columns(lobes: Lobes, seen: Footprint, level: int, cells: Grid) -> Tensor:
    """Return `columns` over all cells of a grid, at the scale of the lobes there.

    Args:
        lobes: The lobes.  [F, N, .]
        seen: Their footprint.
        level: Which of the footprint's sizes the cells have.
        cells: The grid.

    Returns:
        Rows as those of `columns`.  [F, 6 N, P']
    """
    found = columns(lobes, seen, level, cells.monomials)
    mean = (found @ cells.share).unflatten(1, (lobes.count, COLUMNS))
    scale = _scale(lobes, mean[..., 0])
    change = mean[..., 1:] / mean[..., :1].clamp(min=torch.finfo(mean.dtype).tiny)
    return _scaled(found, scale, _scale_slopes(lobes, scale, change))


def leaf_columns(
    shown: Images, seen: Footprint, of_scale: Tensor, level: int, monomials: Tensor
) -> Tensor:
    """Return `columns` over the leaves of one size, at the scale of the lobes on all leaves.

    Args:
        shown: The lobes on all leaves.
        seen: Their footprint.
        of_scale: Their `scale_slopes`.  [F, N, 5]
        level: Which of the footprint's sizes the leaves have.
        monomials: Of the leaves' centres.  [(F,) 10, P']

    Returns:
        Rows as those of `columns`.  [F, 6 N, P']
    """
    return _scaled(columns(shown.lobes, seen, level, monomials), shown.scale, of_scale)


def _scaled(found: Tensor, scale: Tensor, of_scale: Tensor) -> Tensor:
    """Multiply columns by a scale that depends on the lobe.  [F, 6 N, P'].

    Args:
        found: The columns, which are changed.  [F, 6 N, P']
        scale: [F, N]
        of_scale: d log scale along the five coordinates.  [F, N, 5]
    """
    found = found.unflatten(1, (scale.shape[-1], COLUMNS))
    found[:, :, 1:] += of_scale[..., None] * found[:, :, :1]
    return found.mul_(scale[..., None, None]).flatten(1, 2)
