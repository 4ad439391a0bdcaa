# SPDX-License-Identifier: Apache-2.0
"""What leaves of one size see of lobes: the value and its derivatives as polynomials in direction.

The mean of a Gaussian over a texel is, to second order in the texel's size, a wider Gaussian: the
texel's own second moment T adds to the lobe's covariance. With S = diag(sx, sy) in the lobe's frame
it has the sharpness matrix S' = (I + 2 S T)^-1 S and the peak c = det(I + 2 S T)^-1/2. So one
formula serves leaves of any size and lobes of any width, and a lobe narrower than a cell still has
a slope there. T is held in the derivatives. A flat lobe is seen as its terms (lobes/flat.py).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting import constants
from asglight.fitting.coordinates import BROAD, is_round
from asglight.lobes import Form, Lobes, flat


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


def seen_moments(lobes: Lobes, rows: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Return the second moment of a texel about its centre, (I + 2 S T)^-1 and its determinant.

    A texel of a grid of `rows` rows is pi / rows high and pi / rows times cos(latitude) wide.

    Returns:
        T and the inverse, in each lobe's frame [L, F, N, 2, 2], and the determinant [L, F, N].
    """
    sides = [(math.pi / count) ** 2 / 12 for count in rows]
    side = constants.like(lobes.sharpness, *sides)[:, None, None]
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


def exponents(lobes: Lobes, inverse: Tensor, determinant: Tensor) -> Tensor:
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
    """Return what leaves of grids of so many rows see of lobes.  [F, N, .].

    Of the form flat, what they see of the terms: N is three times as large.
    """
    if lobes.form is Form.FLAT:
        lobes = flat.terms(lobes)
    moment, inverse, determinant = seen_moments(lobes, rows)
    exponent = exponents(lobes, inverse, determinant)
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
    return constants.like(like, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0)


def _monomials(matrix: Tensor) -> Tensor:
    """Return d^T M d of symmetric M by monomials of degree 2.  [..., 3, 3] -> [..., 6]."""
    xx, xy, xz, _, yy, yz, _, _, zz = matrix.flatten(-2).unbind(-1)
    return torch.stack([xx, 2 * xy, 2 * xz, yy, 2 * yz, zz], dim=-1)


def turn_speed(lobes: Lobes) -> Tensor:
    """Return sx - sy of a lobe that turns, and what stands for it in one that shears.  [..., N]."""
    shifted = lobes.sharpness + BROAD
    difference = lobes.sharpness[..., 0] - lobes.sharpness[..., 1]
    return torch.where(is_round(lobes), shifted.prod(-1).sqrt(), difference)
