# SPDX-License-Identifier: Apache-2.0
"""Rectangles in space as they are seen from the origin, and the slant that a key's card has.

A rectangle has its middle at distance 1; its sides go anywhere, so it need not face the origin. One
of a lobe is said beside the card that faces the origin in the lobe's frame, by seven numbers that
are all 0 of that card, its slant:

    (cx, cy)        its middle, in the direction (cx, cy, 1) of the lobe's frame
    (rx, ry, rz)    how its sides are turned from the frame's axes: axis times angle, in radians
    (gx, gy)        logarithms of its sides over those of the facing card

So it follows its lobe when that is turned or made wider. With h its plane's distance, (u, v) places
in the plane from the foot of the perpendicular, its solid angle is the sum over its corners of
+- atan(u v / (h sqrt(h^2 + u^2 + v^2))).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

NODES = 24
"""Gauss and Legendre's nodes an axis: of a card of 60 degrees 1e-9 off, of the widest, 85, 2e-3."""

CORNERS = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
"""In order around a rectangle."""


@dataclass(frozen=True)
class Rectangles:
    """Rectangles, with any batch shape.

    Attributes:
        middle: Unit directions of their middles, which are at distance 1.  [..., 3]
        axes: Rows: along both sides, and the normal on the side away from the origin.  [..., 3, 3]
        half: Half of their sides.  [..., 2]
    """

    middle: Tensor
    axes: Tensor
    half: Tensor

    def __getitem__(self, index: Any) -> "Rectangles":
        """Index the leading dimensions, as one would index each tensor."""
        return Rectangles(self.middle[index], self.axes[index], self.half[index])

    def points(self, u: Tensor, v: Tensor) -> Tensor:
        """Return points, not of unit length.

        Args:
            u: Along the first side, from -1 to 1.  [P]
            v: Along the second.  [P]

        Returns:
            [..., P, 3]
        """
        along = self.half[..., None] * self.axes[..., :2, :]  # [..., 2, 3]
        u, v = u[:, None] * along[..., None, 0, :], v[:, None] * along[..., None, 1, :]
        return self.middle[..., None, :] + u + v

    def corners(self) -> Tensor:
        """Return the directions of the corners, in order around each.  [..., 4, 3]."""
        u, v = self.half.new_tensor(CORNERS).unbind(-1)
        return torch.nn.functional.normalize(self.points(u, v), dim=-1)

    def solid_angle(self) -> Tensor:
        """Return solid angles in steradians.  [...]."""
        foot = (self.axes @ self.middle[..., None])[..., 0]  # middle along the sides, and h
        height = foot[..., 2]
        total = torch.zeros_like(height)
        for i, j in CORNERS:
            u = foot[..., 0] + i * self.half[..., 0]
            v = foot[..., 1] + j * self.half[..., 1]
            total += i * j * torch.atan2(u * v, height * (height**2 + u**2 + v**2).sqrt())
        return total

    def irradiance(self) -> Tensor:
        """Return the irradiance of radiance 1 on a surface that faces their middle.  [...].

        Lambert's formula [Lambert 1760, "Photometria"]: half the sum over the sides of the angle
        that each is seen under, times the cosine between its plane's normal and the surface's. What
        is behind the surface is not to be.
        """
        corners = self.corners()
        following = corners.roll(-1, dims=-2)
        across = torch.linalg.cross(corners, following)
        sine = across.norm(dim=-1)
        angle = torch.atan2(sine, (corners * following).sum(-1))
        height = (across * self.middle[..., None, :]).sum(-1)
        return (angle * height / sine).sum(-1).abs() / 2

    def second_moments(self) -> Tensor:
        """Return the means of d d^T of the directions d that they are seen in.  [..., 3, 3]."""
        nodes, weights = _nodes()
        u, v = (one.flatten() for one in torch.meshgrid(nodes, nodes, indexing="ij"))
        points = self.points(u, v)
        distance = points.norm(dim=-1, keepdim=True)
        seen = (weights[:, None] * weights).flatten()[:, None] / distance**3  # times the height
        directions = points / distance
        return (seen * directions).mT @ directions / seen.sum(-2, keepdim=True)


