# SPDX-License-Identifier: Apache-2.0
"""Local coordinates of a lobe, in which the fit has no singular point.

tilt     axis_z turns by (t_x, t_y) towards axis_x, axis_y
widths   s + 1/2 grows by a factor exp(e): like log s for narrow lobes, like s itself for broad
ones, on which log s has no influence. The amplitude grows with sqrt((sx + 1/2) (sy + 1/2)), so that
a lobe that narrows keeps its flux: a sun's light and width would otherwise have to change together
turn     a long lobe's frame turns about axis_z by an angle; a round one, which has no preferred
axis, shears: D^1/2 exp([[0, e], [e, 0]]) D^1/2 with D = diag(sx + 1/2, sy + 1/2)
light    the RGB amplitude, linear and never below 0
"""

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import orthonormal

UNKNOWNS = 8
"""Five of the shape and three of the amplitude."""

BROAD = 0.5
"""The 1/2 of s + 1/2: the sharpness at which a lobe is about as wide as the hemisphere allows."""

TILT_MAX_WIDTHS = 1.0
"""A step turns a lobe by at most its own width: beyond it the linear model says nothing."""

TILT_MAX = 0.5
"""Radians, for lobes broader than that."""

SHAPE_MAX = 1.0
"""A step changes a width's s + 1/2 by at most a factor e, and turns by at most a radian."""

ROUND_RATIO = 2.6
"""(sx + 1/2) / (sy + 1/2) up to which a lobe shears instead of turning: there both coordinates
move the lobe equally fast, |sx - sy| = sqrt((sx + 1/2) (sy + 1/2))."""


def is_round(lobes: Lobes) -> Tensor:
    """Tell which lobes shear instead of turning.  [..., N]."""
    shifted = lobes.sharpness + BROAD
    return shifted.amax(-1) < ROUND_RATIO * shifted.amin(-1)


def sharpness_max(form: Form, width_min: float) -> float:
    """Return the largest sharpness of lobes no narrower than a sigma, radians."""
    if width_min <= 0:
        return asg.SHARPNESS_MAX
    return min(asg.SHARPNESS_MAX, 1 / (asg.per_variance(form) * width_min**2))


def advance(lobes: Lobes, step: Tensor, width_min: float = 0.0) -> Lobes:
    """Move lobes by a step in local coordinates, within its trust bounds.

    Args:
        lobes: The lobes.  [..., N, .]
        step: Tilts, widths, turn, light.  [..., N, 8]
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    limit = sharpness_max(lobes.form, width_min)
    step = step.to(lobes.axes.dtype)
    tilt, shape, light = step[..., :2], step[..., 2:5], step[..., 5:]
    widths = asg.per_variance(lobes.form) * lobes.sharpness
    bound = (TILT_MAX_WIDTHS * widths.clamp(min=1e-6).rsqrt()).clamp(max=TILT_MAX)
    tilt = torch.maximum(torch.minimum(tilt, bound), -bound)
    shape = shape * (SHAPE_MAX / shape.abs().amax(-1, keepdim=True).clamp(min=SHAPE_MAX))
    axis_z = lobes.axis_z + tilt[..., :1] * lobes.axis_x + tilt[..., 1:] * lobes.axis_y
    sharpness, axis_x = _reshape(lobes, shape)
    axes = orthonormal(torch.stack([axis_x, lobes.axis_y, axis_z], dim=-2))
    sharpness = sharpness.clamp(min=asg.SHARPNESS_MIN, max=limit)
    amplitude = (lobes.amplitude + light).clamp(min=0) * concentration(lobes, sharpness)
    return Lobes(axes, sharpness, amplitude, lobes.form)


def concentration(lobes: Lobes, sharpness: Tensor) -> Tensor:
    """Return by how much a lobe of other widths is brighter at the same flux, nearly.  [..., N, 1].

    The flux of a narrow lobe is its amplitude over sqrt(sx sy); s + 1/2 stands for s here as well.
    """
    ratio = (sharpness + BROAD) / (lobes.sharpness + BROAD)
    if lobes.form is Form.SG:
        return ratio[..., :1]
    return ratio.prod(-1, keepdim=True).sqrt()


def _reshape(lobes: Lobes, shape: Tensor) -> tuple[Tensor, Tensor]:
    """Apply width changes and the turn; return the new sharpnesses and axis_x."""
    shifted = lobes.sharpness + BROAD
    if lobes.form is Form.SG:
        return shifted * shape[..., :1].exp() - BROAD, lobes.axis_x
    sheared, shear_angle = _shear(shifted, shape)
    round_ = is_round(lobes)
    angle = torch.where(round_, shear_angle, shape[..., 2])[..., None]
    sharpness = torch.where(round_[..., None], sheared, shifted * shape[..., :2].exp())
    return sharpness - BROAD, angle.cos() * lobes.axis_x + angle.sin() * lobes.axis_y


def _shear(shifted: Tensor, shape: Tensor) -> tuple[Tensor, Tensor]:
    """Apply widths and shear to s + 1/2 as a matrix D^1/2 exp(E) D^1/2.

    With p the mean and d half the difference of E's diagonal, r beside it and q^2 = d^2 + r^2,
    exp(E) = e^p (cosh q I + sinh q / q [[d, r], [r, -d]]).

    Returns:
        Its eigenvalues, x staying nearest to x [..., N, 2], and the angle of that x [..., N].
    """
    first, second, r = shape.unbind(-1)
    p, d = (first + second) / 2, (first - second) / 2
    q = (d * d + r * r).sqrt().clamp(min=1e-12)  # sinh q / q is 1 there
    even, odd = p.exp() * q.cosh(), p.exp() * q.sinh() / q
    sx, sy = shifted.unbind(-1)
    a, c, b = sx * (even + odd * d), sy * (even - odd * d), (sx * sy).sqrt() * odd * r
    half = (a - c) / 2
    radius = (half * half + b * b).sqrt() * torch.where(half < 0, -1.0, 1.0).to(half)
    values = torch.stack([(a + c) / 2 + radius, (a + c) / 2 - radius], dim=-1)
    return values, 0.5 * torch.atan(b / torch.where(half == 0, torch.finfo(b.dtype).tiny, half))
