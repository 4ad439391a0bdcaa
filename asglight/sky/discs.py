# SPDX-License-Identifier: Apache-2.0
"""Small discs on the latlong grid by area coverage, so that no flux is lost or flickers.

A disc is covered by points of equal solid angle (Vogel's sunflower, mapped to the spherical cap
with equal areas). Each point gives its share to the texel that it lies in; the shares sum to the
whole whatever the texel size, also where the disc is a fraction of a texel.
"""

import math

import torch
from torch import Tensor

from asglight.sphere import latlong

_POINTS_MIN = 4096
"""The share of a texel that an edge of the disc crosses is then right to about 0.1 % of the disc:
the error of a well-spread set is about points^(-3/4)."""

_POINTS_PER_TEXEL = 256
"""Large discs: the inside of the disc is even to about one percent."""

_GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def cap_points(centre: Tensor, radius: float, count: int) -> tuple[Tensor, Tensor]:
    """Spread points evenly over a spherical cap.

    Args:
        centre: Unit direction, float64.  [3]
        radius: Angular radius, radians.
        count: Number of points P.

    Returns:
        Unit directions [P, 3], and each point's distance from the centre as a share of the radius
        in equal-area measure, in (0, 1).  [P]
    """
    index = torch.arange(count, dtype=torch.float64)
    share = (index + 0.5) / count
    # 1 - cos(angle), written without cancellation, is proportional to the area.
    one_minus_cos = share * 2 * math.sin(radius / 2) ** 2
    sine = (one_minus_cos * (2 - one_minus_cos)).sqrt()
    turn = index * _GOLDEN_ANGLE
    helper = torch.eye(3, dtype=torch.float64)[int(centre.abs().argmin())]
    axis_x = torch.linalg.cross(helper, centre)
    axis_x = axis_x / axis_x.norm()
    axis_y = torch.linalg.cross(centre, axis_x)
    points = (
        (sine * torch.cos(turn))[:, None] * axis_x
        + (sine * torch.sin(turn))[:, None] * axis_y
        + (1 - one_minus_cos)[:, None] * centre
    )
    return points, share.sqrt()


def point_count(radius: float, height: int) -> int:
    """Return how many points a disc needs on a grid of this many rows."""
    solid_angle = 2 * math.pi * (1 - math.cos(radius))
    texel = (math.pi / height) ** 2  # at the equator, where it is largest
    return max(_POINTS_MIN, math.ceil(_POINTS_PER_TEXEL * solid_angle / texel))


def deposit(points: Tensor, flux: Tensor, height: int) -> Tensor:
    """Turn the flux of points into the radiance of texels.

    Args:
        points: Unit directions, float64.  [P, 3]
        flux: What each point carries, in radiance times steradians.  [P, 3]
        height: Rows of the map; it has twice as many columns.

    Returns:
        Radiance whose integral over the sphere is the sum of the flux.  [H, 2 H, 3]
    """
    width = 2 * height
    u, v = latlong.uv_from_direction(points)
    row = (v * height).long().clamp(0, height - 1)
    column = (u * width).long().clamp(0, width - 1)
    total = torch.zeros(height * width, 3, dtype=flux.dtype)
    total.index_add_(0, row * width + column, flux)
    solid_angles = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    return total.view(height, width, 3) / solid_angles[..., None]