@lru_cache(maxsize=1)
@torch.inference_mode(False)
def _nodes() -> tuple[Tensor, Tensor]:
    """Return the nodes and weights of an axis, in [-1, 1].  [NODES] each."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    return torch.from_numpy(nodes), torch.from_numpy(weights)


def rectangles(axes: Tensor, extent: Tensor, slant: Tensor | None) -> Rectangles:
    """Return the cards of lobes.

    Args:
        axes: Rows of the lobes' frames.  [..., 3, 3]
        extent: Tangents of the half angles of the cards that face the origin.  [..., 2]
        slant: How theirs stand beside those; None: they are those.  [..., 7]
    """
    if slant is None:
        return Rectangles(axes[..., 2, :], axes, extent)
    middle = torch.cat([slant[..., :2], torch.ones_like(slant[..., :1])], -1)
    middle = torch.nn.functional.normalize(middle, dim=-1)
    sides = turns(slant[..., 2:5]) @ axes
    return Rectangles(
        (middle[..., None, :] @ axes)[..., 0, :], sides, extent * slant[..., 5:].exp()
    )


def slant_of(found: Rectangles, axes: Tensor, extent: Tensor) -> Tensor:
    """Return the slant with which `rectangles` gives some, in front of the lobes.  [..., 7].

    Args:
        found: The cards.
        axes: Rows of the lobes' frames.  [..., 3, 3]
        extent: Tangents of the half angles of the cards that face the origin.  [..., 2]
    """
    middle = (axes @ found.middle[..., None])[..., 0]
    turn = vectors(found.axes @ axes.mT)
    growth = (found.half / extent).log()
    return torch.cat([middle[..., :2] / middle[..., 2:], turn, growth], -1)


def seen_as(found: Rectangles) -> tuple[Tensor, Tensor]:
    """Return frames and spreads of the light of rectangles, as lobes that stand for them have.

    z is where the light comes from, x and y are nearest to how the sides are seen. They are not the
    main axes of the light: those turn at once where it is as wide as high.

    Args:
        found: The rectangles.

    Returns:
        Frames as rows [..., 3, 3]; mean x^2 and y^2 [..., 2].
    """
    second = found.second_moments()
    z = torch.linalg.eigh(second)[1][..., -1]
    z = z * (z * found.middle).sum(-1, keepdim=True).sign()
    sides = found.axes[..., :2, :]
    sides = sides - (sides @ z[..., None]) * z[..., None, :]
    left, _, right = torch.linalg.svd(torch.nn.functional.normalize(sides, dim=-1), False)
    x, y = (left @ right).unbind(-2)
    y = y * (torch.linalg.cross(x, y) * z).sum(-1, keepdim=True).sign()
    axes = torch.stack([x, y, z], -2)
    return axes, torch.diagonal(axes @ second @ axes.mT, dim1=-2, dim2=-1)[..., :2]


def turns(vector: Tensor) -> Tensor:
    """Return the axes, as rows, that rotations turn x, y and z to [Rodrigues 1840].

    Args:
        vector: Axis times angle in radians.  [..., 3]

    Returns:
        [..., 3, 3]
    """
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, z, -y, -z, zero, x, y, -x, zero], -1).reshape(*x.shape, 3, 3)
    angle = vector.norm(dim=-1)[..., None, None]
    half = torch.sinc(angle / (2 * torch.pi))
    eye = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return eye + torch.sinc(angle / torch.pi) * cross + half**2 / 2 * cross @ cross


def vectors(axes: Tensor) -> Tensor:
    """Return the rotations of which `turns` gives axes, by less than half a turn.  [..., 3]."""
    twice_sine = torch.stack(
        [
            axes[..., 1, 2] - axes[..., 2, 1],
            axes[..., 2, 0] - axes[..., 0, 2],
            axes[..., 0, 1] - axes[..., 1, 0],
        ],
        -1,
    )
    cosine = (torch.diagonal(axes, dim1=-2, dim2=-1).sum(-1, keepdim=True) - 1) / 2
    sine = twice_sine.norm(dim=-1, keepdim=True) / 2
    angle = torch.atan2(sine, cosine)
    return twice_sine / 2 / torch.sinc(angle / torch.pi)


def turned_slant(slant: Tensor | None, where: Tensor, quarters: int) -> Tensor | None:
    """Return the slants of the same cards in frames that are turned about z; None of none.

    Args:
        slant: In the frames as they were.  [..., 7]
        where: Which frames are turned: x becomes y and y becomes -x, once or twice.  [...]
        quarters: 1 or 2.
    """
    if slant is None:
        return None
    cx, cy, rx, ry, rz, gx, gy = slant.unbind(-1)
    if quarters == 1:
        other = torch.stack([cy, -cx, ry, -rx, rz, gy, gx], -1)
    else:
        other = torch.stack([-cx, -cy, -rx, -ry, rz, gx, gy], -1)
    return torch.where(where[..., None], other, slant)


def mirrored_slant(slant: Tensor | None, hand: Tensor) -> Tensor | None:
    """Return the slants of mirrored cards, in frames whose y axes are reversed; None of none.

    Args:
        slant: In the frames as they were.  [..., 7]
        hand: -1 where cards are mirrored, 1 where they stay.  [...]
    """
    if slant is None:
        return None
    one = torch.ones_like(hand)
    return slant * torch.stack([one, hand, hand, one, hand, one, one], -1)
