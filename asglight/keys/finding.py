# SPDX-License-Identifier: Apache-2.0
"""Lamps in a map: spots with an edge, far brighter than what surrounds them.

The map is cut at levels half a stop apart, from its peak down. A spot that hangs together at a
level is a lamp if what lies just outside of its edge is much darker than it is: light that falls
off slowly, as around a sun or on a wall, has no such edge at any level. Going down, a lamp grows as
long as it keeps an edge and is told more clearly from what surrounds it. So a bulb grows into its
dish, and a sun does not grow into its glare. Where lamps run together they stay apart if they had
most of the light.

How clearly a spot of flux F and solid angle A is told from surroundings of radiance B is the
signal-to-noise ratio of an aperture, F / sqrt(A B) [Howell 1989, "Two-dimensional aperture
photometry: signal-to-noise ratio of point-source observations and optimal data-extraction
techniques", for stars on a bright sky].

Symbols: H, W rows and columns.
"""

from dataclasses import dataclass, replace

import numpy as np

from asglight.keys.spots import Array, Grid, Mask, cap_of, labelled

LEVEL_STEP = 2**0.5
"""Between levels. Edges are two stops steep, so four levels meet each."""

STOPS_MIN = 3.0
"""Of a lamp above its surroundings. The glow at a horizon has two, a window three or more."""

EDGE_STOPS = 1.0
"""Of the level that a lamp is cut at above its surroundings: light without an edge has less."""

DARK = 0.05
"""Of the map's mean: surroundings that are darker count as that. Filters leave black texels around
a lamp, which would tell any of its parts from the rest of it."""

LESS_CLEAR = 2.0
"""By which factor the signal of a lamp may be below that of a smaller one within it. Texels that
its edge divides have less of its light than of its area, of a sun of a texel half of it."""

SHARE_MIN = 0.003
"""Of the map's light: a lamp with less is not looked for."""

RADIUS_MAX = np.radians(40)
"""Of a lamp; beyond it a flat card is no picture of it."""

EDGE_TEXELS, EDGE = 1.5, 0.25
"""Width of an edge, in texels, over which interpolation smears one, or in radii of the lamp, over
which lenses do; whichever is more. The surroundings are the ring of such a width beyond."""

RING_TEXELS = 2.0
"""Least width of that ring."""

APART = 0.8
"""Share of the light of a spot that lamps within it have if they are lamps of their own."""

GAP_TEXELS = 2.1
"""Lamps that are nearer are one, if they are small: filters that overshoot cut a sun in two."""

SMALL_TEXELS = 6.0
"""Radius up to which a lamp is small in that sense."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp in a map.

    Attributes:
        mask: Its texels.  [H, W]
        direction: Of its light's mean.  [3]
        radius: Of a disc of its solid angle, in radians.
        flux: Above its surroundings, the mean of the channels times solid angle.
        stops: Of its mean above its surroundings.
        signal: Square of how clearly it is told from them, radiance times solid angle.
        most: The largest signal of it at this level and those above.
    """

    mask: Mask
    direction: Array
    radius: float
    flux: float
    stops: float
    signal: float
    most: float


def lamps(luminance: Array, grid: Grid) -> list[Lamp]:
    """Find the lamps of a map, the one with most light first.

    Args:
        luminance: Mean of the channels, >= 0.  [H, W]
        grid: Of the map.
    """
    total = float((luminance * grid.solid_angle).sum())
    if not total > 0:
        return []
    mean, level = total / (4 * np.pi), float(luminance.max()) / LEVEL_STEP
    found: list[Lamp] = []
    while level > mean:
        found = _at_level(luminance, level, grid, found, SHARE_MIN * total)
        level /= LEVEL_STEP
    return sorted(_mended(found, luminance, grid), key=lambda lamp: -lamp.flux)


