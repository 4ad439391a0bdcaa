# SPDX-License-Identifier: Apache-2.0
"""The main track of a lamp: the one of its lobes that has the lamp's name, as long as it is seen.

A lamp that comes near is long and is shown by several lobes, one that goes away by one again. Which
of them stays in the middle, which drifts to an end, and which is given up is decided by what the
frames show, not by which came first. So tracks of one lamp may exchange their later frames: the
light of every frame stays as it is, and the main track, the oldest of the lamp, is within the
lamp's width in as many frames as may be.

An exchange has a price, for light moves between the frames along the tracks: how much farther the
two lobes have to go than without it, besides the motion of the lamp. A way is the squared
2-Wasserstein distance of two Gaussians [Olkin and Pukelsheim 1982], in squares of their widths. One
frame within the lamp is worth a price of 1, and no exchange costs more: so a sun keeps its track
behind a cloud, and lobes that stand still beside each other keep theirs. The best path through the
lamp's lobes is found by dynamic programming [Viterbi 1967].

A lamp that is switched off beside another one, without anything dark between them, is not told from
a lobe that is given up: names are worth no more than this.

Symbols: F frames, N tracks; a place is a track, with the lobes that it has so far.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from asglight.lobes import asg
from asglight.lobes.data import Lobes
from asglight.lobes.identity.lamps import lamps, variance
from asglight.lobes.motion import exact
from asglight.sphere.turns import turn_between

Array = NDArray[np.float64]

PRICE_MAX = 1.0
"""Of an exchange, and what a frame within the lamp is worth."""

WIDTH_MIN = math.pi / 256
"""Radians, a texel of the map that is fitted. Lobes of a third of it are side by side on a sun, and
no place is known better. With 0.35 degrees a sun changed its track behind a cloud, with 0.5 to 1 it
does not."""


@dataclass(frozen=True, eq=False)
class _Shot:
    """What is asked of lobes, and which lobe each track has.

    Attributes:
        lit: Which send light.  [F, N]
        axis_z: Their directions.  [F, N, 3]
        width: Sigma along the longer axis and along the shorter, a texel at least.  [F, N, 2]
        lamp: Number of the lobe's lamp in its frame.  [F, N]
        centre: Where that is.  [F, N, 3]
        within: Whether the lobe is within the lamp's width.  [F, N]
        order: The lobe that a track has in a frame; changed in place.  [F, N]
        led: The lamps of each frame that have a main track.
    """

    lit: NDArray[np.bool_]
    axis_z: Array
    width: Array
    lamp: NDArray[np.int_]
    centre: Array
    within: NDArray[np.bool_]
    order: NDArray[np.int_]
    led: list[set[int]]

    def lobe(self, frame: int, track: int) -> int | None:
        """Return the lobe of a track; None where it is dark, or there is no such frame."""
        if not 0 <= frame < len(self.lit):
            return None
        lobe = int(self.order[frame, track])
        return lobe if self.lit[frame, lobe] else None

    def is_led(self, frame: int, lobe: int) -> bool:
        """Tell whether a lobe's lamp has a main track."""
        return int(self.lamp[frame, lobe]) in self.led[frame]


def kept_on_lamps(lobes: Lobes) -> Lobes:
    """Let the oldest track of each lamp stay on it.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, tracks of one lamp with some of their later frames exchanged.  [F, N, .]
    """
    shot = _shot(lobes)
    begun = np.full(lobes.count, -1)
    for frame in range(len(shot.lit)):
        shines = shot.lit[frame, shot.order[frame]]
        begun = np.where(shines, np.where(begun < 0, frame, begun), -1)
        for lamp in np.unique(shot.lamp[frame][shot.lit[frame]]).tolist():
            if lamp not in shot.led[frame]:
                _follow(shot, frame, _path(shot, frame, _oldest(shot, frame, lamp, begun)))
    rows = torch.arange(len(shot.lit))[:, None]
    return lobes[rows, torch.from_numpy(shot.order)]


def _shot(lobes: Lobes) -> _Shot:
    lit = (lobes.amplitude > 0).any(-1)
    known = exact(lobes)
    flux = asg.flux(known).sum(-1)
    found = [lamps(known[index], flux[index]) for index in range(len(lit))]
    number, centre, off = (
        torch.stack([getattr(one, name) for one in found]).numpy()
        for name in ("number", "centre", "off_centre")
    )
    return _Shot(
        lit.numpy(),
        known.axis_z.numpy(),
        variance(known).sqrt().clamp(min=WIDTH_MIN).sort(-1, descending=True).values.numpy(),
        number,
        centre,
        off <= 1,
        np.tile(np.arange(lobes.count), (len(lit), 1)),
        [set() for _ in lit],
    )


def _oldest(shot: _Shot, frame: int, lamp: int, begun: NDArray[np.int_]) -> int:
    """Return the track of a lamp that has been lit longest, of several the most central one."""
    order = shot.order[frame]
    tracks = np.flatnonzero(shot.lamp[frame, order] == lamp)
    cosine = (shot.axis_z[frame, order] * shot.centre[frame, order]).sum(-1)
    return int(min(tracks, key=lambda track: (begun[track], -cosine[track])))


