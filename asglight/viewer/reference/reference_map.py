# SPDX-License-Identifier: Apache-2.0
"""A latlong map made ready for the reference pass: a rest without great peaks, and suns.

Brightness is the largest of red, green and blue, so that no colour hides. Texels brighter than
SUN_RATIO times the map's mean are cut at that value: what is left is the rest, what was cut off are
the suns. Their sum is the map, texel by texel. The suns are drawn from a table of equal shares of
probability, of which each has a number that goes with its flux, and at least one.

Symbols: H, W rows and columns; L mip levels; S shares.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.sphere import latlong

SUN_RATIO = 8.0
"""Brightness over the mean of the map above which a texel is cut."""

SHARE_COLUMNS = 4096
"""Columns of the table of shares."""

_SHARES_PER_SUN = 4
"""At least so many shares for each sun on average, so that rounding them costs little."""

DIFFUSE_ROWS = 32
"""Rows of the table of diffuse light, and of the texels that it sums over."""

_DIFFUSE_POINTS = 3
"""Points across such a texel, which is 6 degrees wide."""


class ReferenceMap(NamedTuple):
    """What the reference pass uploads.

    Attributes:
        levels: Rest, and suns over rest in the fourth channel of level 0.  L x [H >> l, W >> l, 4]
        shares: Column, row, and steradians over probability of the sun of each share.  [., ., 3]
        sun_density: What suns over rest are multiplied by for the probability of a direction
            there, 1 / sr; 0 if there are none.
        diffuse: Irradiance over pi of the rest.  [DIFFUSE_ROWS, 2 DIFFUSE_ROWS, 3]
    """

    levels: tuple[np.ndarray, ...]
    shares: np.ndarray
    sun_density: float
    diffuse: np.ndarray


def prepared(radiance: np.ndarray) -> ReferenceMap:
    """Split a map and make its tables.

    Args:
        radiance: Finite and not negative, float32.  [H, W, 3]
    """
    height, width, _ = radiance.shape
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64).numpy()
    brightness = radiance.max(-1).astype(np.float64)
    limit = SUN_RATIO * float((brightness * solid_angle).sum()) / (4 * math.pi)
    cut = np.maximum(brightness - limit, 0)
    sun_over_rest = cut / limit if limit > 0 else cut
    rest = radiance / (1 + sun_over_rest)[..., None]
    level = np.concatenate([rest, sun_over_rest[..., None]], axis=-1).astype(np.float32)
    weights = sun_over_rest * solid_angle
    total = float(weights.sum())
    return ReferenceMap(
        levels=tuple(levels(level)),
        shares=_shares(weights, solid_angle),
        sun_density=1 / total if total > 0 else 0.0,
        diffuse=_diffuse(torch.from_numpy(level[..., :3])),
    )


def levels(level: np.ndarray) -> list[np.ndarray]:
    """Halve a map down to one texel, each texel the mean over its solid angle."""
    levels = [level]
    current = torch.from_numpy(level)
    while max(current.shape[:2]) > 1:
        height, width = (max(n // 2, 1) for n in current.shape[:2])
        current = latlong.reduce(current, height, width)
        levels.append(current.contiguous().numpy())
    return levels


def _shares(weights: np.ndarray, solid_angle: np.ndarray) -> np.ndarray:
    """Deal shares out to texels, in the order of the map, by weight."""
    rows, columns = np.nonzero(weights)
    if not len(rows):
        return np.zeros((1, 1, 3), np.float32)
    needed = _SHARES_PER_SUN * len(rows)
    count = SHARE_COLUMNS * math.ceil(needed / SHARE_COLUMNS)
    part = weights[rows, columns] / weights.sum()
    # One for each; of the others, what ends nearest to the running sum.
    ends = np.round(np.cumsum(part) * (count - len(rows))).astype(np.int64)
    each = 1 + np.diff(ends, prepend=0)
    entries = np.stack([columns, rows, solid_angle[rows, columns] * count / each], axis=-1)
    table = np.repeat(entries, each, axis=0).astype(np.float32)
    return table.reshape(-1, SHARE_COLUMNS, 3)


def _diffuse(rest: Tensor) -> np.ndarray:
    """Return irradiance over pi of the rest, summed over texels of the table's size."""
    texels = latlong.reduce(rest, DIFFUSE_ROWS, 2 * DIFFUSE_ROWS)
    return (_cosine_weights() @ texels.flatten(0, 1)).reshape(texels.shape).numpy()


@functools.cache
def _cosine_weights() -> Tensor:
    """Return the weight of each texel for each normal, both of a map.  [normals, texels]."""
    size = DIFFUSE_ROWS, 2 * DIFFUSE_ROWS
    normals = latlong.directions(*size).flatten(0, 1)
    # The mean over a texel: at its centre the cosine may be 0 where half of it is seen.
    fine = DIFFUSE_ROWS * _DIFFUSE_POINTS, 2 * DIFFUSE_ROWS * _DIFFUSE_POINTS
    lights = latlong.directions(*fine) * latlong.texel_solid_angles(*fine)[..., None]
    weights = torch.zeros(len(normals), len(normals))
    for row in range(_DIFFUSE_POINTS):
        for column in range(_DIFFUSE_POINTS):
            part = lights[row::_DIFFUSE_POINTS, column::_DIFFUSE_POINTS].flatten(0, 1)
            weights += (normals @ part.mT).clamp(min=0)
    return weights / weights.sum(-1, keepdim=True)  # within 1e-3 of pi; an even map stays even
