# SPDX-License-Identifier: Apache-2.0
"""Where splatting brings a texel's light, from scipy's polynomial interpolation, texel by texel."""

import numpy as np
import scipy.interpolate
import torch
from torch import Tensor

from asglight.sphere import latlong


def along(texel: int, factor: int) -> tuple[int, np.ndarray]:
    """Return the first of five cells around a texel, and the weights of interpolation there."""
    quartics = scipy.interpolate.BarycentricInterpolator(range(-2, 3), np.eye(5))
    return texel // factor - 2, quartics((texel % factor + 0.5) / factor - 0.5)


def of_texels(texels: Tensor, height: int, rows: int) -> Tensor:
    """Return what a radiance of 1 of each texel adds to each cell.  [Q] -> [2 rows^2, Q], float64.

    Cells beyond a pole are those half a turn away.
    """
    factor = height // rows
    fine, coarse = (
        latlong.texel_solid_angles(n, 1, dtype=torch.float64).flatten() / (2 * n)
        for n in (height, rows)
    )
    result = torch.zeros(rows, 2 * rows, len(texels), dtype=torch.float64)
    for index, texel in enumerate(texels.tolist()):
        row, column = divmod(texel, 2 * height)
        (first_row, down), (first, across) = along(row, factor), along(column, factor)
        for k in range(5):
            cell, turn = first_row + k, 0
            if not 0 <= cell < rows:
                cell, turn = (-1 - cell if cell < 0 else 2 * rows - 1 - cell), rows
            for m in range(5):
                place = (first + m + turn) % (2 * rows)
                share = float(fine[row] / coarse[cell])
                result[cell, place, index] += down[k] * across[m] * share
    return result.flatten(0, 1)
