# SPDX-License-Identifier: Apache-2.0
"""Maps and shots with lamps that are known, drawn by chance: cases of `measure.py`.

A case has a kind: rectangles anywhere, beside a pole, across the seam or slanted; a sun with its
glow; a window with frames; forty lamps; noise; and shots of a lamp that passes, a cloud before the
sun, a lamp that clips, and a camera that turns. Texels are means along rays.

Symbols: H, W rows and columns; P directions.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from torch import Tensor

from asglight.sphere import latlong

Array = NDArray[np.float64]
Light = Callable[[Array], Array]
"""Radiance [P, 3] in directions [P, 3]."""

RAYS = 5
"""Through a texel, each way."""

FRAMES = 8
"""Of a shot."""

SUN_RADIUS = np.radians(0.265)


@dataclass(frozen=True)
class Quad:
    """A flat lamp of four corners.

    Attributes:
        corners: Their directions, in order around it.  [4, 3]
        radiance: [3]
        bars: Frames in each direction that divide it.
    """

    corners: Array
    radiance: Array
    bars: int = 0

    def covers(self, directions: Array) -> NDArray[np.bool_]:
        """Tell which directions it is seen in.  [P]."""
        sides = np.cross(self.corners, np.roll(self.corners, -1, axis=0))
        middle = self.corners.mean(0)
        sides *= np.sign(sides @ middle)[:, None]
        seen = (directions @ sides.T > 0).all(-1) & (directions @ middle > 0)
        if self.bars:
            first, second = self.corners[0] - self.corners[1], self.corners[0] - self.corners[3]
            normal = np.cross(first, second)
            depth = np.where(seen, directions @ normal, 1)
            points = directions * (self.corners[2] @ normal / depth)[:, None]
            for side in (first, second):
                at = (points - self.corners[2]) @ side / (side @ side) * (self.bars + 1)
                seen &= (np.abs(at - np.round(at)) > 0.06) | (np.round(at) % (self.bars + 1) == 0)
        return seen


@dataclass(frozen=True)
class Case:
    """A map, or a shot of several.

    Attributes:
        name: Kind and number.
        frames: [H, W, 3] each.
        quads: Lamps of the first frame that are one rectangle each, whose corners are judged.
    """

    name: str
    frames: list[Tensor]
    quads: list[Quad] = field(default_factory=list)


def cases(count: int, seed: int, rows: int) -> Iterator[Case]:
    """Make cases, of each kind in turn.

    Args:
        count: How many.
        seed: Of chance.
        rows: H.
    """
    kinds = list(KINDS)
    for index in range(count):
        random = np.random.default_rng([seed, index])
        frames, quads = KINDS[kinds[index % len(kinds)]](random, rows)
        yield Case(f"{kinds[index % len(kinds)]} {index + 1}", frames, quads)


Made = tuple[list[Tensor], list[Quad]]


def picture(rows: int, lights: list[Light]) -> Tensor:
    """Return the sum of lights, each texel the mean along rays through it.  [H, W, 3]."""
    inner = (torch.arange(RAYS, dtype=torch.float64) + 0.5) / RAYS
    v = (torch.arange(rows, dtype=torch.float64)[:, None] + inner).flatten() / rows
    u = (torch.arange(2 * rows, dtype=torch.float64)[:, None] + inner).flatten() / (2 * rows)
    v, u = torch.meshgrid(v, u, indexing="ij")
    directions = latlong.direction_from_uv(u, v).numpy().reshape(-1, 3)
    total = sum(light(directions) for light in lights)
    weight = torch.cos(torch.pi * (0.5 - v))[..., None]
    values = torch.from_numpy(total).view(*v.shape, 3) * weight
    shape = rows, RAYS, 2 * rows, RAYS, -1
    return (values.view(shape).sum((1, 3)) / weight.view(shape).sum((1, 3))).float()


def room(random: np.random.Generator) -> Light:
    """Return walls with stains: a gradient and waves of several lengths, about 0.2 to 1."""
    waves = random.normal(size=(6, 3)) * random.uniform(1, 8, (6, 1))
    phase, size = random.uniform(0, 6, 6), random.uniform(0.02, 0.15, 6)
    tint, up = random.uniform(0.7, 1, 3), random.normal(size=3) * 0.3

    def light(directions: Array) -> Array:
        stains = (np.sin(directions @ waves.T + phase) * size).sum(-1)
        return 0.4 * tint * np.exp(directions @ up + stains)[:, None]

    return light


def rectangle(
    random: np.random.Generator, middle: Array, stops: tuple[float, float] = (5, 9)
) -> Quad:
    """Return a rectangle that faces the origin, of 4 to 30 degrees, 5 to 9 stops above a room."""
    size = np.radians(random.uniform(4, 30, 2))
    x = np.cross(middle, random.normal(size=3))
    x /= np.linalg.norm(x)
    y = np.cross(middle, x)
    p, q = np.tan(size / 2)
    corners = np.stack([middle + i * p * x + j * q * y for i, j in _ROUND])
    return Quad(_unit(corners), 0.4 * 2 ** random.uniform(*stops) * random.uniform(0.6, 1, 3))


_ROUND = ((1, 1), (-1, 1), (-1, -1), (1, -1))


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def lit(quad: Quad) -> Light:
    """Return what is seen of a lamp."""
    return lambda directions: quad.covers(directions)[:, None] * quad.radiance


def _spread(random: np.random.Generator, count: int) -> list[Array]:
    """Return directions that are 50 degrees apart at least."""
    found: list[Array] = []
    while len(found) < count:
        one = _unit(random.normal(size=3))
        if all(one @ other < np.cos(np.radians(50)) for other in found):
            found.append(one)
    return found


def _rectangles(random: np.random.Generator, rows: int) -> Made:
    quads = [rectangle(random, one) for one in _spread(random, int(random.integers(1, 4)))]
    return [picture(rows, [room(random), *map(lit, quads)])], quads


def _pole(random: np.random.Generator, rows: int) -> Made:
    middle = _unit(random.normal(size=3) * [0.12, 0, 0.12] + [0, random.choice([-1, 1]), 0])
    quad = rectangle(random, middle)
    return [picture(rows, [room(random), lit(quad)])], [quad]


def _seam(random: np.random.Generator, rows: int) -> Made:
    middle = _unit(np.array([random.normal() * 0.05, random.normal() * 0.5, -1]))
    quad = rectangle(random, middle)
    return [picture(rows, [room(random), lit(quad)])], [quad]


def _slanted(random: np.random.Generator, rows: int) -> Made:
    facing = rectangle(random, np.array([0.0, 0.0, 1.0]))
    place = Rotation.random(rng=random).as_matrix()
    tilt = Rotation.from_rotvec(random.uniform(0.5, 1.0) * _unit(random.normal(size=3) * [1, 1, 0]))
    flat = facing.corners / facing.corners[:, 2:]
    corners = _unit(((flat - [0, 0, 1]) @ tilt.as_matrix().T + [0, 0, 1]) @ place.T)
    quad = Quad(corners, facing.radiance)
    return [picture(rows, [room(random), lit(quad)])], [quad]


def _sun_light(direction: Array, radiance: Array, radius: float) -> Light:
    def light(directions: Array) -> Array:
        angle = np.arccos(np.clip(directions @ direction, -1, 1))
        share = (SUN_RADIUS / radius) ** 2  # the light of a sun, however wide
        disc = (angle < radius) * share
        return (disc + 2e-5 * np.exp(-angle / 0.06))[:, None] * radiance

    return light


def _sky(directions: Array) -> Array:
    return np.array([0.3, 0.5, 0.9]) * (0.6 + 0.5 * np.maximum(directions[:, 1:2], -0.5))


def _sun_radius(rows: int) -> float:
    """Return a radius that rays do not miss: of two of them."""
    return max(SUN_RADIUS, 2 * np.pi / rows / RAYS)


def _above(random: np.random.Generator) -> Array:
    return _unit(random.normal(size=3) * [1, 0, 1] + [0, random.uniform(0.1, 2), 0])


def _sun(random: np.random.Generator, rows: int) -> Made:
    radiance = 10 ** random.uniform(3.5, 5) * np.array([1, 0.9, 0.75])
    return [picture(rows, [_sky, _sun_light(_above(random), radiance, _sun_radius(rows))])], []


def _window(random: np.random.Generator, rows: int) -> Made:
    [middle] = _spread(random, 1)
    quad = rectangle(random, middle, (4, 6))
    quad = Quad(quad.corners, quad.radiance, bars=int(random.integers(1, 4)))
    outside = room(random)

    def light(directions: Array) -> Array:
        return quad.covers(directions)[:, None] * quad.radiance * (0.5 + outside(directions))

    return [picture(rows, [room(random), light])], []


def _forty(random: np.random.Generator, rows: int) -> Made:
    middles = _unit(random.normal(size=(40, 3)) * [1, 0.3, 1] + [0, 0.7, 0])
    radiance = 0.4 * 2 ** random.uniform(6, 10, (40, 1)) * random.uniform(0.6, 1, (40, 3))
    radius = np.radians(random.uniform(0.5, 2, 40))

    def light(directions: Array) -> Array:
        cosine = directions @ middles.T
        return (cosine > np.cos(radius)).astype(float) @ radiance

    return [picture(rows, [room(random), light])], []


def _noisy(random: np.random.Generator, image: Tensor, level: float) -> Tensor:
    noise = random.normal(size=image.shape) * level
    return (image * (1 + torch.from_numpy(noise)).float()).clamp(min=0)


def _noise(random: np.random.Generator, rows: int) -> Made:
    frames, quads = _rectangles(random, rows)
    return [_noisy(random, frames[0], random.uniform(0.02, 0.15))], quads


def _passing(random: np.random.Generator, rows: int) -> Made:
    walls, turn = room(random), Rotation.from_euler("y", random.uniform(0, 360), degrees=True)
    height, half = random.uniform(1, 2), random.uniform(0.15, 0.6, 2)
    radiance = 0.4 * 2 ** random.uniform(5, 9) * random.uniform(0.6, 1, 3)
    side = random.uniform(-1, 1)
    frames = []
    for at in np.linspace(-2, 2, FRAMES):
        flat = [[side + i * half[0], height, at + j * half[1]] for i, j in _ROUND]
        quad = Quad(_unit(turn.apply(flat)), radiance)
        frames.append(picture(rows, [walls, lit(quad)]))
    return frames, []


def _cloud(random: np.random.Generator, rows: int) -> Made:
    direction, radiance = _above(random), 3e4 * np.array([1, 0.9, 0.75])
    sun = _sun_light(direction, radiance, _sun_radius(rows))
    frames = []
    for at in np.linspace(-1, 1, FRAMES):
        shade = 1 - random.uniform(0.9, 1) * np.exp(-((at / 0.5) ** 2))
        frames.append(picture(rows, [_sky, lambda d, s=shade: s * sun(d)]))
    return frames, []


def _clipping(random: np.random.Generator, rows: int) -> Made:
    walls, [middle] = room(random), _spread(random, 1)
    quad = rectangle(random, middle, (7, 8))
    still = picture(rows, [walls])
    lamp = picture(rows, [lit(quad)])
    levels = np.linspace(0.2, 1.5, FRAMES)
    most = float(lamp.max()) * random.uniform(0.3, 0.8)
    return [(still + float(level) * lamp).clamp(max=most) for level in levels], [quad]


def _turning(random: np.random.Generator, rows: int) -> Made:
    walls = room(random)
    quads = [rectangle(random, one) for one in _spread(random, 3)]
    axis, step = _unit(random.normal(size=3)), np.radians(random.uniform(0.5, 4))
    frames = []
    for at in range(FRAMES):
        turn = Rotation.from_rotvec(axis * step * at)
        turned = [Quad(turn.apply(one.corners), one.radiance) for one in quads]
        lights = [lambda d, t=turn: walls(t.apply(d, inverse=True)), *map(lit, turned)]
        frames.append(_noisy(random, picture(rows, lights), 0.02))
    return frames, quads


KINDS: dict[str, Callable[[np.random.Generator, int], Made]] = {
    "rectangles": _rectangles,
    "beside a pole": _pole,
    "across the seam": _seam,
    "slanted": _slanted,
    "sun and glow": _sun,
    "window": _window,
    "forty lamps": _forty,
    "noise": _noise,
    "passing": _passing,
    "cloud": _cloud,
    "clipping": _clipping,
    "turning": _turning,
}
