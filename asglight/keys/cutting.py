# SPDX-License-Identifier: Apache-2.0
"""Lamps cut out of a map: mattes, the background that fills them, and the light that was taken.

Symbols: H, W rows and columns; K lamps; P texels of a list.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg
from scipy.spatial import cKDTree

from asglight.keys.finding import surroundings
from asglight.keys.spots import Array, Grid, Mask, labelled

GROW_TEXELS, GROW = 2.5, 0.1
"""How far a matte is whole beyond its lamp: texels, over which interpolation smears an edge, or a
share of the lamp's radius, over which lenses do, whichever is more."""

RING_TEXELS, RING_STOPS = 0.4, 12.0
"""How far filters ring around a lamp for each stop above its surroundings, in texels: what they
leave falls by two and a half stops a texel. And the most stops that count."""

RAMP_TEXELS, RAMP = 2.0, 0.15
"""How far it then fades to nothing, as the first two."""


def matte(mask: Mask, luminance: Array, grid: Grid) -> Array:
    """Return the soft matte of a lamp: 1 on it and around it, 0 farther away.

    Args:
        mask: The lamp.  [H, W]
        luminance: Mean of the channels.  [H, W]
        grid: Of the map.

    Returns:
        In [0, 1].  [H, W]
    """
    radius = float(np.sqrt(grid.solid_angle[mask].sum() / np.pi))
    around = max(surroundings(mask, luminance, grid) or 0.0, float(np.finfo(np.float32).tiny))
    stops = min(float(np.log2(max(luminance[mask].mean() / around, 1))), RING_STOPS)
    whole = max(GROW_TEXELS * grid.texel, RING_TEXELS * stops * grid.texel, GROW * radius)
    ramp = max(RAMP_TEXELS * grid.texel, RAMP * radius)
    place, distance = grid.distances(mask, whole + ramp)
    beyond = np.clip((distance - whole) / ramp, 0, 1)
    found = np.zeros(mask.shape)
    found.ravel()[place] = 1 - beyond * beyond * (3 - 2 * beyond)
    return found


NEAREST = 1e-6
"""Chord at which a texel is one of the lamp's own."""

DIMMEST = float(np.finfo(np.float32).tiny)
"""Light that a lamp has at least here: one that is black for some frames keeps its own texels."""


def shares(
    masks: Sequence[Mask], mattes: Sequence[Array], luminance: Array, grid: Grid
) -> list[Array]:
    """Divide what several mattes cover among their lamps.

    A lamp has all of its own texels; between lamps, shares go with the light of each over the
    square of the distance to it, as a lamp's glow does. So none that stays keeps light of one that
    is cut.

    Args:
        masks: The lamps, which have no texel in common.  [H, W] each
        mattes: Of each.  [H, W]
        luminance: Mean of the channels.  [H, W]
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
            light = float((luminance[mask] * grid.solid_angle[mask]).sum())
            row[:] = matte[several] * max(light, DIMMEST) / np.maximum(chord, NEAREST) ** 2
    whole = np.minimum(sum(matte[several] for matte in mattes), 1)
    for row, share in zip(nearness / nearness.sum(0), found, strict=True):
        share[several] = whole * row
    return found


def lights_beside(mask: Mask, matte: Array, above: Array, background: Array) -> Mask:
    """Mark small lights on the rim of a matte that are not the lamp's: they stay whole.

    Args:
        mask: The lamp.  [H, W]
        matte: Its matte.  [H, W]
        above: Luminance above the background.  [H, W]
        background: Luminance of it.  [H, W]

    Returns:
        Of spots as bright as twice the background, those that the matte does not hold whole and
        that do not touch the lamp.  [H, W]
    """
    labels, count = labelled((matte > 0) & ((above > background) | mask))
    is_light = np.ones(count + 1, dtype=bool)
    is_light[labels[mask]] = False
    on_rim = np.zeros(count + 1, dtype=bool)
    on_rim[labels[matte < 1]] = True
    is_light[0] = False
    return (is_light & on_rim)[labels]


RIM_MOST = 4.0
"""Of the median of a hole's rim: a lamp beside the hole, which nobody cuts, does not light it."""

DARK = 0.05
"""Of the median around holes, that is added to radiance before its logarithm: dark rims of filters
have next to none, and an eye used to the surroundings sees none."""

