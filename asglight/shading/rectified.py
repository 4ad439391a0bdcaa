# SPDX-License-Identifier: Apache-2.0
"""The rectified normal variable, and through it a Lambertian surface under lobes.

For a light w drawn from a sheet's normalised distribution the cosine n.w has the mean
`m = mean n.axis_z` and the variance `s^2 = n.V n` of the sheet's exact moments. As a normal
variable X of this mean and variance its positive part is

    E[max(X, 0)] = m Phi(m / s) + s phi(m / s),

and irradiance is that times the sheet's integral: exact for narrow lobes of any ratio, at any
elevation. The twin is shaders/lib/rectified.glsl.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.shading.sheets import Sheets

WIDENING = 0.256
"""The deviation is taken `1 + WIDENING s^2` times as large. Of a lobe as wide as a hemisphere n.w
is distributed evenly or as a half circle, with E|X| = 0.866 s or 0.849 s, not 0.798 s as of a
normal variable; this value lies between the two."""

_DEVIATION_MIN = 1e-12
"""Keeps 0/0 out of m/s; the deviation of the sharpest lobe is 2e-4."""


class Rectified(NamedTuple):
    """The positive part of a normal variable.

    Attributes:
        mean: E[max(X, 0)].  [...]
        probability: P(X > 0).  [...]
    """

    mean: Tensor
    probability: Tensor


def rectified(mean: Tensor, deviation: Tensor) -> Rectified:
    """Cut off at 0 a normal variable of a mean and a standard deviation.  [...], [...]."""
    u = mean / deviation.clamp(min=_DEVIATION_MIN)
    probability = torch.special.ndtr(u)
    density = torch.exp(-0.5 * u * u) / math.sqrt(2 * math.pi)
    return Rectified((mean * probability + deviation * density).clamp(min=0), probability)


def widened(deviation: Tensor) -> Tensor:
    """Return the deviation of the normal variable that stands for n.w.  [...]."""
    return deviation * (1 + WIDENING * deviation * deviation)


def cosine(sheets: Sheets, normals: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and standard deviation of n.w over sheets with a dimension of points.

    Args:
        sheets: From `Sheets.over_points`.  [..., M, 1, .]
        normals: Unit.  [..., P, 3]

    Returns:
        Two tensors [..., M, P].
    """
    x, y, z = (sheets.axes @ normals[..., None])[..., 0].unbind(-1)
    vx, vy, vz = sheets.variance.unbind(-1)
    return z * sheets.mean, (x * x * vx + y * y * vy + z * z * vz).sqrt()


def irradiance_over_pi(sheets: Sheets, normals: Tensor) -> Tensor:
    """Return what a white Lambertian surface shows of each sheet of amplitude 1.

    Args:
        sheets: M sheets.  [..., M, .]
        normals: Unit.  [P, 3]

    Returns:
        Irradiance over pi.  [..., M, P]
    """
    mean, deviation = cosine(sheets.over_points(), normals)
    lit = rectified(mean, widened(deviation)).mean
    return sheets.integral[..., None] / math.pi * lit
