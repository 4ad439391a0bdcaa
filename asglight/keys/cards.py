# SPDX-License-Identifier: Apache-2.0
"""The card of a lamp: the rectangle that shows its light best.

All of a card has one radiance, and it has the flux of its lamp. Its place, turn and size are those
with which it differs least from the lamp: texel by texel, and as glossy balls see both.

Symbols: P texels around a lamp; S points in each.
"""

import numpy as np
import torch
from scipy import optimize
from scipy.spatial import ConvexHull

from asglight.keys.poses import followed, posed
from asglight.keys.rectangles import (
    Card,
    Patch,
    frame,
    frame_of,
    half_extent,
)
from asglight.keys.spots import Array, Grid
from asglight.shading import kernels
from asglight.sphere.quadrature import fibonacci_directions
from asglight.sphere.turns import turn_between

FINE = 0.25
"""Of the half width of a lamp: larger texels would not tell its sides."""

TEXELS = 800
"""Of a lamp, with which its card is searched, at most: 0.7 degrees of a lamp of 20."""

BALLS = (0.25, 0.5)
"""Roughness of the balls."""

APART_WEIGHT, BALL_WEIGHTS = 0.3, (4.0, 12.0)
"""Of what differs texel by texel and on the balls: about in inverse proportion to what each may be
(`asglight.keys.cut`), so that none is bought with another."""

CENTRE_WEIGHT = 10.0
"""Of the flux times the way that a card's middle is off its lamp's mean direction, in radians: what
turns shadows and Lambert's cosine. Within a texel nothing else would tell where a card is."""

STEADY_WEIGHT = 2e-3
"""Of the logarithm of a card's size against that of the lamp's moments. A lamp of one texel is
shown as well by any card within it."""

UNSEEN = 1e-3
"""Of a kernel's peak, below which a direction is left out."""

DIRECTIONS = fibonacci_directions(768, dtype=torch.float64).numpy()
"""In which balls are looked at, as the errors are judged.  [768, 3]"""

SAMPLED = 0.97
"""Of a card's solid angle, that the points of a patch find of it at least."""

HELD_MIN = 1e-3
"""Of a lamp's brightest texel: fainter ones at its rim do not make a card larger."""

LEVEL = 0.1
"""Sine of the angle between a slanted card's plane and what it is to hold, at least."""

SCALES = (1.0, 0.7, 0.45, 0.25)
"""Sizes of the cards that a search may start with, over that of the lamp's moments: of a bulb in a
dish the moments are the dish's."""

BRIGHTEST = 300
"""Texels among which the brightest place of such a size is looked for."""

COLD, WARM = 0.25, 0.1
"""First step of a search, over a card's size: from nothing, and from the frame before."""

FACING_APART = 0.04
"""Of a lamp's light, times its narrow over its long side: with less off, a card that faces the
origin shows it. The ends of a strip that are cut aslant are off by so much less light than their
corners are off by."""

SLANT_TEXELS = 0.6
"""Half of a lamp's narrow side, in texels, below which it has no outline to tell a slant by."""

HOPELESS = 2.0
"""Such a cost before the search, above which there is none."""

SLANT_GAIN = 0.6
"""Cost of a slanted card over that of one that faces the origin, above which it is not worth its
two numbers: of lamps that are no rectangle."""

EVALUATIONS = 300
"""Of the search, at most; it ends by itself after 150 to 300."""


def moment_card(patch: Patch, light: Array) -> Card:
    """Return the card of the mean direction and the second moments of some light.

    Args:
        patch: Where it comes from.
        light: Flux of each texel.  [P]
    """
    share = patch.weight / patch.weight.sum(-1, keepdims=True) * light[:, None]
    axes = frame_of((share[..., None] * patch.points).sum((0, 1)))
    local = (patch.points @ axes[:2].T).reshape(-1, 2)
    second = (local * share.reshape(-1, 1)).T @ local / share.sum()
    squares, vectors = np.linalg.eigh(second)
    x = vectors[:, 1] @ axes[:2]
    axes = frame(x, axes[2])
    return Card.facing(axes, half_extent(np.maximum(squares[::-1], patch.softness**2 / 12)))


def fitted(patch: Patch, light: Array, start: Card | None = None) -> Card:
    """Return the card that shows the light of a lamp best, where the lamp is.

    It faces the origin unless its lamp is large enough to have an outline, which a slanted card has
    far more nearly; one that was slanted in the frame before stays so, that it does not jump.

    Args:
        patch: The texels around the lamp.
        light: Flux of each, not all 0.  [P]
        start: Of the search; None for the best of cards of several sizes on the lamp.
    """
    texel = np.pi / patch.shape[0]
    patch, light = coarse(patch, light)
    cost = _Cost(patch, light)
    if start is not None and not start.is_facing:
        return _nearest(cost, followed(patch, light, start, moment_card(patch, light)), WARM)
    tried = [start] if start is not None else starts(patch, light)
    facing = _nearest(cost, min(tried, key=cost), COLD if start is None else WARM)
    off = apart(off_by(facing, patch, light)) / float(light.sum())
    narrow, long = np.sort(facing.extent)
    if off < FACING_APART * narrow / long or narrow < SLANT_TEXELS * texel:
        return facing
    slanted = posed(patch, light, facing)
    if cost(slanted) > HOPELESS * cost(facing):
        return facing
    slanted = _nearest(cost, slanted, WARM)
    return slanted if cost(slanted) < SLANT_GAIN * cost(facing) else facing


