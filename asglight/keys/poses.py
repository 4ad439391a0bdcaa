# SPDX-License-Identifier: Apache-2.0
"""The pose of a lamp: how a rectangle stands in space whose outline is the lamp's.

The outline of a rectangle seen from the origin says how it stands, up to its distance: its pairs of
sides meet in two vanishing points, which are its sides' directions. Pose and size are fitted to the
whole outline at once by least squares, as corners of a few texels are none to rely on.

Symbols: P texels around a lamp.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy import optimize
from scipy.spatial.transform import Rotation

from asglight.keys.rectangles import Card, Patch
from asglight.keys.spots import Array
from asglight.sphere.turns import turn_between

PROBE = 1e-6
"""Of derivatives of a card's numbers by differences: of its size, or in radians."""

REACH = 0.1
"""First step at most, over a card's size, or in radians. Of 181 searches in a tunnel 20 end half as
far off again as the best or farther; with 0.03 it is 25, with 1 and with no bound 22 and 28."""

DONE = 1e-5
"""Of what is left of the outline, and of the steps: smaller ones are the last."""

EVALUATIONS = 60
"""Of the outline, at most. Length and slant of a tube look nearly the same, which takes forty
steps; others take ten."""

GROWTH_MOST = 3.0
"""Logarithm of a card's growth in a search, at most: by 20."""

LOST, LOST_GAIN = 2e-3, 0.5
"""What is left of an outline, over its size, above which a lamp is not followed but found anew; and
how much less that must leave."""

UPRIGHT = 0.01
"""Weight of the sine of a card's slant, over the root of the share of its outline that differs: a
slant that shows in less than a ten-thousandth of the outline is none."""

STEEP = 0.97
"""Sine of the most slant, of 76 degrees: an outline says nothing of the length of a line."""

TURNS = (0.0, np.pi / 4)
"""Of a card that faces the origin, about its middle, at which a search may start: a lamp that hangs
slanted about its diagonal is longest along it."""


def outline(patch: Patch, light: Array) -> Array:
    """Return which share of each texel is of a lamp, by its light.  [P].

    A texel is all of the lamp that is as bright as those that half of the light comes from: that
    is any but those on the rim where the lamp is even, and not its bulb alone where it is not.

    Args:
        patch: The texels around the lamp.
        light: Flux of each.  [P]
    """
    solid = patch.weight.sum(-1)
    radiance = light / solid
    order = np.argsort(radiance)
    middle = np.searchsorted(light[order].cumsum(), light.sum() / 2)
    return np.minimum(radiance / radiance[order[middle]], 1)


def posed(patch: Patch, light: Array, facing: Card) -> Card:
    """Return the rectangle in space whose outline is nearest to that of a lamp.

    Of two that have nearly the same outline, hung towards the viewer and away, the nearer one.

    Args:
        patch: The texels around the lamp.
        light: Flux of each, not all 0.  [P]
        facing: A card about there that faces the origin.
    """
    cost = _Outline(patch, outline(patch, light))
    found = [cost.nearest(card) for card in _changed(facing, _turns(TURNS))]
    found += [cost.nearest(_mirrored(card)) for card, _ in found]
    return min(found, key=lambda one: one[1])[0]


def followed(patch: Patch, light: Array, start: Card, facing: Card) -> Card:
    """Return likewise the rectangle that is next to one: that of the frame before.

    Where that does not lead to the lamp's outline it is looked for anew.

    Args:
        patch: The texels around the lamp.
        light: Flux of each, not all 0.  [P]
        start: The card, about where the lamp is now.
        facing: One that faces the origin, there.
    """
    share = outline(patch, light)
    cost = _Outline(patch, share)
    card, left = cost.nearest(start)
    if left > LOST:
        anew = posed(patch, light, facing)
        other, less = cost.nearest(anew)
        card = other if less < LOST_GAIN * left else card
    return card


class _Outline:
    """How far cards are off the outline of a lamp."""

    def __init__(self, patch: Patch, share: Array) -> None:
        self._patch, self._share = patch, share
        self._solid = patch.weight.sum(-1)
        self._scale = np.sqrt(self._solid / (share * self._solid).sum())

    def nearest(self, card: Card) -> tuple[Card, float]:
        """Return the nearest card from a start on, and what is left [Levenberg, Marquardt]."""
        slopes: Any = partial(self._slopes, card)  # scipy without stubs reads as if it were a name
        found = optimize.least_squares(
            lambda step: self._residual(*_changed(card, step[None])),
            np.zeros(7),
            jac=slopes,
            method="lm",
            x_scale=REACH / 100,  # of which MINPACK's first step is at most a hundred
            ftol=DONE,
            xtol=DONE,
            max_nfev=EVALUATIONS,
        )
        [best] = _changed(card, found.x[None])
        return best, 2 * float(found.cost)

    def _residual(self, card: Card) -> Array:
        """Return what differs of each texel, and the slant.  [P + 2]."""
        if np.hypot(*card.foot[:2]) > STEEP:
            return np.full(len(self._share) + 2, 1e3)
        covered = self._patch.covered(card) / self._solid
        return np.concatenate([self._scale * (covered - self._share), UPRIGHT * card.foot[:2]])

    def _slopes(self, card: Card, step: Array) -> Array:
        """Return the derivative of `_residual` with the step that changes a card.  [P + 2, 7]."""
        here, *there = _changed(card, step + PROBE * np.eye(8, 7, -1))
        more = self._patch.covered_more(here, there) / self._solid[:, None]
        feet = np.stack([one.foot[:2] - here.foot[:2] for one in there], -1)
        return np.concatenate([self._scale[:, None] * more, UPRIGHT * feet]) / PROBE


def _turns(angles: Sequence[float]) -> Array:
    """Return steps that turn a card about its middle.  [N, 7]."""
    steps = np.zeros((len(angles), 7))
    steps[:, 4] = angles
    return steps


def _changed(card: Card, steps: Array) -> list[Card]:
    """Return a card moved, turned about its middle, and grown, in several ways.

    Args:
        card: The card.
        steps: Its way along its sides, over its size; axis times angle of the turn, in its own
            frame; logarithms of its growth.  [N, 7]
    """
    size = float(card.seen_extent.max())
    middles = card.middle + size * (steps[:, :2] @ card.axes[:2])
    middles /= np.linalg.norm(middles, axis=-1, keepdims=True)
    moved = card.axes @ turn_between(card.middle, middles).swapaxes(-1, -2)
    turned = Rotation.from_rotvec(steps[:, 2:5]).as_matrix().swapaxes(-1, -2) @ moved
    extents = card.extent * np.exp(np.clip(steps[:, 5:], -GROWTH_MOST, GROWTH_MOST))
    return [Card(*one) for one in zip(turned, extents, middles, strict=True)]


def _mirrored(card: Card) -> Card:
    """Return the card that hangs the other way, and is seen alike from far off."""
    across = np.eye(3) - 2 * np.outer(card.middle, card.middle)  # nearer becomes farther
    x, y = card.axes[:2] @ across
    return Card(np.stack([x, y, np.cross(x, y)]), card.extent, card.middle)
