# SPDX-License-Identifier: Apache-2.0
"""What of their lamps keys take: as much as their cards can show within the goals of the errors.

A card of one radiance cannot show everything. A key takes its lamp whole where that is near enough;
else the light between a floor and a level, so that what is left in the rest has the lamp's shape
and no edges of its own. All lamps of a frame may be off by the same share of their light.

Symbols: P texels around a lamp; L levels.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from asglight.keys import cards
from asglight.keys.rectangles import Card, Patch, aligned
from asglight.keys.spots import Array, Places

GOALS = np.array([0.13, 0.019, 0.0055])
"""What cards may show elsewhere than the map does, over the map's light: texel by texel, and on
balls of roughness 0.25 and 0.5. Somewhat below what the errors env, r0.25 and r0.5 are to stay at:
0.15, 0.02 and 0.006."""

LEVELS = 2.0 ** -np.arange(0, 10.5, 0.5)
"""Levels that a lamp may be cut off at, over its brightest: a thousandth is its outline."""

FLOORS = (0.0, 1 / 64, 1 / 16, 1 / 4)
"""Levels from which on a key may take light, over the mean that the light itself sees: of a bulb in
a dish, the bulb."""

FLOOR_GAIN = 1.1
"""By how much more light a key must have with a floor: without, the rest has no trace of it."""

FLOOR_DECAY = 0.7
"""Of a floor from a frame to the next, once its lamp can do without."""

FLOOR_LEAST = 1e-3
"""Where such a floor ends."""

FILLED = 0.1
"""Of the light of a key, in each channel, that dark rims of its lamp may be filled with."""

ROUNDS = 2
"""Of finding levels for cards, and cards for what is below the levels."""

BISECTIONS = 20
"""Of the share of their light that lamps may be shown elsewhere, to a millionth."""


@dataclass(frozen=True, eq=False)
class KeyCut:
    """What a key takes: of the light above the background, what lies between a floor and a level.

    Attributes:
        card: What it shows it with.
        place: Flat places of texels.  [P]
        share: Of the light there, in [0, 1].  [P]
        low: The floor, a mean radiance of the channels above the background.
        high: How much of what is above the floor it takes.
        floor: The floor over the mean of the light, weighted by itself.
        carried: Share of its lamp's light that it takes.
        apart: Share of its light that its card shows elsewhere than the map does, both ways.
    """

    card: Card
    place: Places
    share: Array
    low: float
    high: float
    floor: float
    carried: float
    apart: float


@dataclass(frozen=True, eq=False)
class Seen:
    """A lamp of a frame: its texels, their radiance above the background, and what is the key's."""

    patch: Patch
    above: Array
    share: Array
    start: Card | None
    floor: float | None
    below: Array

    @cached_property
    def solid_angle(self) -> Array:
        """Return that of each texel.  [P]."""
        return self.patch.weight.sum(-1)

    @cached_property
    def balls(self) -> list[Array]:
        """Return what balls show of the flux of each texel.  [Q, P] each."""
        return cards.balls(self.patch)

    @cached_property
    def flux(self) -> float:
        """Return the light of the lamp."""
        return float((self.share * self.above * self.solid_angle).sum())

    @cached_property
    def mean(self) -> float:
        """Return the mean of the light, weighted by itself."""
        return float((self.share * self.above**2 * self.solid_angle).sum()) / self.flux

    @cached_property
    def brightest(self) -> float:
        """Return the radiance of the brightest texel that is the lamp's and not of one beside it.

        At least the mean: what is between lamps may be brighter, and no floor is to be above it.
        """
        own = self.share >= self.share.max() / 2
        return max(float(self.above[own].max()), self.mean)

    def light(self, floor: float = 0.0, high: float = math.inf) -> Array:
        """Return the flux of each texel that is the key's.  [P]."""
        above = np.clip(self.above - floor * self.mean, 0, high)
        return self.share * above * self.solid_angle

    def net(self, floor: float = 0.0, high: float = math.inf) -> Array:
        """Return the key's flux of each texel, below 0 where it fills dark rims.  [P]."""
        light = self.light(floor, high)
        dark = self.share * self.below * self.solid_angle
        return light - dark * min(FILLED * light.sum() / max(dark.sum(), 1e-30), 1)

    def cut(self, card: Card, floor: float, high: float) -> KeyCut:
        """Return what the key takes."""
        light = self.light(floor, high)
        off = cards.off_by(card, self.patch, self.net(floor, high))
        apart = cards.apart(off) / float(light.sum())
        wide = cards.as_wide_as_a_texel(card, self.patch, light)
        turned = aligned(wide, self.start)
        carried = float(light.sum()) / self.flux
        low = floor * self.mean
        return KeyCut(turned, self.patch.place, self.share, low, high, floor, carried, apart)