def as_wide_as_a_texel(card: Card, patch: Patch, light: Array) -> Card:
    """Return a card that is no narrower than the brightest texel of its lamp, near a pole.

    Texels there are narrower than the edge of a card is soft, so that the search does not tell one
    card within them from another.

    Args:
        card: The card.
        patch: The texels around the lamp.
        light: Flux of each.  [P]
    """
    brightest = int(light.argmax())
    height = np.pi / patch.shape[0]
    width = float(patch.weight[brightest].sum()) / height
    if not card.is_facing or width > 2 * patch.softness:
        return card
    texel = patch.points[brightest]
    across = (texel - texel.mean(0)) @ card.axes[:2].T
    own = np.sqrt(3 * (across**2).mean(0))  # half of what it spans along both sides
    return Card.facing(card.axes, np.maximum(card.extent, own))


def _nearest(cost: "_Cost", first: Card, reach: float) -> Card:
    """Return the card of least cost, as slanted as the first [Nelder and Mead 1965].

    Args:
        cost: What it costs.
        first: Where the search starts.
        reach: Its first steps, over the card's size.
    """
    simplex = np.concatenate([np.zeros((1, 5)), reach * np.eye(5)])
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 1e-3, "fatol": 1e-5}
    best = optimize.minimize(
        lambda step: cost(_changed(first, step)), np.zeros(5), method="Nelder-Mead", options=options
    )
    return _changed(first, best.x)


