# SPDX-License-Identifier: Apache-2.0
"""The light of a key as an image on its card, rectified: without the map's distortion.

A texel of the image is the mean of what lies there in the map, whose texels are taken as the
squares that they are. The image is weighted by the solid angles of its texels on the card: with a
mean of 1, a card has the flux that it has without.

Symbols: M, N rows and columns of the image; H, W of the map.
"""

import math

import numpy as np
import torch
from torch import Tensor

from asglight.keys.rectangles import Card
from asglight.sphere import latlong

PER_TEXEL = (8, 32)
"""Texels of the image for one of the map, each way, at least and at most: edges of texels are off
by a sixteenth of one, and those of a sun, all of which is edges, by a quarter of that."""

USUAL = 256
"""Texels of a side between these."""

SIDE = (16, 512)
"""Least and most texels of a side."""

NARROWEST = 0.1
"""Width of the map's texels over their height, beside a pole, below which the image follows no
more: at 84 degrees."""

POINTS = 3
"""Points in a texel of the image, each way, that its mean is taken over."""


def size(card: Card, height: int) -> tuple[int, int]:
    """Return rows and columns of a card's image.

    Args:
        card: The card.
        height: Rows of the map.
    """
    corners = card.corners()
    reach = float(np.arccos(np.clip(corners @ card.middle, -1, 1)).max())
    latitude = min(abs(math.asin(max(-1.0, min(1.0, card.middle[1])))) + reach, math.pi / 2)
    texel = math.pi / height * max(math.cos(latitude), NARROWEST)
    p, q = card.seen_extent
    high, wide = (_side(2 * math.atan(e) / texel) for e in (q, p))
    return high, wide


def _side(texels: float) -> int:
    """Return the texels of a side that is so many of the map's."""
    low, high = PER_TEXEL
    count = texels * min(max(USUAL / texels, low), high)
    return int(min(max(math.ceil(count), SIDE[0]), SIDE[1]))


def rectified(card: Card, shape: tuple[int, int], light: Tensor, first_row: int) -> Tensor:
    """Return the image of a key's light on its card.

    As UsdLux has it, the first texel of the first row is at (+x, +y).

    Args:
        card: The card.
        shape: M, N.
        light: Radiance that the key takes from some rows of the map.  [rows, W, 3]
        first_row: The first of them.

    Returns:
        Of mean 1 in each channel, weighted by solid angle; 1 where there is no light.  [M, N, 3]
    """
    rows, columns = shape
    y = 1 - 2 * (torch.arange(rows * POINTS, dtype=torch.float64) + 0.5) / (rows * POINTS)
    x = 1 - 2 * (torch.arange(columns * POINTS, dtype=torch.float64) + 0.5) / (columns * POINTS)
    y, x = torch.meshgrid(y, x, indexing="ij")
    directions = card.rectangle.points(x.flatten(), y.flatten()).view(*x.shape, 3)
    width = light.shape[1]
    u, v = latlong.uv_from_direction(directions)
    row = (v * width / 2).long() - first_row
    column = (u * width).long() % width
    inside = (row >= 0) & (row < len(light))
    values = light[row.clamp(0, len(light) - 1), column] * inside[..., None]
    solid = directions.norm(dim=-1) ** -3  # and the same factor everywhere
    weighted = (values.double() * solid[..., None]).view(rows, POINTS, columns, POINTS, 3)
    weight = solid.view(rows, POINTS, columns, POINTS).sum((1, 3))[..., None]
    image = weighted.sum((1, 3)) / weight
    mean = (image * weight).sum((0, 1)) / weight.sum()
    return torch.where(mean > 0, image / torch.where(mean > 0, mean, 1.0), 1.0).float()
