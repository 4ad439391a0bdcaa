# SPDX-License-Identifier: Apache-2.0
"""Lamps followed over a shot, and those of them that become keys.

A lamp is linked to the one of the next frame that lies nearest to where its turn would bring it
[Kuhn 1955, "The Hungarian method for the assignment problem"]. One that is not found for a few
frames, behind a pillar or a cloud, is looked for where it should be; so it stays the same key.

Symbols: F frames, K keys.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import optimize

from asglight.keys.spots import Array, Places

LINK = np.radians(8)
"""Farthest from where its turn would bring it that a lamp is looked for, besides its radius. One
overhead turns by 4 degrees more in a frame than in the one before."""

FLUX_WEIGHT = np.radians(3)
"""What a factor of e in flux adds to the angle of a link: of two lamps as near, the alike one."""

ALONE = 1.5 * LINK
"""Cost of a lamp that is linked to none: two links that together cost more than the better one and
this are not both made, or a lamp that goes would take over its neighbour's."""

GAP = 8
"""Frames without it after which a lamp is gone: a third of a second."""

FADE = 4
"""Frames in which a key comes up, or goes, that is not there in the whole shot."""

MOST = 2 / 3
"""Share of the lamps' light of a frame that its keys carry."""

OUTLINED = 1 / 2
"""Share of the light of all spots of a frame that lamps with an outline have: with less, as of a
sky between leaves, keys cannot carry most of it, and only a shadow that is seen makes one."""

SHADOW = 1 - 2 ** (-1 / 3)
"""Share of the light of a surface that faces it: a lamp with more is a key at any rate. Its shadow
is darker by a third of a stop, the step of a camera's dials, which a rest would cast softly."""

LEAST = 0.01
"""Of a frame's light: a lamp with less, in all frames, is no key."""

FIGURE_MIN = 0.77
"""Share of a lamp's outline that a card fills: a disc has 0.9, a triangle 0.83, a ragged dish 0.79,
sky through trees 0.5 to 0.73."""