def coarse(patch: Patch, light: Array) -> tuple[Patch, Array]:
    """Return a patch of fewer, larger texels, where there are more than the search needs.

    Args:
        patch: Texels of a map.
        light: Flux of each.  [P]
    """
    height, width = patch.shape
    narrow = float(moment_card(patch, light).extent.min())
    factor = 1
    while (
        len(patch.place) > TEXELS * factor**2
        and height % (2 * factor) == 0
        and 2 * factor * np.pi / height < FINE * narrow
    ):
        factor *= 2
    if factor == 1:
        return patch, light
    row, column = np.divmod(patch.place, width)
    block = row // factor * (width // factor) + column // factor
    place, index = np.unique(block, return_inverse=True)
    grid = Grid.of(height // factor, width // factor)
    return Patch.of(place, grid), np.bincount(index, light, len(place)).astype(np.float64)


def off_by(card: Card, patch: Patch, light: Array) -> Array:
    """Return by how much a card of a lamp's flux differs from the lamp at each texel.  [P].

    The sum is 0, or what of the card lies beyond the patch, below 0.
    """
    cover = patch.covered(card)
    # sums over points are a little off the solid angle of a card of a few of them
    whole = max(float(cover.sum()), SAMPLED * card.solid_angle)
    return cover * (light.sum() / whole) - light


def apart(off: Array) -> float:
    """Return the light that a card shows elsewhere than its lamp, both ways, also beyond a patch.

    Args:
        off: As of `off_by`.  [P]
    """
    return float(np.abs(off).sum() + abs(off.sum()))


def _changed(card: Card, step: Array) -> Card:
    """Return a card moved in units of its size, turned, and grown by logarithms.  [5]."""
    size = float(card.extent.max())
    middle = card.middle + size * (step[0] * card.axes[0] + step[1] * card.axes[1])
    middle /= np.linalg.norm(middle)
    axes = card.turned(turn_between(card.middle, middle)).axes
    x = np.cos(step[2]) * axes[0] + np.sin(step[2]) * axes[1]
    z = middle if card.is_facing else axes[2]
    return Card(frame(x, z), card.extent * np.exp(step[3:]), middle)


def starts(patch: Patch, light: Array) -> list[Card]:
    """Return cards of several sizes, about the mean of a lamp and about where it is brightest."""
    card = moment_card(patch, light)
    centre = patch.centres
    found = []
    for scale in SCALES:
        width = scale * float(card.extent.max())
        some = np.argsort(-light)[:BRIGHTEST]
        near = np.exp(-(1 - np.clip(centre[some] @ centre.T, -1, 1)) / width**2)
        mean = (near @ light) / (near @ patch.weight.sum(-1))
        for z in (card.axes[2], centre[some[int(mean.argmax())]]):
            axes = frame(card.axes[0], z)
            found.append(Card.facing(axes, scale * card.extent))
            even = np.full(2, scale * np.sqrt(card.extent.prod()))
            found.append(Card.facing(axes, even))
    return found


class _Cost:
    """How far a card is off in what it shows of a lamp."""

    def __init__(self, patch: Patch, light: Array) -> None:
        self._patch, self._light = patch, light / light.sum()
        self._balls = balls(patch)
        self._usual = moment_card(patch, light)

    def __call__(self, card: Card) -> float:
        off = off_by(card, self._patch, self._light)
        single = off.astype(np.float32)
        far = sum(
            weight * float(np.abs(ball @ single).sum())
            for ball, weight in zip(self._balls, BALL_WEIGHTS, strict=True)
        )
        return (
            APART_WEIGHT * apart(off)
            + far
            + CENTRE_WEIGHT * float(np.linalg.norm(self._off_centre(card)))
            + STEADY_WEIGHT * float((np.log(card.seen_extent / self._usual.extent) ** 2).sum())
        )

    def _off_centre(self, card: Card) -> Array:
        """Return how far the mean direction of a card is from that of the lamp.  [3]."""
        return card.centre - self._usual.middle


def balls(patch: Patch) -> list[Array]:
    """Return matrices from the flux of texels to what balls show of it.

    A row is a direction in which a ball of roughness 0.25, or 0.5, is looked at with N = V = R, as
    the errors r0.25 and r0.5 are judged; they sum to 1 over all directions.

    Returns:
        [Q, P] each; directions in which next to nothing is seen are left out.
    """
    cosine = torch.from_numpy(DIRECTIONS @ patch.centres.T).float()  # to 2e-5 of a kernel's peak
    nearest = cosine.amax(1)
    solid_angle = 4 * np.pi / len(DIRECTIONS)
    found = []
    for roughness in BALLS:
        most = kernels.kernel_values(roughness, nearest)  # it falls off with the angle
        seen = most > UNSEEN * most.max()
        share = solid_angle / kernels.ggx_integral(roughness)
        found.append((share * kernels.kernel_values(roughness, cosine[seen])).numpy())
    return found


def holding(patch: Patch, light: Array, start: Card | None = None) -> Card:
    """Return the smallest rectangle that holds the light of a lamp.

    One that is slanted stands as the card that shows the lamp best. Else it lies about the middle
    of the light, turned as the least rectangle around it is; a side is parallel to one of the
    convex hull's [Freeman and Shapira 1975, "Determining the minimum-area encasing rectangle for
    an arbitrary closed curve"].

    Args:
        patch: The texels around the lamp.
        light: Flux of each, not all 0.  [P]
        start: The card of the frame before; None where there is none.
    """
    points = patch.points[light > HELD_MIN * light.max()].reshape(-1, 3)
    best = fitted(patch, light, start)
    if not best.is_facing and (points @ best.axes[2]).min() > LEVEL:
        return grown(best, points, patch.softness)
    axes = moment_card(patch, light).axes
    for _ in range(4):  # the middle of the rectangle moves the plane, and that the rectangle
        local = points @ axes.T
        plane = local[:, :2] / local[:, 2:]
        angle, low, high = _rectangle(plane)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        middle = np.append((low + high) / 2 @ turn, 1) @ axes
        z = middle / np.linalg.norm(middle)
        x = turn[0] @ axes[:2]
        axes = frame(x, z)
    local = points @ axes.T
    extent = np.abs(local[:, :2] / local[:, 2:]).max(0) + patch.softness
    return Card.facing(axes, extent)


def grown(card: Card, points: Array, margin: float) -> Card:
    """Return the rectangle in the plane of a card, along its sides, that holds points.

    Args:
        card: The card.
        points: Directions that meet its plane.  [N, 3]
        margin: Around the points, a tangent.
    """
    local = points @ card.axes.T
    sides = local[:, :2] * (card.foot[2] / local[:, 2:])  # from the foot of the perpendicular
    margins = margin * card.extent / card.seen_extent
    low, high = sides.min(0) - margins, sides.max(0) + margins
    middle = np.append((low + high) / 2, card.foot[2]) @ card.axes
    distance = float(np.linalg.norm(middle))
    return Card(card.axes, (high - low) / 2 / distance, middle / distance)


def _rectangle(points: Array) -> tuple[float, Array, Array]:
    """Return the turn of the smallest rectangle around points [N, 2] and its corners in it."""
    hull = points[ConvexHull(points).vertices]
    sides = np.roll(hull, -1, axis=0) - hull
    best = None
    for angle in np.arctan2(sides[:, 1], sides[:, 0]) % (np.pi / 2):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        turned = hull @ turn.T
        low, high = turned.min(0), turned.max(0)
        area = float((high - low).prod())
        if best is None or area < best[0]:
            best = (area, float(angle), low, high)
    assert best is not None
    return best[1:]