GLOW_TEXELS = 3.0
"""How far the gradient at a rim goes on into a hole, in texels."""

GLOW_MOST = 4.0
"""Of a glow that goes on into a hole, over the membrane there."""


def filled(radiance: Array, holes: Mask, grid: Grid) -> Array:
    """Fill holes as a membrane that is fixed at their rims, on which a lamp's glow goes on.

    The membrane solves Laplace's equation on the sphere for the logarithm of radiance: it has no
    value outside those of its rim, so nothing is negative and nothing shines. Where the map
    brightens towards a hole, the light around a lamp, the luminance is raised to that of a spline
    in tension, which goes on with the rim's gradient [Smith and Wessel 1990, "Gridding with
    continuous curvature splines in tension"]: a membrane alone would leave a bright ring.

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
    mesh = _Mesh.of(holes)
    known = _dimmed(radiance, holes).reshape(holes.size, -1)
    dark = DARK * np.median(known[mesh.rim], axis=0) + np.finfo(np.float32).tiny
    luminance, grey = known.mean(-1, keepdims=True), float(dark.mean())
    membrane = mesh.membrane(np.log(known + dark))
    level, raised = (solve(np.log(luminance + grey)) for solve in (mesh.membrane, mesh.spline))
    glow = np.exp(np.clip(raised - level, 0, np.log(GLOW_MOST)))
    found.reshape(holes.size, -1)[mesh.place] = np.maximum(np.exp(membrane) - dark, 0) * glow
    return found


@dataclass(frozen=True, eq=False)
class _Mesh:
    """The texels of holes and those around, and the differences between neighbours.

    Attributes:
        place: Flat places of the texels in holes.  [P]
        rim: Of those beside them.  [Q]
        inner: Which of the rows of `laplace` are those in holes.  [P + Q]
        laplace: Sum of weighted differences to the neighbours, the integral of Laplace's operator
            over a texel.  [P + Q, H W]
        area: Of the texels of the rows, in squares of a texel's height.  [P + Q]
    """

    place: NDArray[np.int_]
    rim: NDArray[np.int_]
    inner: NDArray[np.bool_]
    laplace: Any
    area: Array

    @classmethod
    def of(cls, holes: Mask) -> "_Mesh":
        """Return the mesh of some holes."""
        height, width = holes.shape
        wide = holes | (_neighbours(holes.astype(int)) > 0).any(0)
        rows = np.flatnonzero(wide)
        row, column = np.divmod(rows, width)
        latitude = np.pi / 2 - np.pi * np.arange(height + 1) / height
        sides = np.maximum(np.cos(latitude), 0)  # of the upper edges of rows, and the last lower
        across = np.cos(np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height)
        links = [
            (np.maximum(row - 1, 0) * width + column, sides[row]),
            (np.minimum(row + 1, height - 1) * width + column, sides[row + 1]),
            (row * width + (column + 1) % width, 1 / across[row]),
            (row * width + (column - 1) % width, 1 / across[row]),
        ]
        own = np.arange(len(rows))
        entries = [(own, rows, -sum(weight for _, weight in links))]
        entries += [(own, neighbour, weight) for neighbour, weight in links]
        i, j, values = (np.concatenate(part) for part in zip(*entries, strict=True))
        laplace = sparse.csr_array((values, (i, j)), shape=(len(rows), holes.size))
        inner = holes.ravel()[rows]
        return cls(rows[inner], rows[~inner], inner, laplace, across[row])

    def membrane(self, known: Array) -> Array:
        """Return the values in holes with Laplace's operator 0.  [P, C], of a map [H W, C]."""
        return self._solved(self.laplace[self.inner], known)

    def spline(self, known: Array) -> Array:
        """Return the values in holes of a spline in tension, whose gradient is the rim's.  [P, C].

        It has the least integral of the square of Laplace's operator, plus that of the gradient's
        square over the square of `GLOW_TEXELS`.
        """
        bending = self.laplace.T @ (sparse.diags_array(1 / self.area) @ self.laplace)
        tension = self.laplace[self.inner] / GLOW_TEXELS**2
        return self._solved(bending[self.place] - tension, known)

    def _solved(self, matrix: Any, known: Array) -> Array:
        values = known.copy()
        values[self.place] = 0
        inner = sparse.csc_array(matrix[:, self.place])
        return linalg.splu(inner).solve(-(matrix @ values))


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
