# SPDX-License-Identifier: Apache-2.0
"""Bringing the light of texels to the centres of coarse cells, so that it stays where it is.

A mean over a cell of 2.8 degrees forgets where in it a lamp stands, and balls show errors of a few
thousandths, which a tenth of a degree makes. Here a texel shares its flux among its own cell and
two to each side, along rows and along columns, by the weights of interpolation through five points,

    w_j(t) = product over m from -2 to 2 but j of (t - m) / (j - m),

t the texel's place and j, m those of the cells' centres. A material that filters the cells then
sees the texel through the quartic through its kernel's values at those centres: at its own place.

Cells are counted row by row. Beyond a pole the rows go on at the other side.
"""

from functools import lru_cache

import torch
from torch import Tensor

REACH = 2
"""Cells to each side of its own that a texel's light reaches: GGX 0.25 is three cells wide, so
a parabola through three of its values would not do."""


@lru_cache(maxsize=16)
@torch.inference_mode(False)
def weights(factor: int, device: str) -> Tensor:
    """Return the weights of the 5 x 5 cells around for each texel of a cell.

    Args:
        factor: Texels along a side of a cell.
        device: Of the result.

    Returns:
        Texels and cells row by row; the weights of a texel sum to 1.  [factor^2, 25]
    """
    places = (torch.arange(factor, dtype=torch.float64) + 0.5) / factor - 0.5
    nodes = _steps("cpu").double()
    powers = torch.arange(len(nodes))[:, None]
    # weights that give back every power up to the fourth are those of interpolation
    along = torch.linalg.solve(nodes**powers, places**powers).mT
    return torch.kron(along, along).to(device, torch.float32)


def neighbours(cells: Tensor, rows: int) -> Tensor:
    """Return the 5 x 5 cells around each cell.

    Args:
        cells: Indices on a grid of `rows` rows.  [F, R]
        rows: At least `REACH`.

    Returns:
        Indices, cell by cell and row by row.  [F, 25 R]
    """
    steps = _steps(cells.device)
    row = (cells // (2 * rows))[..., None] + steps
    beyond = (row < 0) | (row >= rows)
    row = torch.where(row < 0, -1 - row, torch.where(row < rows, row, 2 * rows - 1 - row))
    column = (cells % (2 * rows))[..., None, None] + steps + (beyond * rows)[..., None]
    return (row[..., None] * 2 * rows + column % (2 * rows)).flatten(1)


def _steps(device: torch.device | str) -> Tensor:
    return torch.arange(-REACH, REACH + 1, device=device)
