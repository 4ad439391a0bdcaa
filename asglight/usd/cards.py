# SPDX-License-Identifier: Apache-2.0
"""A lobe as a card: the rectangle of constant radiance with the lobe's flux and second moments.

The card lies in the plane z = 1 of the lobe's frame, |x| <= p, |y| <= q, and is seen from the
origin; at another distance it scales. With s = p q / sqrt(1 + p^2 + q^2), integrating over the
plane with dw = dx dy / (1 + x^2 + y^2)^(3/2) gives the closed forms

    solid angle       W = 4 atan s
    mean of x^2       (1 - s / ((1 + p^2) atan s)) / 3, and likewise y^2 with q.

So the mean squares asked for give 1 + p^2 and 1 + q^2 from s alone, and s is a fixed point.
"""

import math

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Form, Lobes
from asglight.usd import schema
from asglight.usd.emission import intensity_and_color

HALF_ANGLE_MAX_DEG = 85.0
"""Widest card; one of 90 degrees would be infinite. Lobes that spread farther keep their flux. Of
diffuse irradiance (RMS over all normals) they lose: bingham 2 % at sharpness 0.01, 15 % where one
sharpness is 0.01 and the other 50; asg under 2 %; sg 26 % at 1, 62 % at 0.01, because half of
such a lobe shines from behind."""

FIXED_POINT_STEPS = 60
"""A step halves the error at least, so 60 leave nothing that float64 can hold."""


def solid_angle(half_extent: Tensor) -> Tensor:
    """Return the solid angle of cards in the plane z = 1, in steradians.

    Args:
        half_extent: (p, q), the tangents of the half-angles.  [..., 2]
    """
    return 4 * torch.atan(_corner(half_extent))


def half_extent(lobes: Lobes) -> Tensor:
    """Return (p, q) of the card with each lobe's mean x^2 and y^2, no wider than the widest card.

    The mean over a card stays below 1/3; a lobe that spreads farther gets the widest card.

    Args:
        lobes: N lobes with any batch shape.  [..., N, .]

    Returns:
        Half width and half height at distance 1, float64.  [..., N, 2]
    """
    zeroth, _, second = asg.moments(lobes.to(torch.float64))
    rest = 1 - 3 * second[..., :2] / zeroth[..., None]  # 1 - 3 mean x^2, 1 - 3 mean y^2
    widest = math.tan(math.radians(HALF_ANGLE_MAX_DEG))
    rest = rest.clamp(min=1 / (1 + widest**2))  # at and below it the card is the widest
    corner = torch.zeros_like(zeroth)
    extent = torch.zeros_like(rest)
    for _ in range(FIXED_POINT_STEPS):
        # s / atan s tends to 1; the clamp avoids 0 / 0 and is exact to 1e-24
        ratio = corner.clamp(min=1e-12) / torch.atan(corner.clamp(min=1e-12))
        extent = (ratio[..., None] / rest - 1).sqrt().clamp(max=widest)
        corner = _corner(extent)
    return extent


def values(lobes: Lobes, distance: float) -> dict[str, Tensor]:
    """Return the RectLight attributes of each lobe, or of each side of a bingham lobe.

    Args:
        lobes: N lobes with any batch shape.  [..., N, .]
        distance: From the origin to the card's centre, in stage units.

    Returns:
        Width, height, intensity [..., N, 1] and colour [..., N, 3], float64.
    """
    lobes = lobes.to(torch.float64)
    extent = half_extent(lobes)
    sides = 2 if lobes.form is Form.BINGHAM else 1
    radiance = asg.flux(lobes) / sides / solid_angle(extent)[..., None]
    intensity, color = intensity_and_color(radiance)
    return {
        schema.WIDTH: 2 * distance * extent[..., :1],
        schema.HEIGHT: 2 * distance * extent[..., 1:],
        schema.INTENSITY: intensity[..., None],
        schema.COLOR: color,
    }


def _corner(half_extent: Tensor) -> Tensor:
    """Return s = p q / sqrt(1 + p^2 + q^2), the tangent of a quarter of the solid angle."""
    return half_extent.prod(-1) / (1 + half_extent.square().sum(-1)).sqrt()
