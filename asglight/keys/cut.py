# SPDX-License-Identifier: Apache-2.0
"""A frame cut into keys and rest, whose sum is the map.

Cuts are found on a map of `ROWS` rows at most and made on a map of any size: what is found are the
background and, for each key, which share of the light above it the key takes.

Symbols: h, w rows and columns of the map that cuts are found on; H, W of the map that is cut.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from asglight.keys import cards, cutting
from asglight.keys.cards import Card, Patch
from asglight.keys.spots import Array, Grid, Mask, Places
from asglight.sphere import latlong

ROWS = 256
"""Rows of the map that cuts are found on: texels of 0.7 degrees, a sun and its edge."""

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

MARGIN_TEXELS = 3
"""Around a matte, in which a card may show light too."""

ROUNDS = 2
"""Of finding levels for cards, and cards for what is below the levels."""

BISECTIONS = 20
"""Of the share of their light that lamps may be shown elsewhere, to a millionth."""


@dataclass(frozen=True, eq=False)
class Wanted:
    """A key of a frame.

    Attributes:
        mask: Its lamp.  [h, w]
        weight: How far it is up, in [0, 1].
        start: The card of the frame before, moved with its lamp; None for a new one.
        floor: As of its cut in the frame before; None for a new one.
    """

    mask: Mask
    weight: float
    start: Card | None = None
    floor: float | None = None


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
class FrameCut:
    """How a frame is cut.

    Attributes:
        background: What fills the holes.  [h, w, 3] float32
        keys: In the order of what was wanted; None where there is no light to take.
        holes: Where mattes are.  [h, w]
    """

    background: Tensor
    keys: tuple[KeyCut | None, ...]
    holes: Mask


def frame_cut(
    radiance: Tensor, wanted: Sequence[Wanted], others: Sequence[Mask], *, whole: bool = False
) -> FrameCut:
    """Find how a frame is cut.

    Args:
        radiance: The map.  [h, w, 3]
        wanted: Its keys.
        others: Its other lamps, which are no background to what lies beside them.
        whole: Take all of the lamps' light, whatever a plain card can show: cards get a texture,
            and hold the lamps.
    """
    values = radiance.double().numpy()
    grid = Grid.of(*values.shape[:2])
    mattes = [cutting.matte(one.mask, grid) for one in wanted]
    holes = np.zeros(values.shape[:2], dtype=bool)
    for one in mattes:
        holes |= one > 0
    beside = [cutting.matte(mask, grid) for mask in others]
    every = sum([*mattes, *beside], np.zeros(holes.shape))
    closed = every > 0
    background = cutting.filled(values, closed, grid)
    background = np.where(holes[..., None], background, values)
    above = np.maximum((values - background).mean(-1), 0)
    total = float((values.mean(-1) * grid.solid_angle).sum())
    seen: list[_Seen | None] = []
    for one, own in zip(wanted, mattes, strict=True):
        near = grid.near(own > 0, MARGIN_TEXELS * grid.texel)
        place = np.flatnonzero(near)
        share = one.weight * (own / np.maximum(every, 1)).ravel()[place]
        patch = Patch.of(place, grid)
        lamp = _Seen(patch, above.ravel()[place], share, one.start, one.floor)
        seen.append(lamp if lamp.flux > 0 else None)
    lit = [one for one in seen if one is not None]
    chosen = iter(_whole(lit) if whole else _shown(lit, total))
    return FrameCut(
        torch.from_numpy(background).float(),
        tuple(None if one is None else next(chosen) for one in seen),
        holes,
    )


@dataclass(frozen=True, eq=False)
class _Seen:
    """A lamp of a frame: its texels, their radiance above the background, and what is the key's."""

    patch: Patch
    above: Array
    share: Array
    start: Card | None
    floor: float | None

    @cached_property
    def solid_angle(self) -> Array:
        """Return that of each texel.  [P]."""
        return self.patch.weight.sum(-1)

    @cached_property
    def flux(self) -> float:
        """Return the light of the lamp."""
        return float((self.share * self.above * self.solid_angle).sum())

    @cached_property
    def mean(self) -> float:
        """Return the mean of the light, weighted by itself."""
        return float((self.share * self.above**2 * self.solid_angle).sum()) / self.flux

    def light(self, floor: float = 0.0, high: float = math.inf) -> Array:
        """Return the flux of each texel that is the key's.  [P]."""
        above = np.clip(self.above - floor * self.mean, 0, high)
        return self.share * above * self.solid_angle

    def cut(self, card: Card, floor: float, high: float) -> KeyCut:
        """Return what the key takes."""
        light = self.light(floor, high)
        apart = cards.apart(cards.off_by(card, self.patch, light)) / float(light.sum())
        aligned = cards.aligned(card, self.start)
        carried = float(light.sum()) / self.flux
        low = floor * self.mean
        return KeyCut(aligned, self.patch.place, self.share, low, high, floor, carried, apart)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A lamp with a floor and a card.

    Attributes:
        lamp: The lamp.
        floor: Its floor.
        card: Its card.
        levels: Those that it may be cut off at.  [L]
        errors: By how much the card is off at each, in each of the ways of `GOALS`.  [L, 3]
        light: What the key has at each, over the map's light.  [L]
    """

    lamp: _Seen
    floor: float
    card: Card
    levels: Array
    errors: Array
    light: Array

    @classmethod
    def of(cls, lamp: _Seen, floor: float, high: float, start: Card | None, total: float) -> "_Fit":
        """Fit a card to what is between a floor and a level."""
        card = cards.fitted(lamp.patch, lamp.light(floor, high), start)
        levels = LEVELS * (lamp.above.max() - floor * lamp.mean)
        balls = cards.balls(lamp.patch)
        rows, light = [], []
        for level in levels:
            own = lamp.light(floor, level)
            off = cards.off_by(card, lamp.patch, own)
            seen = (np.abs(ball @ off.astype(np.float32)).sum() for ball in balls)
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


def _shown(seen: Sequence[_Seen], total: float) -> list[KeyCut]:
    """Return what cards show of lamps such that all together are near enough to the map."""
    if not seen:
        return []
    share = GOALS[0] * total / sum(one.flux for one in seen)
    fits = [_floored(one, share, total) for one in seen]
    share = _allowed(fits)
    for _ in range(ROUNDS - 1):
        highs = [one.high(one.step(share)) for one in fits]
        fits = [
            _Fit.of(one.lamp, one.floor, high, one.card, total) if math.isfinite(high) else one
            for one, high in zip(fits, highs, strict=True)
        ]
        share = _allowed(fits)
    return [one.lamp.cut(one.card, one.floor, one.high(one.step(share))) for one in fits]


def _floored(lamp: _Seen, share: float, total: float) -> _Fit:
    """Return a lamp with the floor with which its key has most light, or that of the frame before.

    A floor that was needed when the lamp was small and far goes as the lamp comes near.

    Args:
        lamp: The lamp.
        share: Of its light that may be off.
        total: Of the map's light.
    """
    if lamp.floor:
        plain = _Fit.of(lamp, 0.0, math.inf, lamp.start, total)
        is_free = plain.carried(share) >= lamp.flux / total / FLOOR_GAIN
        floor = lamp.floor * FLOOR_DECAY if is_free else lamp.floor
        if floor < FLOOR_LEAST:
            return plain
        return _Fit.of(lamp, floor, math.inf, lamp.start, total)
    best = _Fit.of(lamp, 0.0, math.inf, lamp.start, total)
    if lamp.floor is not None:
        return best
    for floor in FLOORS[1:]:
        if best.carried(share) >= lamp.flux / total / FLOOR_GAIN:
            break
        one = _Fit.of(lamp, floor, math.inf, None, total)
        if one.carried(share) > FLOOR_GAIN * best.carried(share):
            best = one
    return best


def _allowed(fits: Sequence[_Fit]) -> float:
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


def _whole(seen: Sequence[_Seen]) -> list[KeyCut]:
    """Return the cards that hold all light of the lamps."""
    return [one.cut(cards.holding(one.patch, one.light()), 0.0, math.inf) for one in seen]


@dataclass(frozen=True, eq=False)
class Parts:
    """A map in parts.

    Attributes:
        rest: The map without its keys, >= 0.  [H, W, 3]
        flux: Of each key, radiance times solid angle.  [K, 3]
    """

    rest: Tensor
    flux: Tensor


def parts(cut: FrameCut, radiance: Tensor) -> Parts:
    """Cut a map of any size.

    Args:
        cut: How.
        radiance: The map.  [H, W, 3]
    """
    height, width = radiance.shape[:2]
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    rest = radiance.clone()
    flux = torch.zeros(len(cut.keys), 3, dtype=torch.float64)
    for index in range(len(cut.keys)):
        rows, light = light_of(cut, index, radiance)
        flux[index] = (light.double() * solid_angle[rows][..., None]).sum((0, 1))
        rest[rows] -= light
    return Parts(rest.clamp(min=0), flux)


def light_of(cut: FrameCut, index: int, radiance: Tensor) -> tuple[slice, Tensor]:
    """Return what a key takes from a map; where the map is darker than the background, it gives.

    Filters that overshoot leave dark rims around lamps, which are filled so.

    Args:
        cut: How it is cut.
        index: Of the key.
        radiance: The map.  [H, W, 3]

    Returns:
        Rows of the map, and the radiance taken there.  [rows, W, 3]
    """
    key, shape = cut.keys[index], cut.background.shape[:2]
    if key is None:
        return slice(0, 0), radiance[:0]
    image = torch.zeros(shape[0] * shape[1], dtype=torch.float32)
    image[torch.from_numpy(key.place)] = torch.from_numpy(key.share).float()
    share = enlarged(image.view(*shape, 1), len(radiance))
    used = torch.nonzero(share.amax((1, 2)) > 0)[:, 0]
    rows = slice(int(used.min()), int(used.max()) + 1)
    above = radiance[rows] - enlarged(cut.background, len(radiance))[rows]
    mean = above.mean(-1, keepdim=True)
    part = (mean - key.low).clamp(0, key.high) / mean.clamp(min=1e-30)
    light = share[rows] * above * torch.where(mean > 0, part, 1.0)
    solid_angle = latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64)[rows]
    weight = solid_angle[..., None]
    given = (light.clamp(max=0) * weight).sum((0, 1))  # [3], below 0
    taken = (light.clamp(min=0) * weight).sum((0, 1))
    most = (FILLED * taken / (-given).clamp(min=1e-30)).clamp(max=1)
    return rows, torch.where(light < 0, light * most.to(light), light)


def enlarged(image: Tensor, height: int) -> Tensor:
    """Interpolate a map linearly between its texel centres; what has the size stays as it is.

    Beyond the outermost rows it is theirs, as renderers show it.

    Args:
        image: [h, w, C]
        height: H; W is 2 H.

    Returns:
        [H, W, C]
    """
    rows, columns = image.shape[:2]
    if rows == height:
        return image
    v = ((torch.arange(height, dtype=torch.float64) + 0.5) * rows / height - 0.5).clamp(0, rows - 1)
    u = (torch.arange(2 * height, dtype=torch.float64) + 0.5) * columns / (2 * height) - 0.5
    top, left = v.floor(), u.floor()
    above, below = top.long(), (top.long() + 1).clamp(max=rows - 1)
    image = torch.lerp(image[above], image[below], (v - top).to(image)[:, None, None])
    left_place = left.long() % columns
    part = (u - left).to(image)[:, None]
    return torch.lerp(image[:, left_place], image[:, (left_place + 1) % columns], part)
