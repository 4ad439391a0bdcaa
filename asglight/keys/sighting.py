# SPDX-License-Identifier: Apache-2.0
"""The lamps of one frame, in few numbers, as they are followed over a shot."""

import numpy as np
from torch import Tensor

from asglight.keys import cards
from asglight.keys.finding import SMALL_TEXELS, Lamp, lamps
from asglight.keys.following import Sighting
from asglight.keys.rectangles import Patch
from asglight.keys.spots import Array, Grid, Mask, labelled

COUNT_MAX = 32
"""Lamps of a frame that are followed, the ones with most light."""


def sightings(radiance: Tensor) -> list[Sighting]:
    """Find the lamps of a frame, the one with most light first.

    Args:
        radiance: The map.  [h, w, 3]
    """
    values = radiance.double().numpy()
    luminance = values.mean(-1)
    grid = Grid.of(*luminance.shape)
    total = float((luminance * grid.solid_angle).sum())
    return [
        Sighting(
            np.flatnonzero(lamp.mask).astype(np.int32),
            lamp.direction,
            lamp.radius,
            lamp.flux / total,
            lamp.flux / irradiance(lamp.direction, luminance, grid),
            lamp.stops,
            figure(lamp, grid),
        )
        for lamp in lamps(luminance, grid)[:COUNT_MAX]
    ]


def irradiance(normal: Array, luminance: Array, grid: Grid) -> float:
    """Return the irradiance of a surface.

    Args:
        normal: Where it faces.  [3]
        luminance: Of the map.  [H, W]
        grid: Of the map.
    """
    cosine = np.maximum(grid.directions @ normal, 0)
    return float((luminance * cosine * grid.solid_angle).sum())


def figure(lamp: Lamp, grid: Grid) -> float:
    """Return which share of a lamp's outline a card fills that has its place and size.

    It is 1 of a rectangle, 0.9 of a disc, less of a sky that trees divide; and 1 of a lamp too
    small to have an outline. How bright the lamp is within its outline does not count.
    """
    if lamp.radius < SMALL_TEXELS * grid.texel:
        return 1.0
    near = grid.near(lamp.mask, 2 * grid.texel)
    patch = Patch.of(np.flatnonzero(near), grid)
    outline = lamp.mask | enclosed(lamp.mask, grid)
    light = (outline * grid.solid_angle).ravel()[patch.place]
    tried = (cards.off_by(card, patch, light) for card in cards.starts(patch, light))
    return 1 - min(map(cards.apart, tried)) / 2 / float(light.sum())


def enclosed(mask: Mask, grid: Grid) -> Mask:
    """Mark the texels that a spot goes all around: dark rings, which filters leave in a lamp.

    Args:
        mask: The spot.  [H, W]
        grid: Of the map.
    """
    labels, _ = labelled(~mask, corners=False)
    areas = np.bincount(labels.ravel(), grid.solid_angle.ravel())
    areas[0] = 0  # the spot itself
    return (labels != areas.argmax()) & ~mask
