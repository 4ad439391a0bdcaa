# SPDX-License-Identifier: Apache-2.0
"""Which texels of a latlong a texel of a coarser one covers, in numpy alone.

What decodes images reduces them too, and loads no torch. `latlong.reduce` is the same on whole maps
in torch.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Overlap:
    """Intervals that cover the same line twice, finely and coarsely.

    Attributes:
        first: The first fine interval that each coarse one touches.  [T]
        shares: Of each coarse interval, what part of it that one and the following ones cover; 0
            beyond its end. Rows sum to 1.  [T, K]
    """

    first: NDArray[np.int64]
    shares: NDArray[np.float64]


def row_solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Return the exact solid angle of a texel of each row, in steradians.  [H]."""
    return 2 * math.pi / width * np.diff(_band_edges(height))


def rows(source: int, target: int) -> Overlap:
    """Return the overlap of rows, weighted by solid angle.

    Args:
        source: Rows of a map.
        target: Rows of the coarser one, at most as many.
    """
    return _overlap_of_edges(_band_edges(source), _band_edges(target))


def columns(source: int, target: int) -> Overlap:
    """Return the overlap of columns: as `rows`, of equal intervals of longitude."""
    return _overlap_of_edges(np.linspace(0, 1, source + 1), np.linspace(0, 1, target + 1))


def _band_edges(height: int) -> NDArray[np.float64]:
    """Return -sin(latitude) of the row edges, ascending from -1: equal steps are equal areas."""
    return -np.cos(np.linspace(0, math.pi, height + 1))


def _overlap_of_edges(source: NDArray[np.float64], target: NDArray[np.float64]) -> Overlap:
    """Return the overlap of intervals given by their edges, which are regular in some measure."""
    fine, coarse = len(source) - 1, len(target) - 1
    assert coarse <= fine, (coarse, fine)
    # In whole numbers: an edge of both must not be two edges because of rounding.
    ordinal = np.arange(coarse)
    first = ordinal * fine // coarse
    most = int((-(-(ordinal + 1) * fine // coarse) - first).max())
    first = np.minimum(first, fine - most)
    places = first[:, None] + np.arange(most)  # [T, K]
    low = np.maximum(source[places], target[:-1, None])
    high = np.minimum(source[places + 1], target[1:, None])
    covered = np.clip(high - low, 0, None)
    return Overlap(first, covered / covered.sum(axis=1, keepdims=True))
