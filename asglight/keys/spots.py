# SPDX-License-Identifier: Apache-2.0
"""Connected spots of a latlong map, whose sides meet and whose end rows are one point each.

Symbols: H, W rows and columns; P texels of a list.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from asglight.sphere import latlong

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Places = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Grid:
    """The texels of a latlong map.

    Attributes:
        directions: Of the texel centres.  [H, W, 3]
        solid_angle: In steradians.  [H, W]
    """

    directions: Array
    solid_angle: Array

    @classmethod
    def of(cls, height: int, width: int) -> "Grid":
        """Return the texels of a map of so many rows and columns."""
        directions = latlong.directions(height, width, dtype=torch.float64).numpy()
        solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
        return cls(directions, solid_angle.contiguous().numpy())

    @property
    def texel(self) -> float:
        """Return the height of a texel in radians."""
        return float(np.pi / len(self.directions))

    def near(self, mask: Mask, reach: float) -> Mask:
        """Mark the texels whose centres are nearer to a spot's than an angle.

        Args:
            mask: The spot.  [H, W]
            reach: In radians.
        """
        place, distance = self.distances(mask, reach)
        found = np.zeros(mask.shape, dtype=bool)
        found.ravel()[place[distance <= reach]] = True
        return found

    def distances(self, mask: Mask, reach: float) -> tuple[NDArray[np.int_], Array]:
        """Return how far texels are from the nearest texel of a spot.

        Args:
            mask: The spot.  [H, W]
            reach: In radians; texels farther away may be left out.

        Returns:
            Flat places of texels [P], and angles in radians, 0 within the spot [P].
        """
        lit = np.flatnonzero(mask.any(1))
        wider = int(reach / self.texel) + 2
        rows = slice(max(int(lit[0]) - wider, 0), int(lit[-1]) + wider + 1)
        around, own = self.directions[rows].reshape(-1, 3), mask[rows].ravel()
        spot = around[own]
        centre, radius = cap_of(spot)
        cosine = np.cos(min(radius + reach + 2 * self.texel, np.pi))
        place = np.flatnonzero(around @ centre >= cosine)
        distance, beyond = np.zeros(len(place)), ~own[place]
        chord, _ = cKDTree(spot).query(around[place[beyond]])
        distance[beyond] = 2 * np.arcsin(np.minimum(chord / 2, 1))
        return place + rows.start * mask.shape[1], distance


def cap_of(directions: Array) -> tuple[Array, float]:
    """Return the centre and the angular radius of a cap that holds directions.  [P, 3]."""
    centre = directions.sum(0)
    length = float(np.linalg.norm(centre))
    centre = centre / length if length > 0 else directions[0]
    return centre, float(np.arccos(np.clip((directions @ centre).min(), -1, 1)))


def labelled(marks: Mask, *, corners: bool = True) -> tuple[NDArray[np.int_], int]:
    """Number the connected spots of a map.

    Args:
        marks: What belongs to spots.  [H, W]
        corners: Whether texels that touch by a corner are connected.

    Returns:
        0 for the rest, spots from 1 on [H, W]; how many there are.
    """
    labels = np.zeros(marks.shape, dtype=int)
    ndimage.label(marks, ndimage.generate_binary_structure(2, 1 + corners), output=labels)
    count = int(labels.max(initial=0))
    rows = np.arange(len(labels))
    across = (-1, 0, 1) if corners else (0,)
    links = [(labels[rows, 0], labels[np.clip(rows + step, 0, rows[-1]), -1]) for step in across]
    links += [(np.full_like(end, end.max()), end) for end in (labels[0], labels[-1])]
    first, second = (np.concatenate(side) for side in zip(*links, strict=True))
    both = (first > 0) & (second > 0)
    graph = sparse.coo_array(
        (np.ones(both.sum()), (first[both], second[both])), shape=(count + 1, count + 1)
    )
    names = np.asarray(csgraph.connected_components(graph, directed=False)[1])
    spots, numbers = np.unique(names[1:], return_inverse=True)
    return np.concatenate([np.zeros(1, dtype=int), numbers + 1])[labels], len(spots)
