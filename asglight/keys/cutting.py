# SPDX-License-Identifier: Apache-2.0
"""Lamps cut out of a map: mattes, the background that fills them, and the light that was taken.

Symbols: H, W rows and columns; K lamps; P texels of a list.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg
from scipy.spatial import cKDTree

from asglight.keys.spots import Array, Grid, Mask, labelled

GROW_TEXELS, GROW = 2.5, 0.1
"""How far a matte is whole beyond its lamp: texels, over which interpolation smears an edge, or a
share of the lamp's radius, over which lenses do, whichever is more."""

RAMP_TEXELS, RAMP = 2.0, 0.15
"""How far it then fades to nothing, likewise."""


def matte(mask: Mask, grid: Grid) -> Array:
    """Return the soft matte of a lamp: 1 on it and around it, 0 farther away.

    Args:
        mask: The lamp.  [H, W]
        grid: Of the map.

    Returns:
        In [0, 1].  [H, W]
    """
    radius = float(np.sqrt(grid.solid_angle[mask].sum() / np.pi))
    whole = max(GROW_TEXELS * grid.texel, GROW * radius)
    ramp = max(RAMP_TEXELS * grid.texel, RAMP * radius)
    place, distance = grid.distances(mask, whole + ramp)
    beyond = np.clip((distance - whole) / ramp, 0, 1)
    found = np.zeros(mask.shape)
    found.ravel()[place] = 1 - beyond * beyond * (3 - 2 * beyond)
    return found


NEAREST = 1e-6
"""Chord at which a texel is one of the lamp's own."""


def shares(masks: Sequence[Mask], mattes: Sequence[Array], grid: Grid) -> list[Array]:
    """Divide what several mattes cover among their lamps.

    A lamp has all of its own texels; between lamps, shares go with the inverse square of the
    distance to each. So no lamp that stays keeps light of one that is cut.

    Args:
        masks: The lamps, which have no texel in common.  [H, W] each
        mattes: Of each.  [H, W]
        grid: Of the map.

    Returns:
        In [0, 1], with a sum of 1 at most.  [H, W] each
    """
    found = [matte.copy() for matte in mattes]
    several = sum((matte > 0).astype(int) for matte in mattes) > 1
    if not np.any(several):
        return found
    points = grid.directions[several]
    nearness = np.zeros((len(masks), len(points)))
    for row, mask, matte in zip(nearness, masks, mattes, strict=True):
        if matte[several].any():
            chord, _ = cKDTree(grid.directions[mask]).query(points)
            row[:] = matte[several] / np.maximum(chord, NEAREST) ** 2
    whole = np.minimum(sum(matte[several] for matte in mattes), 1)
    for row, share in zip(nearness / nearness.sum(0), found, strict=True):
        share[several] = whole * row
    return found


RIM_MOST = 4.0
"""Of the median of a hole's rim: a lamp beside the hole, which nobody cuts, does not light it."""


def filled(radiance: Array, holes: Mask, grid: Grid) -> Array:
    """Fill holes as a membrane that is fixed at their rims: Laplace's equation on the sphere.

    A membrane has no value outside those of its rim, so nothing is negative and nothing shines.
    What of the rim is far brighter than its median counts as `RIM_MOST` times that.

    Args:
        radiance: The map.  [H, W, 3]
        holes: What is filled.  [H, W]
        grid: Of the map.

    Returns:
        The map with the holes filled.  [H, W, 3]
    """
    found = radiance.copy()
    if not holes.any() or holes.all():
        return found
    height, width = holes.shape
    place = np.flatnonzero(holes)
    number = np.full(holes.size, -1)
    number[place] = np.arange(len(place))
    row, column = np.divmod(place, width)
    latitude = np.pi / 2 - np.pi * (np.arange(height + 1)) / height
    sides = np.maximum(np.cos(latitude), 0)  # of the upper edges of rows, and the last lower one
    across = 1 / np.cos(np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height)
    links = [
        (np.maximum(row - 1, 0) * width + column, sides[row]),
        (np.minimum(row + 1, height - 1) * width + column, sides[row + 1]),
        (row * width + (column + 1) % width, across[row]),
        (row * width + (column - 1) % width, across[row]),
    ]
    own = np.arange(len(place))
    whole = sum(weight for _, weight in links)
    entries = [(own, own, whole)]
    known = np.zeros((len(place), radiance.shape[-1]))
    flat = _dimmed(radiance, holes).reshape(holes.size, -1)
    for neighbour, weight in links:
        inner = number[neighbour] >= 0
        entries.append((own[inner], number[neighbour[inner]], -weight[inner]))
        known[~inner] += weight[~inner, None] * flat[neighbour[~inner]]
    rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = sparse.csc_array((values, (rows, columns)), shape=(len(place), len(place)))
    found.reshape(holes.size, -1)[place] = np.maximum(linalg.splu(matrix).solve(known), 0)
    return found


def _dimmed(radiance: Array, holes: Mask) -> Array:
    """Return a map whose texels around each hole are at most so far above their median."""
    found = radiance.copy()
    luminance = radiance.mean(-1)
    labels, count = labelled(holes)
    around = _neighbours(labels)
    for label in range(1, count + 1):
        rim = (around == label).any(0) & ~holes
        if rim.any():
            most = RIM_MOST * float(np.median(luminance[rim]))
            bright = rim & (luminance > most)
            found[bright] *= (most / luminance[bright])[:, None]
    return found


def _neighbours(labels: NDArray[np.int_]) -> NDArray[np.int_]:
    """Return the labels of the texels above, below, and to both sides.  [4, H, W]."""
    above = np.concatenate([labels[:1], labels[:-1]])
    below = np.concatenate([labels[1:], labels[-1:]])
    return np.stack([above, below, np.roll(labels, 1, axis=1), np.roll(labels, -1, axis=1)])