STAY = 3
"""Frames in which a lamp must be one of a frame's keys, or else in the whole of a shorter life."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """A lamp in a frame.

    Attributes:
        place: Flat places of its texels.
        direction: Of its light's mean.  [3]
        radius: Of a disc of its solid angle, in radians.
        share: Of the frame's light.
        shadow: Share of the light of a surface that faces it: by how much its shadow is darker.
        stops: Of its mean above its surroundings.
        figure: Share of its outline that a card fills.
    """

    place: Places
    direction: Array
    radius: float
    share: float
    shadow: float
    stops: float
    figure: float


@dataclass(eq=False)
class Track:
    """A lamp over frames.

    Attributes:
        seen: By place of the frame in the shot.
    """

    seen: dict[int, Sighting] = field(default_factory=dict)

    @property
    def first(self) -> int:
        """Place of its first frame."""
        return min(self.seen)

    @property
    def last(self) -> int:
        """Place of its last frame."""
        return max(self.seen)

    @property
    def light(self) -> float:
        """Return the sum of its shares over the frames."""
        return sum(one.share for one in self.seen.values())

    def expected(self, frame: int) -> Array:
        """Return where the lamp is in a later frame if it turns on as it did.  [3]."""
        places = sorted(self.seen)[-2:]
        now = self.seen[places[-1]].direction
        if len(places) < 2:
            return now
        before = self.seen[places[0]].direction
        turn = np.arccos(np.clip(before @ now, -1, 1)) / (places[1] - places[0])
        onward = now * (before @ now) - before  # along the great circle, away from where it was
        length = float(np.linalg.norm(onward))
        angle = turn * (frame - places[1])
        return now if length == 0 else np.cos(angle) * now + np.sin(angle) * onward / length

    def at(self, frame: int) -> tuple[Array, Places | None, float]:
        """Return where the lamp is in a frame of its life.

        Returns:
            Its direction [3], its texels or None where it is not found, and its radius.
        """
        if frame in self.seen:
            one = self.seen[frame]
            return one.direction, one.place, one.radius
        before = max(place for place in self.seen if place < frame)
        after = min(place for place in self.seen if place > frame)
        part = (frame - before) / (after - before)
        first, last = self.seen[before], self.seen[after]
        mean = (1 - part) * first.direction + part * last.direction
        radius = (1 - part) * first.radius + part * last.radius
        return mean / np.linalg.norm(mean), None, radius


def linked(frames: Sequence[Sequence[Sighting]]) -> list[Track]:
    """Return the lamps of a shot, each over the frames in which it is found."""
    tracks: list[Track] = []
    for frame, found in enumerate(frames):
        going = [track for track in tracks if frame - track.last <= GAP]
        taken: set[int] = set()
        for track, place in _pairs(going, found, frame):
            track.seen[frame] = found[place]
            taken.add(place)
        tracks += [Track({frame: one}) for k, one in enumerate(found) if k not in taken]
    return tracks


def _pairs(
    going: Sequence[Track], found: Sequence[Sighting], frame: int
) -> list[tuple[Track, int]]:
    if not going or not found:
        return []
    expected = np.stack([track.expected(frame) for track in going])
    directions = np.stack([one.direction for one in found])
    angle = np.arccos(np.clip(expected @ directions.T, -1, 1))
    flux = np.array([track.seen[track.last].share for track in going])
    now = np.array([one.share for one in found])
    radius = np.maximum.outer(
        [track.seen[track.last].radius for track in going], [one.radius for one in found]
    )
    reach = LINK + radius
    cost = angle / reach * LINK + FLUX_WEIGHT * np.abs(np.log(now / flux[:, None]))
    allowed = angle <= reach
    rows, columns = optimize.linear_sum_assignment(np.where(allowed, cost, ALONE))
    return [
        (going[row], int(column))
        for row, column in zip(rows, columns, strict=True)
        if allowed[row, column]
    ]


def keys(frames: Sequence[Sequence[Sighting]], count: int | None = None) -> list[Track]:
    """Return the lamps that are keys, the one with most light first.

    Args:
        frames: Lamps of each frame.
        count: How many at most; None for as few as carry most of the lamps' light in each frame,
            and those whose shadow is plainly seen.
    """
    tracks = sorted(linked(frames), key=lambda track: -track.light)
    if count is not None:
        return tracks[:count]
    outlined = [track for track in tracks if _is_outlined(track)]
    wanted = {id(track): 0 for track in outlined}
    for frame in range(len(frames)):
        spots = sum(track.seen[frame].share for track in tracks if frame in track.seen)
        seen = {id(track): track.seen[frame] for track in outlined if frame in track.seen}
        whole, carried = sum(one.share for one in seen.values()), 0.0
        for name, one in sorted(seen.items(), key=lambda item: -item[1].share):
            is_of_most = carried < MOST * whole and whole >= OUTLINED * spots
            if (is_of_most and one.share >= LEAST) or one.shadow >= SHADOW:
                wanted[name] += 1
            carried += one.share
    return [one for one in outlined if wanted[id(one)] >= min(STAY, len(one.seen))]


def _is_outlined(track: Track) -> bool:
    figures = [one.figure for one in track.seen.values()]
    return float(np.median(figures)) >= FIGURE_MIN


def weight(track: Track, frame: int, count: int) -> float:
    """Return how far a key is up in a frame: 0 before and after its life, 1 within.

    Args:
        track: The key.
        frame: Place of the frame.
        count: Frames of the shot; a key that is there at its ends does not fade there.
    """
    if not track.first <= frame <= track.last:
        return 0.0
    steps = [1.0]
    if track.first > 0:
        steps.append((frame - track.first + 1) / (FADE + 1))
    if track.last < count - 1:
        steps.append((track.last - frame + 1) / (FADE + 1))
    part = min(steps)
    return part * part * (3 - 2 * part)
