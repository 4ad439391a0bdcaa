# SPDX-License-Identifier: Apache-2.0
"""Curves on the sphere as polylines on a latlong map: refined, and cut at seam and poles.

Polylines are latlong uv, [K, 2], float64; nothing runs across the seam.
"""

from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from asglight.sphere import latlong

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Polylines = tuple[Array, ...]

STEP_MAX = 1 / 48
"""Longest segment in u or v; a longer one, as near a pole, is halved."""

HALVINGS_MAX = 20
"""After which a curve has come as near to a pole as 1e-7 radians: it passes through it."""


class Curves(Protocol):
    """Curves of one kind on the sphere."""

    @property
    def parameter(self) -> Array:
        """Where points of each curve are computed before it is refined, ascending.  [K]."""
        ...

    @property
    def is_closed(self) -> bool:
        """Whether the last point of each is the first."""
        ...

    def points(self, curves: Indices, place: Array, /) -> Array:
        """Return a point of each of some curves at a parameter.  [P], [P] -> [P, 3]."""
        ...


def polylines(curves: Curves, count: int) -> list[list[Array]]:
    """Draw each of so many curves: finely where the map stretches it, cut at seam and poles."""
    if not count:
        return []
    owner = np.repeat(np.arange(count), len(curves.parameter))
    uv, owner = _refined(curves, owner, np.tile(curves.parameter, count))
    ends = np.flatnonzero(np.diff(owner, append=-1)) + 1
    if curves.is_closed:  # rounding may have put one left and one right of the seam
        uv[ends - 1] = uv[np.append(0, ends[:-1])]
    step = np.diff(uv[:, 0])
    is_cut = (np.abs(step) > STEP_MAX) & (owner[1:] == owner[:-1])
    to_cut = set(owner[1:][is_cut].tolist())
    lines = np.split(uv, ends[:-1])
    return [
        _cut(line, curves.is_closed) if index in to_cut else [line]
        for index, line in enumerate(lines)
    ]


def _refined(curves: Curves, owner: Indices, parameter: Array) -> tuple[Array, Indices]:
    """Halve the segments that are too long on the map, of all curves at once.

    Args:
        curves: The curves.
        owner: The curve of each point, those of a curve in a row.  [P]
        parameter: Where the points lie on them.  [P]

    Returns:
        All points, and the curve of each.  [R, 2], [R]
    """
    uv = _uv(curves.points(owner, parameter))
    for _ in range(HALVINGS_MAX):
        long = np.flatnonzero((_steps(uv) > STEP_MAX) & (owner[1:] == owner[:-1]))
        if not len(long):
            break
        of, between = owner[long], (parameter[long] + parameter[long + 1]) / 2
        owner = np.insert(owner, long + 1, of)
        parameter = np.insert(parameter, long + 1, between)
        uv = np.insert(uv, long + 1, _uv(curves.points(of, between)), axis=0)
    return uv, owner


def _uv(directions: Array) -> Array:
    u, v = latlong.uv_from_direction(torch.from_numpy(directions))
    return np.stack([u.numpy(), v.numpy()], axis=-1)


def _steps(uv: Array) -> Array:
    """Return the longer side of each segment, across the seam where that is shorter.

    [..., K, 2] -> [..., K - 1].
    """
    step = np.diff(uv, axis=-2)
    step[..., 0] -= np.round(step[..., 0])
    return np.abs(step).max(-1)


def _cut(uv: Array, is_closed: bool) -> list[Array]:
    """Cut a polyline where it leaves the map at the seam or passes through a pole."""
    step = np.diff(uv[:, 0])
    across = step - np.round(step)
    is_pole = np.abs(across) > STEP_MAX  # any other segment was halved until it was shorter
    cuts = np.flatnonzero((np.round(step) != 0) | is_pole)
    if not len(cuts):
        return [uv]
    pieces = []
    start = uv[:0]
    for first, last in zip([0, *(cuts + 1)], [*(cuts + 1), len(uv)], strict=True):
        inner = uv[first:last]
        if last == len(uv):
            pieces.append(np.concatenate([start, inner]))
            break
        ends = _pole_ends if is_pole[last - 1] else _seam_ends
        end, after = ends(uv[last - 1], uv[last])
        pieces.append(np.concatenate([start, inner, end]))
        start = after
    if is_closed:  # the last piece goes on where the first begins
        pieces[0] = np.concatenate([pieces.pop(), pieces[0][1:]])
    return [piece for piece in pieces if np.ptp(piece, axis=0).max() > 0]


def _seam_ends(before: Array, after: Array) -> tuple[Array, Array]:
    """Return the point where a segment leaves the map, and that where it comes in again."""
    edge = 1.0 if before[0] > after[0] else 0.0
    beyond = after[0] + 2 * edge - 1  # as if the map went on
    share = (edge - before[0]) / (beyond - before[0]) if beyond != before[0] else 0.0
    v = before[1] + share * (after[1] - before[1])
    return np.array([[edge, v]]), np.array([[1 - edge, v]])


def _pole_ends(before: Array, after: Array) -> tuple[Array, Array]:
    """Return the pole above or below the one point, and that above or below the other."""
    pole = round((before[1] + after[1]) / 2)
    return np.array([[before[0], pole]]), np.array([[after[0], pole]])
