# SPDX-License-Identifier: Apache-2.0
"""What adaptive cells of one size see of lobes: polynomials in direction, and their derivatives.

The mean of a Gaussian over a texel is, to second order in the texel's size, a wider Gaussian: the
texel's own second moment T adds to the lobe's covariance. With S = diag(sx, sy) in the lobe's frame
it has the sharpness matrix S' = (S^-1 + 2 T)^-1 and the peak c = det(I + 2 S T)^-1/2. So one
formula serves adaptive cells of any size and lobes of any width, and a lobe narrower than a cell
still has a slope there. T is held in the derivatives. A flat lobe is seen as its terms
(lobes/flat.py).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting.loss import constants
from asglight.fitting.loss.coordinates import BROAD, is_round
from asglight.lobes import Form, Lobes, flat


@dataclass(frozen=True)
class Footprint:
    """Lobes as adaptive cells of L sizes see them: polynomials in the monomials of degree 1 and 2.

    Attributes:
        exponent: Of the value over z: log c - d^T S' d.  [L, F, N, 9]
        derivatives: Of the value over the value, along the five coordinates; for the asg form less
            the tilts of z.  [L, F, N, 5, 9]
    """

    exponent: Tensor
    derivatives: Tensor


@dataclass(frozen=True)
class Seen:
    """Lobes as adaptive cells of L sizes see them, in each lobe's frame.

    Attributes:
        moment: T, the second moment of a texel about its centre.  [L, F, N, 2, 2]
        sharpness: S'.  [L, F, N, 2, 2]
        log_peak: log c.  [L, F, N]
    """

    moment: Tensor
    sharpness: Tensor
    log_peak: Tensor


def as_seen(lobes: Lobes, rows: Sequence[int]) -> Seen:
    """Return how adaptive cells of grids of so many rows see lobes.  [F, N, .].

    A texel of a grid of `rows` rows is pi / rows high and pi / rows times cos(latitude) wide.
    """
    sides = [(math.pi / count) ** 2 / 12 for count in rows]
    side = constants.like(lobes.sharpness, *sides)[:, None, None]
    up_x, up_y, up_z = lobes.axes[..., 1].unbind(-1)  # of the axes, towards the pole
    sin2 = up_z.square()
    cos2 = torch.maximum(1 - sin2, 3 * side)  # within a texel of a pole width has no direction
    shorter = sin2 / cos2  # T = side (I - shorter p p^T), p = (up_y, -up_x) along the row
    trace = shorter * (1 - sin2)
    if lobes.form is Form.SG:  # stays isotropic
        moment = side * (1 - trace / 2)
        inverse = 1 / (1 + lobes.sharpness[..., 0] * moment)
        identity = torch.eye(2, dtype=sin2.dtype, device=sin2.device)
        sharpness = lobes.sharpness[..., 0] * inverse
        moment, sharpness = (each[..., None, None] * identity for each in (moment, sharpness))
        return Seen(moment, sharpness, inverse.log())
    xx, yy = side * (1 - shorter * up_y.square()), side * (1 - shorter * up_x.square())
    xy = side * shorter * up_x * up_y
    # S' = (S^-1 + 2 T)^-1 and c^2 = det S' / det S
    width_x, width_y = (1 / lobes.sharpness).unbind(-1)
    whole = width_x * width_y
    # det T = side^2 (1 - trace): the difference of products would lose it for sharp lobes
    product = 4 * side.square() * (1 - trace).clamp(min=0)
    determinant = whole + 2 * (width_x * yy + width_y * xx) + product
    cross = -2 * xy
    adjugate = torch.stack([width_y + 2 * yy, cross, cross, width_x + 2 * xx], dim=-1)
    return Seen(
        torch.stack([xx, xy, xy, yy], dim=-1).unflatten(-1, (2, 2)),
        (adjugate / determinant[..., None]).unflatten(-1, (2, 2)),
        (whole / determinant).log() / 2,
    )


def exponents(lobes: Lobes, found: Seen) -> Tensor:
    """Return log c - d^T S' d, or for the sg form log c + s' (z - 1).  [L, F, N, 9].

    Args:
        lobes: The lobes.  [F, N, .]
        found: How they are seen.
    """
    if lobes.form is Form.SG:
        sharpness = found.sharpness[..., 0, 0]
        square = (found.log_peak - sharpness)[..., None] * _one(sharpness)
        return torch.cat([sharpness[..., None] * lobes.axis_z, square], dim=-1)
    across = lobes.axes[..., :2, :]
    square = found.log_peak[..., None] * _one(across)
    square = square - _monomials(across.mT @ found.sharpness @ across)
    return torch.nn.functional.pad(square, (3, 0))


def footprint(lobes: Lobes, rows: Sequence[int]) -> Footprint:
    """Return what adaptive cells of grids of so many rows see of lobes.  [F, N, .].

    Of the form flat, what they see of the terms: N is three times as large.
    """
    if lobes.form is Form.FLAT:
        lobes = flat.terms(lobes)
    found = as_seen(lobes, rows)
    exponent = exponents(lobes, found)
    if lobes.form is Form.SG:
        return Footprint(exponent, _sg_derivatives(lobes, found))
    # Each is a product of two directions: a tilt's 2 z (S' (x, y)), those of widths and turn what
    # they make of dS' = (I + 2 S T)^-1 dS (I + 2 T S)^-1 = S' S^-1 dS S^-1 S'.
    towards = found.sharpness @ lobes.axes[..., :2, :]  # [L, F, N, 2, 3]
    sides = towards / lobes.sharpness[..., None]
    speed = -torch.cat([lobes.sharpness + BROAD, 2 * turn_speed(lobes)[..., None]], dim=-1)
    one = torch.cat([towards, sides, sides[..., :1, :]], dim=-2)  # [L, F, N, 5, 3]
    tilted = (2 * lobes.axis_z)[..., None, :].expand_as(towards)
    shaped = torch.cat([sides, sides[..., 1:, :]], dim=-2) * speed[..., None]
    other = torch.cat([tilted, shaped], dim=-2)
    derivatives = _monomials(one[..., :, None] * other[..., None, :])
    # d log c = -tr(T (I + 2 S T)^-1 dS), and a width changes at constant flux (coordinates.py)
    inverse = found.sharpness / lobes.sharpness[..., None, :]  # (I + 2 S T)^-1
    xx, xy, _, yy = (found.moment @ inverse).flatten(-2).unbind(-1)
    log_peak = speed * torch.stack([xx, yy, xy], dim=-1) + constants.like(xx, 0.5, 0.5, 0.0)
    derivatives[..., 2:, :] += log_peak[..., None] * _one(xx)
    return Footprint(exponent, torch.nn.functional.pad(derivatives, (3, 0)))


def _sg_derivatives(lobes: Lobes, found: Seen) -> Tensor:
    """Return the derivatives of the sg form, which has one width and no turn.  [L, F, N, 5, 9]."""
    sharpness, moment = found.sharpness[..., 0, 0], found.moment[..., 0, 0]  # s', T
    shifted, inverse = lobes.sharpness[..., 0] + BROAD, sharpness / lobes.sharpness[..., 0]
    change = shifted * inverse.square()  # ds'
    log_peak = 1 - shifted * moment * inverse  # at constant flux
    result = inverse.new_zeros(*inverse.shape, 5, 9)
    result[..., :2, :3] = sharpness[..., None, None] * lobes.axes[..., :2, :]
    result[..., 2, :3] = change[..., None] * lobes.axis_z
    result[..., 2, 3:] = (log_peak - change)[..., None] * _one(sharpness)
    return result


def _one(like: Tensor) -> Tensor:
    """Return 1 as a polynomial of degree 2: x^2 + y^2 + z^2, in the order of POWERS.  [6]."""
    return constants.like(like, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0)


def _monomials(matrix: Tensor) -> Tensor:
    """Return d^T M d by monomials of degree 2.  [..., 3, 3] -> [..., 6]."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix.flatten(-2).unbind(-1)
    return torch.stack([xx, xy + yx, xz + zx, yy, yz + zy, zz], dim=-1)


def turn_speed(lobes: Lobes) -> Tensor:
    """Return sx - sy of a lobe that turns, and what stands for it in one that shears.  [..., N]."""
    shifted = lobes.sharpness + BROAD
    difference = lobes.sharpness[..., 0] - lobes.sharpness[..., 1]
    return torch.where(is_round(lobes), shifted.prod(-1).sqrt(), difference)
