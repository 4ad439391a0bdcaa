# SPDX-License-Identifier: Apache-2.0
"""The true shape of lobes on a latlong map. No OpenGL.

A lobe's outline is where its function falls to a share of its peak, `level`. With L = -ln(level),
x, y, z components in the lobe's frame, phi the angle about an axis, and t = 1 - (component along
that axis)^2:

    asg       q t - ln(1 - t) / 2 = L about z, with q = sx cos^2 phi + sy sin^2 phi: one root
    bingham   q t = L about z and about -z, where both sharpnesses are at least L; where only
              the larger is, its bands meet, and the edge is (sx - L) / t = (sx - sy) cos^2 phi +
              sx sin^2 phi about x and about -x, phi from y (x being the sharper axis)
    sg        1 - z = L / s
    flat      h(q t) - ln(1 - t) / 2 = L about z, with h(s) = -ln(1 - (1 - exp(-s))^3): one root

A lobe that never falls to the level has the great circle at right angles to its z axis instead.

Symbols: N lobes, C curves, K points of a curve. Polylines are latlong uv, [K, 2], float64.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes
from asglight.viewer.uniforms.polylines import Array, Indices, Polylines, polylines

Root = Callable[[Array, Array | float], Array]

HALF_PEAK = 0.5
"""Share of the peak at which an outline runs; exp(-2) is the other one in use."""

RING_SEGMENTS = 64
"""Of an outline before it is refined: chords leave a circle by 0.12 % of its radius."""

ARM_SEGMENTS = 16
"""Of an arm; it is nearly straight but at the poles."""

DRAFT_SEGMENTS = 32
"""Of an outline while the picture moves: chords leave a circle by half a percent of its radius."""

NEWTON_STEPS = 6
"""They reach float64 rounding, for any sharpness and both levels."""


@dataclass(frozen=True)
class Outline:
    """How one lobe is drawn; nothing runs across the seam.

    Attributes:
        curves: Where the lobe falls to the level. One closed curve, or two of the bingham form;
            cut where it meets the seam or a pole.
        arm_x: Arcs along axis_x through the centre, from outline to outline.
        arm_y: Arcs along axis_y likewise.
    """

    curves: Polylines
    arm_x: Polylines
    arm_y: Polylines


def outlines(lobes: Lobes, level: float = HALF_PEAK) -> list[Outline]:
    """Return the outline of each lobe.

    Args:
        lobes: N lobes of one frame.  [N, .]
        level: Share of the peak, between 0 and 1.
    """
    found = zip(curves(lobes, level), arms(lobes, level), strict=True)
    return [Outline(drawn, *both) for drawn, both in found]


def arms(lobes: Lobes, level: float) -> list[tuple[Polylines, Polylines]]:
    """Return the arms of each lobe alone, along axis_x and axis_y; arguments as of `outlines`."""
    centre = np.tile(np.arange(lobes.count), len(_sides(lobes)))
    drawn = polylines(_arcs(lobes, level), 2 * len(centre))
    along_x, along_y = drawn[: len(centre)], drawn[len(centre) :]
    return [
        (_of(along_x, centre, index), _of(along_y, centre, index)) for index in range(lobes.count)
    ]


def curves(
    lobes: Lobes, level: float = HALF_PEAK, segments: int = RING_SEGMENTS
) -> list[Polylines]:
    """Return the curves of each outline alone, which takes a third of the time.

    Args:
        lobes: N lobes of one frame.  [N, .]
        level: Share of the peak, between 0 and 1.
        segments: Of a curve before it is refined.
    """
    rings = replace(_rings(lobes, level), parameter=_angles(segments))
    drawn = polylines(rings, len(rings.lobe))
    return [_of(drawn, rings.lobe, index) for index in range(lobes.count)]


def closed_curve(corners: Array) -> Polylines:
    """Draw great circles from corner to corner; nothing runs across the seam.

    Args:
        corners: Directions; closed where the last is the first.  [K, 3]
    """
    along = np.arange(len(corners), dtype=np.float64)
    path = _Path(corners, along, bool(np.array_equal(corners[0], corners[-1])))
    return tuple(polylines(path, 1)[0])


def half_angles(lobes: Lobes, level: float = HALF_PEAK) -> Tensor:
    """Return how far from its centre each lobe reaches along axis_x and axis_y.

    Args:
        lobes: N lobes of one frame.  [N, .]
        level: Share of the peak at which it ends.

    Returns:
        Radians, float64; a right angle where the lobe does not fall to the level.  [N, 2]
    """
    drop = -math.log(level)
    sharpness = lobes.sharpness.to("cpu", torch.float64)
    if lobes.form is Form.SG:
        half_sine_squared = drop / (2 * sharpness)
        reached = half_sine_squared < 1
        angle = 2 * torch.asin(half_sine_squared.clamp(max=1).sqrt())
        return torch.where(reached, angle, math.pi / 2)
    if lobes.form in _SMOOTH:
        squared = torch.from_numpy(_SMOOTH[lobes.form](sharpness.numpy(), drop))
    else:
        squared = (drop / sharpness).clamp(max=1)
    return torch.asin(squared.sqrt())


@dataclass(frozen=True)
class _Rings:
    """Closed curves about an axis: t = c / (q0 cos^2 phi + q1 sin^2 phi), or a smooth form's root.

    Attributes:
        lobe: Index of the lobe.  [C]
        frames: Rows: where phi is 0, where it is a right angle, the axis.  [C, 3, 3]
        q: The two q.  [C, 2]
        c: The c; L for a smooth form.  [C]
        side: 1, or -1 where the curve runs on the far side of the axis.  [C]
        root: Returns t for q and L; None where t is c over q.
        parameter: The angles at which points are computed, before the curve is refined.  [K]
    """

    lobe: Indices
    frames: Array
    q: Array
    c: Array
    side: Array
    root: Root | None
    parameter: Array = field(default_factory=lambda: _angles(RING_SEGMENTS))
    is_closed = True

    def points(self, curves: Indices, psi: Array) -> Array:
        """Return a point of each of some curves; psi spreads them as on an ellipse.

        [P], [P] -> [P, 3].
        """
        # where phi is 0 and a right angle
        extent = np.sqrt(self._squared_sine(self.q, self.c[:, None]))
        across = extent[curves] * np.stack([np.cos(psi), np.sin(psi)], -1)  # [P, 2]
        across /= np.hypot(across[:, :1], across[:, 1:])
        squared = self._squared_sine((across**2 * self.q[curves]).sum(-1), self.c[curves])
        along = self.side[curves] * np.sqrt(np.maximum(1 - squared, 0))  # rounding at t = 1
        local = np.concatenate([across * np.sqrt(squared)[:, None], along[:, None]], -1)
        return np.einsum("pi,pij->pj", local, self.frames[curves])

    def _squared_sine(self, q: Array, c: Array) -> Array:
        return np.minimum(c / q, 1.0) if self.root is None else self.root(q, c)


@dataclass(frozen=True)
class _Arcs:
    """Arcs of great circles through centres, as far to one side as to the other.

    Attributes:
        toward: Centres.  [C, 3]
        along: Directions at right angles to them.  [C, 3]
        angle: Half their lengths.  [C]
    """

    toward: Array
    along: Array
    angle: Array
    parameter = np.linspace(-1, 1, ARM_SEGMENTS + 1)
    is_closed = False

    def points(self, curves: Indices, share: Array) -> Array:
        """Return a point of each of some arcs, share between -1 and 1.  [P], [P] -> [P, 3]."""
        angle = (self.angle[curves] * share)[:, None]
        return np.cos(angle) * self.toward[curves] + np.sin(angle) * self.along[curves]


@dataclass(frozen=True)
class _Path:
    """A path of great circles through corners; the parameter counts them.

    Attributes:
        corners: Directions.  [K, 3]
        parameter: 0, 1 and so on at the corners.  [K]
        is_closed: Whether it comes back.
    """

    corners: Array
    parameter: Array
    is_closed: bool

    def points(self, _curves: Indices, place: Array) -> Array:
        """Return points of the path, the only one.  [P], [P] -> [P, 3]."""
        first = np.clip(np.floor(place).astype(int), 0, len(self.corners) - 2)
        part = (place - first)[:, None]
        points = (1 - part) * self.corners[first] + part * self.corners[first + 1]
        return points / np.linalg.norm(points, axis=-1, keepdims=True)


def _sides(lobes: Lobes) -> tuple[float, ...]:
    return (1.0, -1.0) if lobes.form is Form.BINGHAM else (1.0,)


def _arcs(lobes: Lobes, level: float) -> _Arcs:
    """Return the arcs along axis_x through every centre, then those along axis_y."""
    axes, sides = _axes(lobes), _sides(lobes)
    toward = np.concatenate([side * axes[:, 2] for side in sides])
    angles = half_angles(lobes, level).numpy().T  # [2, N]
    along = np.concatenate([np.tile(axes[:, axis], (len(sides), 1)) for axis in (0, 1)])
    return _Arcs(np.tile(toward, (2, 1)), along, np.tile(angles, len(sides)).ravel())


def _axes(lobes: Lobes) -> Array:
    return lobes.axes.to("cpu", torch.float64).numpy()


def _angles(segments: int) -> Array:
    """Return the ends of equal segments of a turn.  [K]."""
    return np.linspace(0, 2 * math.pi, segments + 1)


def _rings(lobes: Lobes, level: float) -> _Rings:
    axes = _axes(lobes)
    sharpness = lobes.sharpness.to("cpu", torch.float64).numpy()
    drop = -math.log(level)
    index = np.arange(lobes.count)
    front = np.ones(lobes.count)
    if lobes.form in _SMOOTH:
        return _Rings(index, axes, sharpness, drop * front, front, _SMOOTH[lobes.form])
    if lobes.form is Form.SG:
        half = drop / (2 * sharpness[:, 0])  # sin^2 of half the polar angle
        half = np.where(half < 1, half, 0.5)
        side = np.where(half <= 0.5, 1.0, -1.0)
        return _Rings(index, axes, np.ones_like(sharpness), 4 * half * (1 - half), side, None)
    x_is_sharper = (sharpness[:, 0] >= sharpness[:, 1])[:, None]
    sharper = np.where(x_is_sharper, axes[:, 0], axes[:, 1])
    other = np.where(x_is_sharper, axes[:, 1], axes[:, 0])
    high, low = sharpness.max(-1), sharpness.min(-1)
    is_band = (low < drop) & (high > drop)
    never = high <= drop
    band = np.stack([other, axes[:, 2], sharper], axis=1)
    frames = np.where(is_band[:, None, None], band, axes)
    q = np.where(is_band[:, None], np.stack([high - low, high], -1), sharpness)
    q = np.where(never[:, None], 1.0, q)
    c = np.where(is_band, high - drop, np.where(never, 1.0, drop))
    twice = np.concatenate([index, index[~never]])  # both sides share one great circle
    side = np.concatenate([front, -front[~never]])
    return _Rings(twice, frames[twice], q[twice], c[twice], side, None)


def _asg_squared_sine(q: Array, drop: Array | float) -> Array:
    """Solve q t - ln(1 - t) / 2 = L by Newton's method.

    Either term alone gives a t that is too large, and the function is convex: the steps come down
    to the root and never pass it.
    """
    t = np.minimum(drop / q, -np.expm1(-2 * np.asarray(drop)))
    for _ in range(NEWTON_STEPS):
        excess = q * t - 0.5 * np.log1p(-t) - drop
        t = t - excess / (q + 0.5 / (1 - t))
    return t


def _flat_squared_sine(q: Array, drop: Array | float) -> Array:
    """Solve h(q t) - ln(1 - t) / 2 = L, with h as convex as the asg's exponent, in the same way."""
    drop = np.asarray(drop)
    alone = -np.log1p(-np.cbrt(-np.expm1(-drop)))  # h(alone) = L
    t = np.minimum(alone / q, -np.expm1(-2 * drop))
    for _ in range(NEWTON_STEPS):
        below, gaussian = -np.expm1(-q * t), np.exp(-q * t)
        fallen = -np.log(gaussian * (3 - gaussian * (3 - gaussian)))
        slope = 3 * below**2 / (3 - gaussian * (3 - gaussian))
        t = t - (fallen - 0.5 * np.log1p(-t) - drop) / (q * slope + 0.5 / (1 - t))
    return t


_SMOOTH: dict[Form, Root] = {Form.ASG: _asg_squared_sine, Form.FLAT: _flat_squared_sine}
"""Forms that fall to 0 at their horizon, so that their outline has no closed form."""


def _of(drawn: list[list[Array]], owner: Indices, lobe: int) -> Polylines:
    return tuple(line for index in np.flatnonzero(owner == lobe) for line in drawn[index])