def _path(shot: _Shot, first: int, track: int) -> list[int]:
    """Return the places through which the main track of a lamp goes, from a frame on.

    The path with the most frames within the lamp, less the prices of its exchanges, of several the
    longest.
    """
    best = {track: (float(shot.within[first, shot.order[first, track]]), 0)}
    steps: list[dict[int, int]] = []
    end = (best[track], 0, track)  # value and exchanges, steps, place
    for frame in range(first, len(shot.lit) - 1):
        came: dict[int, int] = {}
        reached: dict[int, tuple[float, int]] = {}
        for place, (value, kept) in best.items():
            for onward, price in _onward(shot, frame, place):
                lobe = shot.order[frame + 1, onward]
                counts = shot.within[frame + 1, lobe] and not shot.is_led(frame + 1, lobe)
                total = value + float(counts) - price, kept - (onward != place)
                if onward not in reached or total > reached[onward]:
                    reached[onward], came[onward] = total, place
        if not reached:
            break
        steps.append(came)
        best = reached
        end = max(end, *((value, len(steps), place) for place, value in best.items()))
    path = [end[2]]
    for came in reversed(steps[: end[1]]):
        path.append(came[path[-1]])
    return path[::-1]


def _onward(shot: _Shot, frame: int, place: int) -> list[tuple[int, float]]:
    """Return the places that a main track may have in the next frame, and their prices."""
    lobe, after = shot.lobe(frame, place), shot.lobe(frame + 1, place)
    assert lobe is not None  # a path has light
    found = [] if after is None else [(place, 0.0)]
    if shot.is_led(frame, lobe):
        return found
    shines = shot.lit[frame, shot.order[frame]]
    mates = shines & (shot.lamp[frame, shot.order[frame]] == shot.lamp[frame, lobe])
    next_lobes = shot.order[frame + 1]
    goes_on = shot.lit[frame + 1, next_lobes]
    kept = mates & goes_on
    own = np.arange(len(mates)) == place if after is not None else kept
    next_lamps = shot.lamp[frame + 1, next_lobes]
    for lamp in set(next_lamps[own].tolist()) - shot.led[frame + 1]:
        may = goes_on & (next_lamps == lamp) & (mates | ~shines)
        may[place] = False
        others = np.flatnonzero(may)
        if not len(others):
            continue
        prices = _prices(shot, frame, np.append(others, place), np.flatnonzero(kept))
        for other, price in zip(others, prices, strict=True):
            if price <= PRICE_MAX:
                found.append((int(other), max(float(price), 0.0)))
    return found


def _prices(shot: _Shot, frame: int, tracks: NDArray[np.intp], kept: NDArray[np.intp]) -> Array:
    """Return what it costs to exchange the last of some tracks with each other one after a frame.

    A track that is dark in one frame alone waits where it was, and its way from there counts by
    half, as its light does; one that is dark for longer begins its path where it is needed.

    Args:
        shot: The shot.
        frame: The frame.
        tracks: The others, and the last.  [K + 1]
        kept: Tracks of the lamp that are lit in both frames, which say how it moves.
    """
    before, after = _ends(shot, frame, -1, tracks), _ends(shot, frame + 1, 1, tracks)
    ends = (shot.axis_z[at, shot.order[at, kept]].sum(0) for at in (frame, frame + 1))
    turn = turn_between(*(one / np.linalg.norm(one) for one in ends)) if len(kept) else np.eye(3)
    cosine = (before.axis_z @ turn.T) @ after.axis_z.T  # [K + 1, K + 1]
    wider = (before.width[:, None] - after.width) ** 2  # [K + 1, K + 1, 2]
    square = np.arccos(np.clip(cosine, -1, 1)) ** 2 + wider.sum(-1)
    square /= before.width[:, None, 0] ** 2 + after.width[:, 0] ** 2
    way = square * (before.lit[:, None].astype(float) + after.lit) / 2
    way *= before.known[:, None] & after.known
    return way[-1, :-1] + way[:-1, -1] - way[-1, -1] - np.diagonal(way)[:-1]


@dataclass(frozen=True, eq=False)
class _Ends:
    """Where tracks come from or go to.

    Attributes:
        known: Whether they are lit there, or wait there for a frame.  [K]
        lit: Whether they are lit there.  [K]
        axis_z: Their directions.  [K, 3]
        width: Sigma along both axes.  [K, 2]
    """

    known: NDArray[np.bool_]
    lit: NDArray[np.bool_]
    axis_z: Array
    width: Array


def _ends(shot: _Shot, frame: int, step: int, tracks: NDArray[np.intp]) -> _Ends:
    """Return tracks in a frame; one that is dark there is where it is a step beyond."""
    lobes = shot.order[frame, tracks]
    is_lit = shot.lit[frame, lobes]
    beyond = min(max(frame + step, 0), len(shot.lit) - 1)
    waits = shot.order[beyond, tracks]
    at = np.where(is_lit, frame, beyond)
    index = np.where(is_lit, lobes, waits)
    return _Ends(
        is_lit | shot.lit[beyond, waits],
        is_lit,
        shot.axis_z[at, index],
        shot.width[at, index],
    )


def _follow(shot: _Shot, first: int, path: list[int]) -> None:
    """Let the first track of a path have the lobes of the whole path."""
    main = path[0]
    track_of = list(range(len(shot.order[0])))  # by place
    for frame, place in enumerate(path, first):
        track = track_of[place]
        if track != main:
            shot.order[frame:, [main, track]] = shot.order[frame:, [track, main]]
            displaced = track_of.index(main)
            track_of[displaced], track_of[place] = track, main
        shot.led[frame].add(int(shot.lamp[frame, shot.order[frame, main]]))
