# SPDX-License-Identifier: Apache-2.0
"""Rectangles seen from the origin, and the texels around a lamp that they cover.

A card has its middle at distance 1, and need not face the origin.

Symbols: P texels around a lamp; S points in each.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch

from asglight.keys.spots import Array, Grid, Places
from asglight.lobes import rectangles as slanted
from asglight.lobes.rectangles import CORNERS, Rectangles

POINTS = 20_000
"""Points that a lamp is looked at in, at most, in squares of `SIDE` by `SIDE` a texel."""

SIDE = (3, 5)
"""Points in a texel each way, at least and at most: soft edges are right to a tenth of a texel, or
to a few hundredths."""


FACING = 1e-9
"""Sine of the angle up to which a card faces the origin."""


@dataclass(frozen=True, eq=False)
class Card:
    """A rectangle seen from the origin.

    Attributes:
        axes: Rows: along its sides, and its normal on the side away from the origin.  [3, 3]
        extent: Half of its sides, with its middle at distance 1: tangents of its half angles where
            it faces the origin.  [2]
        middle: Direction of its middle: that of its normal where it faces the origin.  [3]
    """

    axes: Array
    extent: Array
    middle: Array

    @classmethod
    def facing(cls, axes: Array, extent: Array) -> "Card":
        """Return a card that faces the origin; arguments as the attributes."""
        return cls(axes, extent, axes[2])

    @cached_property
    def foot(self) -> Array:
        """Return where its middle is along its axes: (0, 0, 1) of one that faces the origin."""
        return self.axes @ self.middle

    @property
    def is_facing(self) -> bool:
        """Tell whether it faces the origin."""
        return bool(np.abs(self.foot[:2]).max() < FACING)

    @property
    def seen_extent(self) -> Array:
        """Return half of its sides as they are seen, foreshortened.  [2]."""
        return self.extent * np.sqrt(np.maximum(1 - self.foot[:2] ** 2, FACING))

    @cached_property
    def rectangle(self) -> Rectangles:
        """Return the same rectangle as tensors."""
        values = (self.middle, self.axes, self.extent)
        return Rectangles(*(torch.from_numpy(np.ascontiguousarray(one)) for one in values))

    @property
    def solid_angle(self) -> float:
        """Return its solid angle in steradians (`lobes.rectangles`), without a tensor's time."""
        x, y, height = self.foot.tolist()
        p, q = self.extent.tolist()
        total = 0.0
        for i, j in CORNERS:
            u, v = x + i * p, y + j * q
            total += i * j * math.atan2(u * v, height * math.sqrt(height**2 + u**2 + v**2))
        return total

    @property
    def centre(self) -> Array:
        """Return the mean direction of its light: its middle where it faces the origin.

        The integral of directions over a polygon is half the sum over its sides of the angle that
        each is seen under, times the normal of its plane [Lambert 1760, "Photometria"].
        """
        if self.is_facing:
            return self.middle
        corners = self.middle + np.array(CORNERS) * self.extent @ self.axes[:2]
        following = corners[[1, 2, 3, 0]]
        across = _cross(corners, following)
        sine = np.sqrt((across * across).sum(-1, keepdims=True))
        cosine = (corners * following).sum(-1, keepdims=True)
        total = (np.arctan2(sine, cosine) * across / sine).sum(0)
        return total / np.linalg.norm(total) * np.sign(total @ self.middle)

    def corners(self) -> Array:
        """Return the directions of its corners, in order around it.  [4, 3]."""
        return self.rectangle.corners().numpy()

    def turned(self, turn: Array) -> "Card":
        """Return the card turned about the origin, by a matrix for columns.  [3, 3]."""
        return Card(self.axes @ turn.T, self.extent, self.middle @ turn.T)


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

    @cached_property
    def _columns(self) -> Array:
        """Return x, y and z of all points, each in one row: far faster to go through.  [3, P S]."""
        return np.ascontiguousarray(self.points.reshape(-1, 3).T)

    def covered(self, card: Card) -> Array:
        """Return the solid angle of each texel that a card covers.  [P]."""
        cover = self._cover(card, self._columns)
        return np.einsum("ps,ps->p", cover.reshape(self.weight.shape), self.weight)

    def covered_more(self, card: Card, others: Sequence[Card]) -> Array:
        """Return by how much more of each texel other cards cover, which are nearly the same.

        Args:
            card: The card.
            others: Those, whose edges are much nearer to the card's than points are to each other:
                only what the card covers in part changes.  N

        Returns:
            In steradians.  [P, N]
        """
        cover = self._cover(card, self._columns)
        rim = np.flatnonzero((cover > 0) & (cover < 1))
        points, texel = self._columns[:, rim], rim // self.weight.shape[1]
        weight = self.weight.ravel()[rim]
        found = np.zeros((len(self.place), len(others)))
        for column, other in zip(found.T, others, strict=True):
            more = weight * (self._cover(other, points) - cover[rim])
            column[:] = np.bincount(texel, more, len(column))
        return found

    def _cover(self, card: Card, points: Array) -> Array:
        """Return which part of each point [3, N] a card covers.  [N]."""
        *across, away = card.axes @ points
        nearness = card.foot[2] / np.maximum(away, 1e-6)  # behind it nothing is covered
        softness = self.softness * card.extent / card.seen_extent
        cover = (away > 0).astype(np.float64)
        for k, side in enumerate(across):
            side *= nearness
            side -= card.foot[k]
            np.abs(side, out=side)
            np.subtract(card.extent[k] / softness[k] + 0.5, side / softness[k], out=side)
            cover *= np.clip(side, 0, 1, out=side)
        return cover


def aligned(card: Card, before: Card | None) -> Card:
    """Return the same card with that order of its sides that is nearest to the one before.

    The first has the side along x that is seen narrower. The order is that of the frames of lobes
    (`asglight.lobes.frames.continuous`), by how the sides are seen, so that frames stay as they are
    when keys become lobes and textures stay with their cards.
    """
    x, y, z = card.axes
    turned = [
        Card(np.stack([x, y, z]), card.extent, card.middle),
        Card(np.stack([y, -x, z]), card.extent[::-1], card.middle),
        Card(np.stack([-x, -y, z]), card.extent, card.middle),
        Card(np.stack([-y, x, z]), card.extent[::-1], card.middle),
    ]
    if before is None:
        squares = card.extent**2 if card.is_facing else seen_as(card).squares
        return turned[1] if squares[1] < squares[0] else turned[0]
    own, last = (one.axes if one.is_facing else seen_as(one).axes for one in (card, before))
    along = float((own[:2] * last[:2]).sum())
    across = float(own[1] @ last[0] - own[0] @ last[1])
    return turned[int(np.argmax([along, across, -along, -across]))]


class SeenAs(NamedTuple):
    """A card as the lobe that stands for it.

    Attributes:
        axes: Rows of its frame.  [3, 3]
        squares: Mean x^2 and y^2 of the light.  [2]
    """

    axes: Array
    squares: Array


def seen_as(card: Card) -> SeenAs:
    """Return the frame and the spread of the light of a card (`lobes.rectangles.seen_as`)."""
    return SeenAs(*(one.numpy() for one in slanted.seen_as(card.rectangle)))


def frame(x: Array, z: Array) -> Array:
    """Return the right-handed frame of a unit z axis with x as near to a vector as can be."""
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, _cross(z, x), z])


def _cross(first: Array, second: Array) -> Array:
    """Return cross products; np.cross takes four times as long for so few.  [..., 3]."""
    following, last = [1, 2, 0], [2, 0, 1]
    return first[..., following] * second[..., last] - first[..., last] * second[..., following]


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
