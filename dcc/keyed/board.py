# SPDX-License-Identifier: Apache-2.0
"""A post on a white board that the strongest key meets at 45 degrees, and what its shadow is like.

Directions are asglight's. Seen along the board's normal, the shadow of the key falls to the right.
NumPy only, because Blender's interpreter has nothing else.

Symbols: H, W rows and columns of a picture of the board.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH, HEIGHT = 1.2, 0.8
"""Of what is seen of the board, in metres."""

POST = 0.1
"""Sides of the post, in metres: several penumbras of a lamp of three degrees."""

POST_HEIGHT = 0.8
"""In metres: as long is its shadow."""

FOOT = -0.4
"""Where the post stands, right of the middle of what is seen."""

ALONG = (0.2, 0.6)
"""Of the shadow, from the post's axis: where its direction is measured."""

ACROSS = (0.35, 0.45)
"""Where its softness is measured, likewise."""

BASE = 0.25
"""In metres: farther from the shadow's middle a profile is what the post takes of the light of all
directions."""

PLATEAU = 0.3
"""Of the post's width: where the shadow of a lamp is deepest."""

LEVELS = (0.2, 0.8)
"""Of the depth, between which softness is measured: nearer to 0 and 1 there is noise."""


@dataclass(frozen=True)
class Shadow:
    """A shadow.

    Attributes:
        direction_deg: Its turn against the direction in which that of the key falls.
        softness_deg: Of its edges, from 20 to 80 % of its depth, as an angle seen from there.
        depth: What it takes of the board's light, where it is deepest.
    """

    direction_deg: float
    softness_deg: float
    depth: float


def frame(key: Array) -> Array:
    """Return rows right, up, and the normal of a board that light meets at 45 degrees.

    Args:
        key: Direction to the light.  [3]
    """
    least = np.eye(3)[np.abs(key).argmin()]
    beside = _unit(np.asarray(np.cross(key, least), dtype=np.float64))
    normal = _unit(key + beside)
    right = _unit((key @ normal) * normal - key)
    return np.stack([right, np.cross(normal, right), normal])


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def measured(board: Array, with_post: Array) -> Shadow:
    """Measure the shadow of the post.

    Args:
        board: Without the post.  [H, W, 3]
        with_post: With it.  [H, W, 3]
    """
    taken = (board - with_post).mean(-1)  # [H, W]
    rows, columns = taken.shape
    up = HEIGHT * (0.5 - (np.arange(rows) + 0.5) / rows)
    right = WIDTH * ((np.arange(columns) + 0.5) / columns - 0.5) - FOOT
    taken = taken - taken[np.abs(up) > BASE].mean(0)
    along = (right >= ALONG[0]) & (right <= ALONG[1])
    near = np.abs(up) <= BASE
    middle = (taken[near][:, along] * up[near, None]).sum(0) / taken[near][:, along].sum(0)
    slope = np.polyfit(right[along], middle, 1)[0]
    part = (right >= ACROSS[0]) & (right <= ACROSS[1])
    profile = taken[:, part].mean(1)
    deep = np.abs(up) <= PLATEAU * POST
    depth = float(profile[deep].mean())
    distance = np.sqrt(2) * sum(ACROSS) / 2  # along the ray from the post's edge to the board
    widths = [_rise(up[side], profile[side] / depth) for side in (up > 0, up < 0)]
    return Shadow(
        float(np.degrees(np.arctan(slope))),
        float(np.degrees(np.mean(widths) / distance)),
        depth / float(board[:, part].mean()),
    )


def _rise(up: Array, share: Array) -> float:
    """Return how far an edge is from the one level to the other, from outside to the middle."""
    order = np.abs(up).argsort()
    distance, values = np.abs(up)[order], share[order]
    low, high = (_crossing(distance, values, level) for level in LEVELS)
    return low - high


def _crossing(distance: Array, values: Array, level: float) -> float:
    """Return where a profile that falls outwards first comes below a level."""
    first = int(np.flatnonzero(values < level)[0])
    before, after = values[first - 1], values[first]
    part = (before - level) / (before - after)
    return float(distance[first - 1] + part * (distance[first] - distance[first - 1]))
