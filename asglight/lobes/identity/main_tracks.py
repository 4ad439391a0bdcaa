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
from collections.abc import Sequence

import torch

from asglight.lobes import asg
from asglight.lobes.data import Lobes
from asglight.lobes.identity.exchanges import Exchanges, Shot, dot
from asglight.lobes.identity.lamps import lamps, variance
from asglight.lobes.motion import exact

PRICE_MAX = 1.0
"""Of an exchange, and what a frame within the lamp is worth."""

WIDTH_MIN = math.pi / 256
"""Radians, a texel of the map that is fitted. Lobes of a third of it are side by side on a sun, and
no place is known better. With 0.35 degrees a sun changed its track behind a cloud, with 0.5 to 1 it
does not."""


def kept_on_lamps(lobes: Lobes) -> Lobes:
    """Let the oldest track of each lamp stay on it.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, tracks of one lamp with some of their later frames exchanged.  [F, N, .]
    """
    shot = _shot(lobes)
    begun = [-1] * lobes.count
    for frame, order in enumerate(shot.order):
        lit, lamp_of = shot.lit[frame], shot.lamp[frame]
        for track, lobe in enumerate(order):
            begun[track] = -1 if not lit[lobe] else frame if begun[track] < 0 else begun[track]
        for lamp in sorted({lamp_of[lobe] for lobe in order if lit[lobe]}):
            if lamp not in shot.led[frame]:
                _follow(shot, frame, _path(shot, frame, _oldest(shot, frame, lamp, begun)))
    rows = torch.arange(len(shot.order))[:, None]
    return lobes[rows, torch.tensor(shot.order)]


def _shot(lobes: Lobes) -> Shot:
    known = exact(lobes)
    found = lamps(known, asg.flux(known).sum(-1))
    width = variance(known).sqrt().clamp(min=WIDTH_MIN).sort(-1, descending=True).values
    count = len(known.axes)
    return Shot(
        (lobes.amplitude > 0).any(-1).tolist(),
        known.axis_z.tolist(),
        width.tolist(),
        found.number.tolist(),
        found.centre.tolist(),
        (found.off_centre <= 1).tolist(),
        [list(range(lobes.count)) for _ in range(count)],
        [set() for _ in range(count)],
    )


def _oldest(shot: Shot, frame: int, lamp: int, begun: Sequence[int]) -> int:
    """Return the track of a lamp that has been lit longest, of several the most central one."""

    def rank(track: int) -> tuple[int, float]:
        lobe = shot.order[frame][track]
        return begun[track], -dot(shot.axis_z[frame][lobe], shot.centre[frame][lobe])

    order, lamp_of = shot.order[frame], shot.lamp[frame]
    return min((track for track, lobe in enumerate(order) if lamp_of[lobe] == lamp), key=rank)


def _path(shot: Shot, first: int, track: int) -> list[int]:
    """Return the places through which the main track of a lamp goes, from a frame on.

    The path with the most frames within the lamp, less the prices of its exchanges, of several the
    longest.
    """
    best = {track: (float(shot.within[first][shot.order[first][track]]), 0)}
    steps: list[dict[int, int]] = []
    end = (best[track], 0, track)  # value and exchanges, steps, place
    for frame in range(first, len(shot.lit) - 1):
        came: dict[int, int] = {}
        reached: dict[int, tuple[float, int]] = {}
        of_lamps: dict[int, Exchanges] = {}
        for place, (value, kept) in best.items():
            for onward, price in _onward(shot, frame, place, of_lamps):
                lobe = shot.order[frame + 1][onward]
                counts = shot.within[frame + 1][lobe] and not shot.is_led(frame + 1, lobe)
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


def _onward(
    shot: Shot, frame: int, place: int, of_lamps: dict[int, Exchanges]
) -> list[tuple[int, float]]:
    """Return the places that a main track may have in the next frame, and their prices.

    Args:
        shot: The shot.
        frame: The frame.
        place: The place there.
        of_lamps: Takes what is found out for each lamp of the frame.
    """
    lobe, after = shot.lobe(frame, place), shot.lobe(frame + 1, place)
    assert lobe is not None  # a path has light
    found = [] if after is None else [(place, 0.0)]
    if shot.is_led(frame, lobe):
        return found
    lamp_of, lamp = shot.lamp[frame], shot.lamp[frame][lobe]
    is_lit, is_lit_then, lamp_then = shot.lit[frame], shot.lit[frame + 1], shot.lamp[frame + 1]
    then = shot.order[frame + 1]
    mates, dark = [], []
    for track, now in enumerate(shot.order[frame]):
        if not is_lit[now]:
            dark.append(track)
        elif lamp_of[now] == lamp:
            mates.append(track)
    kept = [track for track in mates if is_lit_then[then[track]]]
    own = kept if after is None else [place]
    free = sorted([*mates, *dark])
    for onward_lamp in {lamp_then[then[track]] for track in own} - shot.led[frame + 1]:
        others = [one for one in free if lamp_then[then[one]] == onward_lamp and one != place]
        if others and lamp not in of_lamps:
            of_lamps[lamp] = Exchanges(shot, frame, kept)
        prices = [(other, of_lamps[lamp].price(place, other)) for other in others]
        found += [(other, max(price, 0.0)) for other, price in prices if price <= PRICE_MAX]
    return found


def _follow(shot: Shot, first: int, path: list[int]) -> None:
    """Let the first track of a path have the lobes of the whole path."""
    main = path[0]
    track_of = list(range(len(shot.order[0])))  # by place
    for frame, place in enumerate(path, first):
        track = track_of[place]
        if track != main:
            for order in shot.order[frame:]:
                order[main], order[track] = order[track], order[main]
            displaced = track_of.index(main)
            track_of[displaced], track_of[place] = track, main
        shot.led[frame].add(shot.lamp[frame][shot.order[frame][main]])
