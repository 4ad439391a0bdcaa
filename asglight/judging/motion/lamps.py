# SPDX-License-Identifier: Apache-2.0
"""Whether a lamp that passes is one track: lamps are followed in the maps, without any fit.

A lamp is a connected spot of texels brighter than a share of the shot's brightest one. Its place is
the mean direction of its light above that threshold, finer than a texel; its width is the root mean
square angle from there, the texels' own extent included. Spots of neighbouring frames are linked by
the least sum of angles between where a lamp should be, by its last turn, and where a spot is
[Kuhn 1955, "The Hungarian method for the assignment problem"].

Symbols: F frames, K spots of a frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage, optimize
from torch import Tensor

from asglight.keys.spots import labelled
from asglight.lobes import LobeTracks, asg, motion
from asglight.sphere import latlong

Array = NDArray[np.float64]

THRESHOLD = 0.05
"""Of the shot's brightest texel: below it lie what lamps light, above it lamps down to a twentieth
of a texel."""

LINK_DEG = 8.0
"""Farthest from where its turn would bring it that a lamp is looked for, besides its own width. A
lamp that comes overhead turns by 4 degrees more in a frame than in the one before."""

FLUX_WEIGHT_DEG = 3.0
"""What a factor of e in flux adds to the angle of a link: of two spots as near, the alike one."""

SEEN_SHARE = 0.02
"""A lamp is seen while it sends this share of its frame's flux: the mean of fifty lobes."""

LIT_SHARE = 0.1
"""A track follows a lamp while it has at least this share of the lamp's flux."""


@dataclass(frozen=True)
class Spots:
    """The bright spots of a frame.

    Attributes:
        directions: Unit vectors.  [K, 3]
        flux: Radiance times solid angle, channels summed.  [K]
        width: In radians.  [K]
        total: Flux of the whole frame.
    """

    directions: Array
    flux: Array
    width: Array
    total: float


@dataclass(eq=False)
class Path:
    """A lamp over the frames in which it is found, one after the other.

    Attributes:
        first: Place of its first frame.
        directions: Of each frame.
        flux: Likewise.
        width: Likewise, in radians.
        share: Likewise, of the frame's flux.
    """

    first: int
    directions: list[Array] = field(default_factory=list)
    flux: list[float] = field(default_factory=list)
    width: list[float] = field(default_factory=list)
    share: list[float] = field(default_factory=list)

    @property
    def last(self) -> int:
        """Place of its last frame."""
        return self.first + len(self.flux) - 1

    def expected(self) -> Array:
        """Return where the lamp is in the next frame if it turns on as it did.  [3]."""
        if len(self.directions) < 2:
            return self.directions[-1]
        before, now = self.directions[-2:]
        return 2 * (before @ now) * now - before  # as far again on the same great circle


@dataclass(frozen=True)
class Followed:
    """How a passage was followed.

    Attributes:
        share: Of its frames, that in which one track, the one with the most, was with the lamp.
        frames: Frames of the passage.
    """

    share: float
    frames: tuple[int, ...]


def passages(maps: Sequence[Tensor], count: int) -> list[Path]:
    """Return the brightest passages of a shot, each as long as its lamp is seen.

    Args:
        maps: Repaired radiance of each frame.  F of [H, W, 3]
        count: How many, at most.

    Returns:
        Those with the most light over their frames, in order of their first frame.
    """
    threshold = THRESHOLD * max(float(one.sum(-1).max()) for one in maps)
    found = [_seen(path) for path in linked([spots(one, threshold) for one in maps])]
    found = sorted((path for path in found if path.flux), key=lambda path: -sum(path.flux))
    return sorted(found[:count], key=lambda path: path.first)


def spots(radiance: Tensor, threshold: float) -> Spots:
    """Return the spots of a map that are brighter than a threshold.

    Args:
        radiance: Repaired.  [H, W, 3]
        threshold: Of the sum of the channels.
    """
    height, width, _ = radiance.shape
    luminance = radiance.double().sum(-1).numpy()
    labels, count = labelled(luminance > threshold)
    omega = latlong.texel_solid_angles(height, width, dtype=torch.float64).expand(height, width)
    total = float((luminance * omega.numpy()).sum())
    if not count:
        return Spots(np.empty((0, 3)), np.empty(0), np.empty(0), total)
    inside = labels > 0
    place = labels[inside] - 1
    solid = omega.numpy()[inside]
    flux = luminance[inside] * solid
    # the background that a spot stands on would draw its centre to the middle of the spot
    above = (luminance[inside] - threshold) * solid
    direction = latlong.directions(height, width).double().numpy()[inside]
    centre = np.stack([np.bincount(place, above * direction[:, k], count) for k in range(3)], 1)
    centre /= np.linalg.norm(centre, axis=-1, keepdims=True)
    cosine = np.clip((direction * centre[place]).sum(-1), -1, 1)
    # a texel is a patch: its own mean square angle is its solid angle over 6, as of a square
    square = np.arccos(cosine) ** 2 + solid / 6
    weight = np.bincount(place, above, count)
    spread = np.sqrt(np.bincount(place, above * square, count) / weight)
    return Spots(centre, np.bincount(place, flux, count).astype(float), spread, total)


