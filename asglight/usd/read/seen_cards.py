# SPDX-License-Identifier: Apache-2.0
"""A card as it is seen from the rig's origin, wherever it was moved and however it was stretched.

A RectLight under any transform is a parallelogram that shines to one side, along its -Z. Seen from
the origin it has a solid angle and second moments, which are integrals over it; a piece dA at the
point r with the plane's normal n has the solid angle |n . r| / |r|^3 dA. The card that stands for
it faces the origin, with the same second moments, so by `cards.half_extent` it has the size of one
that `write_usd` authors.

Dimension letters: F frames, P points.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from asglight.lobes.rectangles import Rectangles
from asglight.usd.lights import cards

NODES = 24
"""Gauss and Legendre's nodes an axis. The widest card, 85 degrees to each side, is 2e-3 off with
them, one of 60 degrees 1e-9."""

ROUND = 1e-6
"""Of the second moments: how far off-diagonal ones are those of a card that was turned, and not
rounding. It turns a card by half a millionth, far below what is told of."""

SQUARE = 1e-4
"""Cosine of the angle between the sides of a rectangle, by rounding."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """Cards that face the origin and stand for what is seen.

    Attributes:
        frames: Axes x, y along the sides, z from the origin, as rows, right-handed.  [F, 3, 3]
        half_extents: Half width and half height at distance 1.  [F, 2]
        dimming: Solid angle of what is seen over that of the card; 0 for one seen from behind. [F]
    """

    frames: Array
    half_extents: Array
    dimming: Array


def seen_from_origin(axes: Array, place: Array, sizes: Array) -> Seen:
    """Return what a card is seen as.

    Args:
        axes: Images of the light's x, y and z axis, of any length.  [F, 3, 3]
        place: Of its centre.  [F, 3]
        sizes: Its width and height.  [F, 2]
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    u, v = (grid.ravel() / 2 for grid in np.meshgrid(nodes, nodes, indexing="ij"))
    weight = np.outer(weights, weights).ravel() / 4
    sides = axes[:, :2] * sizes[..., None]
    points = place[:, None] + u[:, None] * sides[:, None, 0] + v[:, None] * sides[:, None, 1]
    distance = np.linalg.norm(points, axis=-1)
    area = np.cross(sides[:, 0], sides[:, 1])
    area *= np.sign((area * axes[:, 2]).sum(-1))[:, None]  # along the light's +Z, also mirrored
    height = (area * place).sum(-1)  # above 0 where its -Z side looks at the origin
    angles = weight * np.abs(height)[:, None] / np.maximum(distance, 1e-30) ** 3
    whole = angles.sum(-1)
    directions = points / np.maximum(distance, 1e-30)[..., None]
    shares = angles / np.maximum(whole, 1e-300)[:, None]
    second = np.einsum("fp,fpi,fpj->fij", shares, directions, directions)
    frames = _frames(second, axes[:, 0], place)
    local = np.einsum("fki,fij,flj->fkl", frames, second, frames)
    turn = _quarter(local)
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y = frames[:, 0], frames[:, 1]
    frames = np.stack([cosine * x + sine * y, cosine * y - sine * x, frames[:, 2]], 1)
    squares = np.einsum("fki,fij,fkj->fk", frames[:, :2], second, frames[:, :2])
    extents = cards.half_extent(torch.from_numpy(squares)).numpy()
    own = cards.solid_angle(torch.from_numpy(extents)).numpy()
    dimming = np.where(height > 0, whole / np.maximum(own, 1e-300), 0.0)
    return Seen(frames, extents, dimming)


def seen_rectangles(
    axes: Array, place: Array, sizes: Array
) -> tuple[Rectangles, NDArray[np.bool_]] | None:
    """Return rectangles that are seen, with their middles at distance 1.

    Args:
        axes: Images of the light's x, y and z axis, of any length.  [F, 3, 3]
        place: Of its centre.  [F, 3]
        sizes: Its width and height.  [F, 2]

    Returns:
        The rectangles, and whether they shine at the origin [F]; None where one is none, but a
        parallelogram, or is at the origin.
    """
    sides = axes[:, :2] * sizes[..., None]
    lengths, distance = np.linalg.norm(sides, axis=-1), np.linalg.norm(place, axis=-1)
    if not (lengths.min() > 0 and distance.min() > 0):
        return None
    x, y = sides[:, 0] / lengths[:, :1], sides[:, 1] / lengths[:, 1:]
    if np.abs((x * y).sum(-1)).max() > SQUARE:
        return None
    z = np.cross(x, y)
    height = (axes[:, 2] * place).sum(-1)
    hand = np.where((z * place).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    values = place / distance[:, None], np.stack([x, hand * y, hand * z], 1)
    middle, turned = (torch.from_numpy(one) for one in values)
    return Rectangles(middle, turned, torch.from_numpy(lengths / 2 / distance[:, None])), height > 0


def _frames(second: Array, x: Array, place: Array) -> Array:
    """Return frames whose z is the main direction, and x next to that of the light."""
    z = np.linalg.eigh(second)[1][..., -1]
    z = z * np.where((z * place).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    x = x - (x * z).sum(-1, keepdims=True) * z
    x = x / np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-300)
    return np.stack([x, np.cross(z, x), z], 1)


def _quarter(local: Array) -> Array:
    """Return the angles, within 45 degrees, that make x and y the main axes of second moments."""
    mixed, apart = 2 * local[:, 0, 1], local[:, 0, 0] - local[:, 1, 1]
    whole = local[:, 0, 0] + local[:, 1, 1]
    safe = np.where(apart == 0, 1e-300, apart)
    return np.where(np.abs(mixed) > ROUND * whole, np.arctan(mixed / safe) / 2, 0.0)
