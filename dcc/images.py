# SPDX-License-Identifier: Apache-2.0
"""Latlong images as renderers read them: interpolated between texels, on a grid four times as fine.

What UsdLux leaves open: it says where texels lie, and not what is between them. Cycles and Mitsuba
interpolate linearly. Cycles has the first row half a row beside the pole, as UsdLux and OpenEXR,
Mitsuba on the pole.
"""

import functools

import torch
from torch import Tensor

from asglight.sphere import latlong
from dcc.quadrature import ROWS, Light

FINE = 4
"""Points across a texel of the integrals' grid."""

BRIGHT = 50.0
"""Times the mean: what is brighter gets nodes of its own on the fine grid, because texel means
would move a sun by up to half a texel. It covers at most a fiftieth of the sphere."""


def read(
    image: Tensor, directions: tuple[Tensor, Tensor, Tensor], *, on_poles: bool = False
) -> Tensor:
    """Return what a renderer reads in some directions.

    Args:
        image: Texels.  [H, W, 3]
        directions: x, y, z in the image's own axes.  [...] each
        on_poles: Whether the first and last row lie on the poles.

    Returns:
        Radiance.  [..., 3]
    """
    height, width = image.shape[:2]
    u, v = latlong.uv_from_direction(torch.stack(directions, dim=-1))
    y = v * (height - 1) if on_poles else v * height - 0.5
    x = u * width - 0.5
    row, column = y.floor(), x.floor()
    down, right = (y - row)[..., None], (x - column)[..., None]
    left = column.long() % width
    columns = left, (left + 1) % width
    upper, lower = (
        torch.lerp(image[rows, columns[0]], image[rows, columns[1]], right)
        for rows in (row.long().clamp(0, height - 1), (row.long() + 1).clamp(0, height - 1))
    )
    return torch.lerp(upper, lower, down)


def light_of(fine: Tensor) -> Light:
    """Return radiance on the fine grid as a light, its suns as nodes.  [4H, 4W, 3]."""
    weights = latlong.texel_solid_angles(len(fine), 2 * len(fine))[..., None]
    mean = fine.amax(-1)
    most = BRIGHT * (mean * weights[..., 0]).sum() / weights.sum()
    even = fine * (most / mean.clamp(min=1e-30))[..., None].clamp(max=1)
    rest = fine - even
    bright = mean > most
    x, y, z = fine_grid()
    directions = torch.stack([x, y, z], dim=-1).view(*fine.shape[:2], 3)[bright]
    flux = (rest * weights)[bright]
    return Light(texel_means(even), directions.double(), flux.double())


def as_read(image: Tensor, *, on_poles: bool = False) -> Light:
    """Return an image as a light, as `read` reads it.  [H, W, 3]."""
    x, y, z = (axis.view(FINE * ROWS, 2 * FINE * ROWS) for axis in fine_grid())
    return light_of(read(image, (x, y, z), on_poles=on_poles))


@functools.cache
def fine_grid() -> Tensor:
    """Return the directions of the fine grid.  [3, 4H 4W]."""
    size = FINE * ROWS
    return latlong.directions(size, 2 * size).view(-1, 3).mT.contiguous()


def texel_means(fine: Tensor) -> Tensor:
    """Average a grid four times as fine by solid angle.  [4H, 4W, C] -> [H, W, C]."""
    weights = latlong.texel_solid_angles(len(fine), 2 * len(fine))[..., None]
    blocks = (ROWS, FINE, 2 * ROWS, FINE, -1)
    sums = (fine * weights).view(blocks).sum((1, 3))
    return sums.double() / weights.reshape(blocks).sum((1, 3)).double()
