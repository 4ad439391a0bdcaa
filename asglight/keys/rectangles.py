# SPDX-License-Identifier: Apache-2.0
"""Rectangles seen from the origin, and the texels around a lamp that they cover.

A card is a rectangle in the plane z = 1 of a frame whose z axis goes through its middle.

Symbols: P texels around a lamp; S points in each.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asglight.keys.spots import Array, Grid, Places

POINTS = 20_000
"""Points that a lamp is looked at in, at most, in squares of `SIDE` by `SIDE` a texel."""

SIDE = (3, 5)
"""Points in a texel each way, at least and at most: soft edges are right to a tenth of a texel, or
to a few hundredths."""


@dataclass(frozen=True, eq=False)
class Card:
    """A rectangle seen from the origin.

    Attributes:
        axes: Rows x, y, z of its frame; z goes through its middle.  [3, 3]
        extent: Tangents of its half angles along x and y.  [2]
    """

    axes: Array
    extent: Array

    @property
    def solid_angle(self) -> float:
        """Return its solid angle in steradians: 4 atan(p q / sqrt(1 + p^2 + q^2))."""
        p, q = self.extent
        return float(4 * np.arctan(p * q / np.sqrt(1 + p * p + q * q)))

    def corners(self) -> Array:
        """Return the directions of its corners, in order around it.  [4, 3]."""
        p, q = self.extent
        corners = np.array([[p, q, 1], [-p, q, 1], [-p, -q, 1], [p, -q, 1]]) @ self.axes
        return corners / np.linalg.norm(corners, axis=-1, keepdims=True)


@dataclass(frozen=True, eq=False)
class Patch:
    """The texels around a lamp, as points.

    Attributes:
        place: Flat places of the texels in the map.  [P]
        points: Directions.  [P, S, 3]
        weight: Solid angle of each point, in steradians.  [P, S]
        softness: Width over which the edge of a card fades, as a tangent: a point's own.
        shape: Rows and columns of the map.
    """

    place: Places
    points: Array
    weight: Array
    softness: float
    shape: tuple[int, int]

    @classmethod
    def of(cls, place: Places, grid: Grid) -> "Patch":
        """Return some texels of a map as points."""
        height, width = grid.solid_angle.shape
        side = int(np.clip(np.sqrt(POINTS / max(len(place), 1)), *SIDE))
        row, column = np.divmod(place, width)
        inner = (np.arange(side) + 0.5) / side
        latitude = np.pi / 2 - np.pi * (row[:, None, None] + inner[None, :, None]) / height
        longitude = np.pi - 2 * np.pi * (column[:, None, None] + inner[None, None, :]) / width
        latitude, longitude = np.broadcast_arrays(latitude, longitude)
        points = np.stack(
            [
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
                np.cos(latitude) * np.cos(longitude),
            ],
            axis=-1,
        ).reshape(len(place), -1, 3)
        share = np.cos(latitude).reshape(len(place), -1)
        share = share / share.sum(-1, keepdims=True)
        weight = share * grid.solid_angle.ravel()[place][:, None]
        return cls(place, points, weight, grid.texel / side, (height, width))

    @cached_property
    def centres(self) -> Array:
        """Return the directions of the texels' middles.  [P, 3]."""
        centre = (self.points * self.weight[..., None]).sum(1)
        return centre / np.linalg.norm(centre, axis=-1, keepdims=True)

    def covered(self, card: Card) -> Array:
        """Return the solid angle of each texel that a card covers.  [P]."""
        local = self.points @ card.axes.T
        z = np.maximum(local[..., 2], 1e-6)  # behind the origin nothing is covered
        sides = [
            np.clip((card.extent[k] - np.abs(local[..., k]) / z) / self.softness + 0.5, 0, 1)
            for k in (0, 1)
        ]
        return (sides[0] * sides[1] * (local[..., 2] > 0) * self.weight).sum(-1)


def aligned(card: Card, before: Card | None) -> Card:
    """Return the same card in the one of its four frames that is nearest to the one before.

    The first has its narrow side along x, as the frames of lobes do
    (`asglight.lobes.frames.continuous`), so that frames stay as they are when keys become lobes and
    textures stay with their cards.
    """
    x, y, z = card.axes
    turned = [
        Card(np.stack([x, y, z]), card.extent),
        Card(np.stack([y, -x, z]), card.extent[::-1]),
        Card(np.stack([-x, -y, z]), card.extent),
        Card(np.stack([-y, x, z]), card.extent[::-1]),
    ]
    if before is None:
        return turned[1] if card.extent[1] < card.extent[0] else turned[0]
    return max(turned, key=lambda one: float((one.axes * before.axes).sum()))


def frame(x: Array, z: Array) -> Array:
    """Return the right-handed frame of a unit z axis with x as near to a vector as can be."""
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x).astype(np.float64), z])


def frame_of(direction: Array) -> Array:
    """Return a frame about a direction whose x axis is level.  [3, 3]."""
    z = direction / np.linalg.norm(direction)
    up = np.array([0.0, 1.0, 0.0]) if abs(z[1]) < 0.99 else np.array([0.0, 0.0, 1.0])
    return frame(np.cross(up, z), z)


def half_extent(squares: Array) -> Array:
    """Return the tangents of the half angles of the card with these mean x^2 and y^2.

    With s = p q / sqrt(1 + p^2 + q^2), the mean x^2 is (1 - s / ((1 + p^2) atan s)) / 3.  [2]
    """
    rest = np.maximum(1 - 3 * squares, 1e-2)  # half angles up to 84 degrees
    corner = 1e-12
    for _ in range(200):  # a fixed point whose error shrinks by a factor each time
        extent = np.sqrt(np.maximum(corner / np.arctan(corner) / rest - 1, 0))
        following = extent.prod() / np.sqrt(1 + extent @ extent)
        if abs(following - corner) <= 1e-12 * corner:
            break
        corner = max(following, 1e-12)
    return extent