def _at_level(
    luminance: Array, level: float, grid: Grid, found: list[Lamp], least: float
) -> list[Lamp]:
    """Return the lamps found at higher levels, grown to this one where they keep an edge."""
    labels, count = labelled(luminance > level)
    above = ((luminance - level) * grid.solid_angle).ravel()
    excess = np.bincount(labels.ravel(), above, count + 1)
    within: dict[int, list[Lamp]] = {}
    for lamp in found:
        within.setdefault(int(labels[lamp.mask][0]), []).append(lamp)
    kept: list[Lamp] = []
    for label in range(1, count + 1):
        own = within.get(label, [])
        lamp = _lamp(labels == label, level, luminance, grid) if excess[label] > least else None
        if lamp is None or _are_lamps(own, lamp):
            kept += own
        else:
            kept.append(replace(lamp, most=max([lamp.most, *(one.most for one in own)])))
    return kept


def _are_lamps(own: list[Lamp], grown: Lamp) -> bool:
    """Tell whether lamps stay as they are and do not become the one spot that they grow to."""
    if len(own) > 1 and sum(one.flux for one in own) > APART * grown.flux:
        return True
    return any(one.most > LESS_CLEAR * grown.signal for one in own)


def _lamp(mask: Mask, level: float, luminance: Array, grid: Grid) -> Lamp | None:
    """Return a spot as a lamp, or None where it has no edge."""
    if cap_of(grid.directions[mask])[1] > RADIUS_MAX:
        return None
    around = surroundings(mask, luminance, grid)
    if around is None or around * 2**EDGE_STOPS > level:
        return None
    lamp = _measured(mask, around, luminance, grid)
    return lamp if lamp.stops >= STOPS_MIN else None


def surroundings(mask: Mask, luminance: Array, grid: Grid) -> float | None:
    """Return the median of what surrounds a spot; None where nothing does."""
    radius = float(np.sqrt(grid.solid_angle[mask].sum() / np.pi))
    inner = max(EDGE_TEXELS * grid.texel, EDGE * radius)
    outer = inner + max(RING_TEXELS * grid.texel, EDGE * radius)
    place, distance = grid.distances(mask, outer)
    ring = place[(distance > inner) & (distance <= outer)]
    if not len(ring):
        return None
    values, weight = luminance.ravel()[ring], grid.solid_angle.ravel()[ring]
    order = np.argsort(values)
    half = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    return float(values[order][half])


def _measured(mask: Mask, around: float, luminance: Array, grid: Grid) -> Lamp:
    solid, values = grid.solid_angle[mask], luminance[mask]
    area, light = float(solid.sum()), float((values * solid).sum())
    above = np.maximum(values - around, 0) * solid
    direction = above @ grid.directions[mask]
    flux = light - around * area
    floor = max(around, float(np.finfo(np.float32).tiny))
    dark = max(around, DARK * float((luminance * grid.solid_angle).sum()) / (4 * np.pi))
    signal = flux**2 / (area * dark)
    return Lamp(
        mask,
        direction / np.linalg.norm(direction),
        float(np.sqrt(area / np.pi)),
        flux,
        float(np.log2(light / area / floor)),
        signal,
        signal,
    )


def _mended(found: list[Lamp], luminance: Array, grid: Grid) -> list[Lamp]:
    """Join small lamps that a gap of a texel parts."""
    done: list[Lamp] = []
    for lamp in sorted(found, key=lambda one: -one.flux):
        near = grid.near(lamp.mask, GAP_TEXELS * grid.texel)
        is_small = lamp.radius < SMALL_TEXELS * grid.texel
        parts = [one for one in done if is_small and bool((near & one.mask).any())]
        parts = [one for one in parts if one.radius < SMALL_TEXELS * grid.texel]
        if parts:
            done = [one for one in done if one not in parts]
            mask = np.logical_or.reduce([lamp.mask, *(one.mask for one in parts)])
            around = surroundings(mask, luminance, grid)
            lamp = _measured(mask, around or 0.0, luminance, grid)
        done.append(lamp)
    return done
