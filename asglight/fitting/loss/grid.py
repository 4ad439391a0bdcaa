# SPDX-License-Identifier: Apache-2.0
"""A latlong grid as the fitter needs it: texel centres, their monomials, and averaging onto cells.

Images are channels first, [..., P], P = H * 2 H texels row by row. Texels are averaged with their
solid angles. Cells are texels of a coarser grid that holds whole blocks of fine ones.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.sphere import latlong

POWERS = tuple(
    (i, j, k)
    for degree in range(3)
    for i in range(degree, -1, -1)
    for j in range(degree - i, -1, -1)
    for k in (degree - i - j,)
)
"""Exponents of the 10 monomials x^i y^j z^k up to degree 2: 1, 3 and 6 of degrees 0 to 2."""


@dataclass(frozen=True)
class Grid:
    """What depends on the grid alone.

    Attributes:
        height: Rows; there are twice as many columns.
        directions: Texel centres.  [P, 3]
        monomials: Of the centres, in the order of `POWERS`.  [10, P]
        share: Solid angle over 4 pi.  [P]
    """

    height: int
    directions: Tensor
    monomials: Tensor
    share: Tensor


@lru_cache(maxsize=16)
@torch.inference_mode(False)
def grid(height: int, device: str = "cpu") -> Grid:
    """Return the grid of a height on a device."""
    directions = latlong.directions(height, 2 * height, dtype=torch.float64).reshape(-1, 3)
    x, y, z = directions.unbind(-1)
    monomials = torch.stack([x**i * y**j * z**k for i, j, k in POWERS])
    share = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64) / (4 * math.pi)
    return Grid(
        height,
        directions.to(device, torch.float32),
        monomials.to(device, torch.float32),
        share.reshape(-1).to(device, torch.float32),
    )


def coarsen(images: Tensor, height: int, coarse: int) -> Tensor:
    """Average images onto a coarser grid, weighted by solid angle.  [..., P] -> [..., P']."""
    if coarse == height:
        return images
    weight = _row_shares(height, coarse, str(images.device)).reshape(-1, 1)
    rows = images.unflatten(-1, (height, 2 * height)) * weight
    return _block_sums(rows, height // coarse)


def cell_sums(images: Tensor, height: int, coarse: int) -> Tensor:
    """Sum images over the texels of each cell.  [..., P] -> [..., P']."""
    return _block_sums(images.unflatten(-1, (height, 2 * height)), height // coarse)


def _block_sums(images: Tensor, factor: int) -> Tensor:
    """Sum over square blocks.  [..., H, W] -> [..., H / factor * W / factor]."""
    along = images.unflatten(-2, (-1, factor)).sum(-2)
    # strided slices: a reduction over so short an inner axis takes three times as long
    return sum((along[..., b::factor] for b in range(1, factor)), along[..., ::factor]).flatten(-2)


def repeated(images: Tensor, coarse: int, height: int) -> Tensor:
    """Give each texel the value of its cell.  [..., P'] -> [..., P]."""
    factor = height // coarse
    cells = images.unflatten(-1, (coarse, 1, 2 * coarse, 1))
    return cells.expand(*cells.shape[:-3], factor, 2 * coarse, factor).flatten(-4)


def coarser(height: int, wanted: int) -> int:
    """Return the rows of the grid nearest to `wanted` whose cells hold whole texels of `height`.

    A finer one than wanted is taken rather than one with less than 3/4 of the rows.
    """
    if height <= wanted:
        return height
    divisors = [rows for rows in range(1, height + 1) if height % rows == 0]
    return min((rows for rows in divisors if rows >= 0.75 * wanted), key=lambda r: abs(r - wanted))


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _row_shares(height: int, coarse: int, device: str) -> Tensor:
    """Return each texel's share of its cell's solid angle, by row.  [coarse, factor]."""
    factor = height // coarse
    rows = latlong.texel_solid_angles(height, 1, dtype=torch.float64).reshape(coarse, factor)
    rows = rows / (factor * rows.sum(-1, keepdim=True))
    return rows.to(device, torch.float32)