@dataclass(frozen=True, eq=False)
class Fit:
    """A lamp with a floor and a card.

    Attributes:
        lamp: The lamp.
        floor: Its floor.
        card: Its card.
        levels: Those that it may be cut off at.  [L]
        errors: By how much the card is off at each, in each of the ways of `GOALS`.  [L, 3]
        light: What the key has at each, over the map's light.  [L]
    """

    lamp: Seen
    floor: float
    card: Card
    levels: Array
    errors: Array
    light: Array

    @classmethod
    def of(cls, lamp: Seen, floor: float, high: float, start: Card | None, total: float) -> "Fit":
        """Fit a card to what is between a floor and a level."""
        card = cards.fitted(lamp.patch, lamp.light(floor, high), start)
        levels = LEVELS * (lamp.brightest - floor * lamp.mean)
        rows, light = [], []
        for level in levels:
            own = lamp.net(floor, level)
            off = cards.off_by(card, lamp.patch, own)
            seen = (np.abs(ball @ off.astype(np.float32)).sum() for ball in lamp.balls)
            rows.append([cards.apart(off), *seen])
            light.append(own.sum())
        return cls(lamp, floor, card, levels, np.array(rows) / total, np.array(light) / total)

    def step(self, share: float) -> float:
        """Return the place in the levels at which so much of the lamp's light is off at most."""
        return _step(self.errors[:, 0], share * self.light[0] * self.lamp.flux / self._own)

    @property
    def _own(self) -> float:
        return float(self.lamp.light(self.floor).sum())

    def at(self, step: float) -> Array:
        """Return the errors between two levels.  [3]."""
        places = np.arange(len(self.levels))
        return np.array([np.interp(step, places, self.errors[:, k]) for k in range(3)])

    def carried(self, share: float) -> float:
        """Return the light of the key where so much of the lamp's is off at most."""
        return float(np.interp(self.step(share), np.arange(len(self.levels)), self.light))

    def high(self, step: float) -> float:
        """Return the level at a place in the levels; none at the first."""
        return math.inf if step == 0 else float(self.levels[0] * 2 ** (-step / 2))


def shown(seen: Sequence[Seen], total: float) -> list[KeyCut]:
    """Return what cards show of lamps such that all together are near enough to the map."""
    if not seen:
        return []
    share = GOALS[0] * total / sum(one.flux for one in seen)
    fits = [_floored(one, share, total) for one in seen]
    share = _allowed(fits)
    for _ in range(ROUNDS - 1):
        highs = [one.high(one.step(share)) for one in fits]
        fits = [
            Fit.of(one.lamp, one.floor, high, one.card, total) if math.isfinite(high) else one
            for one, high in zip(fits, highs, strict=True)
        ]
        share = _allowed(fits)
    return [one.lamp.cut(one.card, one.floor, one.high(one.step(share))) for one in fits]


def _floored(lamp: Seen, share: float, total: float) -> Fit:
    """Return a lamp with the floor with which its key has most light, or that of the frame before.

    A floor that was needed when the lamp was small and far goes as the lamp comes near.

    Args:
        lamp: The lamp.
        share: Of its light that may be off.
        total: Of the map's light.
    """
    if lamp.floor:
        plain = Fit.of(lamp, 0.0, math.inf, lamp.start, total)
        is_free = plain.carried(share) >= lamp.flux / total / FLOOR_GAIN
        floor = lamp.floor * FLOOR_DECAY if is_free else lamp.floor
        if floor < FLOOR_LEAST:
            return plain
        return Fit.of(lamp, floor, math.inf, lamp.start, total)
    best = Fit.of(lamp, 0.0, math.inf, lamp.start, total)
    if lamp.floor is not None:
        return best
    for floor in FLOORS[1:]:
        if best.carried(share) >= lamp.flux / total / FLOOR_GAIN:
            break
        one = Fit.of(lamp, floor, math.inf, None, total)
        if one.carried(share) > FLOOR_GAIN * best.carried(share):
            best = one
    return best


def _allowed(fits: Sequence[Fit]) -> float:
    """Return the share of its light that each lamp may be off by with all within the goals.

    It is the same for all, so that no key jumps when another one comes or goes.
    """

    def is_within(share: float) -> bool:
        found = sum((one.at(one.step(share)) for one in fits), np.zeros(3))
        return bool((found <= GOALS).all())

    low, high = 0.0, 2.0
    if is_within(high):
        return high
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_within(middle) else (low, middle)
    return low


def _step(errors: Array, most: float) -> float:
    """Return the first place in levels, between two of them, at which a lamp is near enough."""
    within = np.flatnonzero(errors <= most)
    if not len(within):
        return len(errors) - 1.0
    first = int(within[0])
    if first == 0:
        return 0.0
    above, below = errors[first - 1], errors[first]
    return first - 1 + float((above - most) / (above - below))


def whole(seen: Sequence[Seen]) -> list[KeyCut]:
    """Return the cards that hold all light of the lamps."""
    return [
        one.cut(cards.holding(one.patch, one.light(), one.start), 0.0, math.inf) for one in seen
    ]
