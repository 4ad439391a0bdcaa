# SPDX-License-Identifier: Apache-2.0
"""A lobe as a distant light: a round disc in the sky with the lobe's irradiance and spread.

A normalised DistantLight gives a patch that faces it the irradiance `intensity`, whatever `angle`
says (UsdLux); angle is the disc's diameter.
"""

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Form, Lobes
from asglight.usd import schema
from asglight.usd.emission import intensity_and_color


def facing_irradiance(lobes: Lobes) -> Tensor:
    """Return the irradiance on a patch that faces each lobe: the integral of z over z > 0.

    asg: the first moment. bingham: one side's, which is the integral of the asg of the same
    sharpness. sg: 2 pi (s - 1 + exp(-s)) / s^2, by parts.

    Returns:
        Linear RGB, not divided by pi, float64.  [..., N, 3]
    """
    lobes = lobes.to(torch.float64)
    if lobes.form is Form.SG:
        unit = _sg_facing(lobes.sharpness[..., 0])
    elif lobes.form is Form.BINGHAM:
        unit = asg.integral(Lobes(lobes.axes, lobes.sharpness, lobes.amplitude, Form.ASG))
    else:
        unit = asg.moments(lobes).first
    return lobes.amplitude * unit[..., None]


def angle_deg(lobes: Lobes) -> Tensor:
    """Return the diameter of the disc whose mean x^2 + y^2 is each lobe's, in degrees.

    Over a disc of angular radius t, mean x^2 + y^2 = m = 1 - (1 + cos t + cos^2 t) / 3, so
    sin^2(t / 2) = 3 m / (3 + sqrt(9 - 12 m)). m = 2/3 is the hemisphere, the widest disc.

    Returns:
        Degrees in [0, 180], float64.  [..., N]
    """
    zeroth, _, second = asg.moments(lobes.to(torch.float64))
    spread = (second[..., :2].sum(-1) / zeroth).clamp(max=2 / 3)
    # rounding may leave 9 - 12 m a hair below 0 at the hemisphere
    sine_squared = 3 * spread / (3 + (9 - 12 * spread).clamp(min=0).sqrt())
    return torch.rad2deg(4 * torch.asin(sine_squared.sqrt())).clamp(max=180)


def values(lobes: Lobes) -> dict[str, Tensor]:
    """Return the DistantLight attributes of each lobe, or of each side of a bingham lobe.

    Returns:
        Angle, intensity [..., N, 1] and colour [..., N, 3], float64.
    """
    intensity, color = intensity_and_color(facing_irradiance(lobes))
    return {
        schema.ANGLE: angle_deg(lobes)[..., None],
        schema.INTENSITY: intensity[..., None],
        schema.COLOR: color,
    }


def _sg_facing(s: Tensor) -> Tensor:
    small = s < 0.05  # there s - 1 + exp(-s) cancels; the series is exact to 1e-10
    safe = torch.where(small, 1.0, s)
    closed = (safe + torch.expm1(-safe)) / safe.square()
    series = 1 / 2 - s * (1 / 6 - s * (1 / 24 - s * (1 / 120 - s * (1 / 720 - s / 5040))))
    return 2 * torch.pi * torch.where(small, series, closed)
