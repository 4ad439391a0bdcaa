# SPDX-License-Identifier: Apache-2.0
"""Non-linear Haar wavelets on a cube map: only the coefficients that matter most are kept.

[Ng, Ramamoorthi and Hanrahan 2003, "All-frequency shadows using non-linear wavelet lighting
approximation", ACM Transactions on Graphics 22(3), SIGGRAPH]. Each face has a two-dimensional Haar
transform of its own (non-standard: rows and columns in turn), orthonormal over its texels. Which
coefficients are kept depends on the map, so each costs its index and RGB. They are ranked by
amplitude times area of support, that is, by the light that they move from one half to the other:
ranked by their square alone, all go to a lamp (of 30, on `esplanade` at 128 rows, a third of the
flux is lost, against 7 %).

A reconstruction is blocky and may be negative beside a lamp.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.peers import cube

FLOATS = 4
"""Of a coefficient: its index and RGB."""

TEXELS_MAX = 64
"""Along an edge of a face, as in the paper; smaller maps take a quarter of their rows."""


@dataclass(frozen=True)
class WaveletCube:
    """A cube map by some of its wavelet coefficients.

    Attributes:
        size: S, texels along an edge.
        index: Place of each coefficient in [6, S, S], flattened.  [K]
        values: The coefficients.  [K, 3]
    """

    size: int
    index: Tensor
    values: Tensor

    @property
    def floats(self) -> int:
        """Numbers that it takes to store this."""
        return FLOATS * len(self.index)

    def faces(self) -> Tensor:
        """Return the cube map.  [6, S, S, 3]."""
        coefficients = torch.zeros(6 * self.size**2, 3, dtype=torch.float64)
        coefficients[self.index] = self.values
        return inverse(coefficients.reshape(6, self.size, self.size, 3))

    def texel_means(self, height: int, width: int) -> Tensor:
        """Return the mean radiance over each texel of a latlong grid.  [H, W, 3]."""
        return cube.to_latlong(self.faces(), height, width).float()


def fit(reference: Tensor, floats: int) -> WaveletCube:
    """Keep as many coefficients as the budget holds.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        floats: Budget, 4 or more.
    """
    size = min(TEXELS_MAX, 2 ** int(math.log2(max(reference.shape[0] / 4, 1))))
    coefficients = forward(cube.from_latlong(reference, size)).flatten(0, 2)
    rank = coefficients.norm(dim=-1) * supports(size).sqrt().repeat(6)
    index = rank.argsort(descending=True)[: floats // FLOATS]
    return WaveletCube(size, index, coefficients[index])


def forward(faces: Tensor) -> Tensor:
    """Return the Haar coefficients of each face.

    Coefficient (0, 0) is the mean times S; the three wavelets of a block of edge S / n lie in the
    quadrants of [0, 2 n) x [0, 2 n) other than the first.

    Args:
        faces: Radiance.  [6, S, S, C]

    Returns:
        Coefficients.  [6, S, S, C]
    """
    result = faces.clone()
    edge = faces.shape[1]
    while edge > 1:
        block = result[:, :edge, :edge]
        even, odd = block[:, 0::2], block[:, 1::2]
        rows = torch.cat([even + odd, even - odd], dim=1)
        even, odd = rows[:, :, 0::2], rows[:, :, 1::2]
        result[:, :edge, :edge] = torch.cat([even + odd, even - odd], dim=2) / 2
        edge //= 2
    return result


def inverse(coefficients: Tensor) -> Tensor:
    """Return the faces of Haar coefficients: `forward` undone.  [6, S, S, C]."""
    result = coefficients.clone()
    edge = 1
    while edge < coefficients.shape[1]:
        edge *= 2
        block = result[:, :edge, :edge]
        sums, differences = block[:, :, : edge // 2], block[:, :, edge // 2 :]
        rows = torch.stack([sums + differences, sums - differences], dim=3).flatten(2, 3)
        sums, differences = rows[:, : edge // 2], rows[:, edge // 2 :]
        both = torch.stack([sums + differences, sums - differences], dim=2).flatten(1, 2)
        result[:, :edge, :edge] = both / 2
    return result


def supports(size: int) -> Tensor:
    """Return the area of each wavelet of a face, in texels.  [S * S]."""
    place = torch.arange(size).clamp(min=1).double()
    level = torch.maximum(place[:, None], place[None, :]).log2().floor()  # [S, S]
    return (4.0 ** (math.log2(size) - level)).flatten()
