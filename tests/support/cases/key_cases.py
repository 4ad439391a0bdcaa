# SPDX-License-Identifier: Apache-2.0
"""Maps with lamps whose outlines are known, made by casting rays at them."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

from asglight.sphere import latlong

Array = NDArray[np.float64]

SKY = (0.2, 0.25, 0.3)


@dataclass(frozen=True)
class Rectangle:
    """A rectangle, seen from the origin.

    Attributes:
        longitude: Of its middle, in degrees.
        latitude: Likewise.
        turn: About the direction of its middle, in degrees.
        width: Angle that it is seen under, did it face the origin, in degrees.
        height: Likewise.
        radiance: Of all of it.
        slant: From facing the origin, in degrees.
        about: What it is slanted about, in degrees from its x axis.
    """

    longitude: float
    latitude: float
    turn: float
    width: float
    height: float
    radiance: tuple[float, float, float] = (60.0, 50.0, 40.0)
    slant: float = 0.0
    about: float = 0.0

    @property
    def axes(self) -> Array:
        """Rows x, y and z of its frame, z towards its middle."""
        turns = Rotation.from_euler(
            "YXZ", [self.longitude, -self.latitude, self.turn], degrees=True
        )
        return turns.as_matrix().T

    @property
    def extent(self) -> Array:
        """Tangents of its half angles."""
        return np.tan(np.radians([self.width, self.height]) / 2)

    @property
    def sides(self) -> Array:
        """Rows: directions of its sides, and its normal away from the origin."""
        about = np.radians(self.about)
        vector = np.radians(self.slant) * np.array([np.cos(about), np.sin(about), 0])
        return Rotation.from_rotvec(vector).as_matrix().T @ self.axes

    def corners(self) -> Array:
        """Directions of its corners.  [4, 3]."""
        p, q = self.extent
        round_it = np.array([[p, q, 0], [-p, q, 0], [-p, -q, 0], [p, -q, 0]])
        found = self.axes[2] + round_it @ self.sides
        return found / np.linalg.norm(found, axis=-1, keepdims=True)

    def covers(self, directions: Array) -> NDArray[np.bool_]:
        """Tell which directions it is seen in.  [..., 3]."""
        normal = self.sides[2]
        along = directions @ normal
        met = directions * (normal @ self.axes[2] / np.where(along > 0, along, np.inf))[..., None]
        local = (met - self.axes[2]) @ self.sides.T
        return (along > 0) & (np.abs(local[..., :2]) <= self.extent).all(-1)


def sky(rows: int) -> Tensor:
    """Return a sky that is brighter above.  [rows, 2 rows, 3]."""
    up = latlong.directions(rows, 2 * rows)[..., 1:2]
    return torch.tensor(SKY) * (1.5 + up)


def with_lamps(rows: int, *lamps: Rectangle, rays: int = 8) -> Tensor:
    """Return a sky with rectangles in front of it, each texel the mean along rays through it."""
    inner = (torch.arange(rays, dtype=torch.float64) + 0.5) / rays
    centres = latlong.directions(rows, 2 * rows, dtype=torch.float64).numpy()
    found = sky(rows)
    for lamp in lamps:
        # no farther from the lamp's middle than its corners and half of a texel's diagonal
        reach = np.arccos((lamp.corners() @ lamp.axes[2]).min()) + np.pi / rows
        row, column = (
            torch.from_numpy(one)[:, None]
            for one in np.nonzero(centres @ lamp.axes[2] >= np.cos(reach))
        )
        place = (row + inner) / rows
        u, v = torch.broadcast_tensors(((column + inner) / (2 * rows))[:, None], place[..., None])
        seen = torch.from_numpy(lamp.covers(latlong.direction_from_uv(u, v).numpy())).double()
        weight = torch.cos(torch.pi * (0.5 - place))[..., None]
        share = torch.zeros(rows, 2 * rows, dtype=torch.float64)
        share[row[:, 0], column[:, 0]] = (seen * weight).sum((1, 2)) / (weight.sum((1, 2)) * rays)
        found = torch.lerp(found, torch.tensor(lamp.radiance), share[..., None].float())
    return found


def corner_error(found: Array, truth: Array) -> float:
    """Return the largest angle from a corner to the true one, in the best order.  [4, 3], radians.

    A rectangle has no first corner, and no first side.
    """
    orders = [np.roll(corners, k, axis=0) for corners in (found, found[::-1]) for k in range(4)]
    cosines = [np.clip((order * truth).sum(-1), -1, 1) for order in orders]
    return min(float(np.arccos(cosine).max()) for cosine in cosines)
