# SPDX-License-Identifier: Apache-2.0
"""Cube maps, and the way between them and latlong maps that keeps the flux.

A latlong texel is cut into 4 x 4 points, each with its share of the texel's solid angle; a point
belongs to the cube texel that it lies in. Averaging either way uses the same points, so the flux
of the one map is the flux of the other.

Symbols: S texels along an edge of a face; faces are +X, -X, +Y, -Y, +Z, -Z.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.sphere import latlong

POINTS = 4
"""Along an edge of a latlong texel: a cube texel of twice its size then holds about 64 points."""


@dataclass(frozen=True)
class Points:
    """The points of a latlong grid and where they lie on a cube.

    Attributes:
        texel: Index of the cube texel, (face S + row) S + column.  [H POINTS, W POINTS]
        solid_angle: Of each point.  [H POINTS, W POINTS]
    """

    texel: Tensor
    solid_angle: Tensor


def cube_texel(directions: Tensor, size: int) -> Tensor:
    """Return the index of the cube texel that each direction meets.  [..., 3] -> [...].

    The face is that of the largest component; the others over it run from -1 to 1.
    """
    largest = directions.abs().argmax(-1, keepdim=True)
    length = directions.gather(-1, largest)
    across = directions.gather(-1, (largest + 1) % 3) / length.abs()
    down = directions.gather(-1, (largest + 2) % 3) / length.abs()
    face = 2 * largest + (length < 0)
    row, column = (((c + 1) * size / 2).long().clamp(0, size - 1) for c in (down, across))
    return ((face * size + row) * size + column)[..., 0]


def points(height: int, width: int, size: int) -> Points:
    """Place the points of a latlong grid on a cube."""
    rows, columns = POINTS * height, POINTS * width
    directions = latlong.directions(rows, columns, dtype=torch.float64)
    solid_angle = latlong.texel_solid_angles(rows, columns, dtype=torch.float64)
    return Points(cube_texel(directions, size), solid_angle)


def from_latlong(radiance: Tensor, size: int) -> Tensor:
    """Return the mean radiance over each cube texel.  [H, W, 3] -> [6, S, S, 3] float64."""
    height, width, _ = radiance.shape
    placed = points(height, width, size)
    fine = radiance.double().repeat_interleave(POINTS, 0).repeat_interleave(POINTS, 1)
    flux = torch.zeros(6 * size * size, 3, dtype=torch.float64)
    area = torch.zeros(6 * size * size, dtype=torch.float64)
    flux.index_add_(0, placed.texel.flatten(), (fine * placed.solid_angle[..., None]).flatten(0, 1))
    area.index_add_(0, placed.texel.flatten(), placed.solid_angle.flatten())
    return (flux / area[:, None]).reshape(6, size, size, 3)


def to_latlong(faces: Tensor, height: int, width: int) -> Tensor:
    """Return the mean radiance over each latlong texel.  [6, S, S, 3] -> [H, W, 3] float64."""
    placed = points(height, width, faces.shape[1])
    fine = faces.flatten(0, 2)[placed.texel]
    return latlong.reduce(fine, height, width)