def linked(frames: Sequence[Spots]) -> list[Path]:
    """Return the paths of all lamps."""
    done: list[Path] = []
    going: list[Path] = []
    for place, found in enumerate(frames):
        pairs = _pairs(going, found)
        kept: list[Path] = []
        for path, spot in pairs:
            _extend(path, found, spot)
            kept.append(path)
        done += [path for path in going if path not in kept]
        taken = {spot for _, spot in pairs}
        for spot in range(len(found.flux)):
            if spot not in taken:
                path = Path(place)
                _extend(path, found, spot)
                kept.append(path)
        going = kept
    return done + going


def followed(tracks: LobeTracks, passage: Path, numbers: Sequence[int]) -> Followed:
    """Return how tracks follow a lamp, at those frames of its passage that they have.

    Args:
        tracks: A fit.
        passage: Of the lamp.
        numbers: Frame numbers of the maps of which the passage was found.
    """
    own = set(tracks.frames)
    places = [p for p in range(passage.first, passage.last + 1) if numbers[p] in own]
    frames = tuple(numbers[place] for place in places)
    if not frames:
        raise ValueError("passage: no frame of it is fitted")
    lobes = motion.at(tracks, frames)
    rows = [place - passage.first for place in places]
    direction = torch.from_numpy(np.stack([passage.directions[row] for row in rows]))
    width = torch.tensor([passage.width[row] for row in rows], dtype=torch.float64)
    flux = torch.tensor([passage.flux[row] for row in rows], dtype=torch.float64)
    cosine = (lobes.axis_z * direction[:, None]).sum(-1).clamp(-1, 1)
    is_near = cosine.acos() <= width[:, None]  # [F, N]
    is_lit = asg.flux(lobes).sum(-1) >= LIT_SHARE * flux[:, None]
    return Followed(float((is_near & is_lit).double().mean(0).max()), frames)


def _seen(path: Path) -> Path:
    """Return the longest part of a path in which its lamp is seen all the time."""
    marks = np.asarray(path.share) >= SEEN_SHARE
    labels, count = _numbered(marks)
    if not count:
        return Path(path.first)
    longest = int(np.bincount(labels)[1:].argmax()) + 1
    places = np.flatnonzero(labels == longest)
    part = slice(int(places[0]), int(places[-1]) + 1)
    return Path(
        path.first + part.start,
        path.directions[part],
        path.flux[part],
        path.width[part],
        path.share[part],
    )


def _pairs(going: Sequence[Path], found: Spots) -> list[tuple[Path, int]]:
    """Link paths to the spots of the next frame."""
    if not going or not len(found.flux):
        return []
    expected = np.stack([path.expected() for path in going])
    angle = np.degrees(np.arccos(np.clip(expected @ found.directions.T, -1, 1)))
    flux = np.array([path.flux[-1] for path in going])
    width = np.degrees([path.width[-1] for path in going])
    cost = angle + FLUX_WEIGHT_DEG * np.abs(np.log(found.flux / flux[:, None]))
    allowed = angle <= LINK_DEG + width[:, None]
    far = 1e6  # more than all links together: as many as possible are made, then the best
    rows, columns = optimize.linear_sum_assignment(np.where(allowed, cost, far))
    return [
        (going[row], int(column))
        for row, column in zip(rows, columns, strict=True)
        if allowed[row, column]
    ]


def _extend(path: Path, found: Spots, spot: int) -> None:
    path.directions.append(found.directions[spot])
    path.flux.append(float(found.flux[spot]))
    path.width.append(float(found.width[spot]))
    path.share.append(float(found.flux[spot]) / found.total)


def _numbered(marks: NDArray[np.bool_]) -> tuple[NDArray[np.int_], int]:
    """Number what is marked and touches, also by a corner, from 1 on; 0 elsewhere."""
    labels = np.zeros(marks.shape, dtype=int)
    ndimage.label(marks, np.ones((3,) * marks.ndim), output=labels)
    return labels, int(labels.max(initial=0))
