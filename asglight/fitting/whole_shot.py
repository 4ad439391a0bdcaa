# SPDX-License-Identifier: Apache-2.0
"""The pass over a whole shot, some frames at a time.

Frame by frame, a fit knows only what came before. Here every frame takes some more steps between
its two neighbours (between.py). `best` fits the frames once more before that, with lobes that are
free to jump (free_fits.py), and where these show much more of the light links them to tracks that
do not (linking.py).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from asglight.fitting import temporal
from asglight.fitting.between import Chunk, cuts, sweep
from asglight.fitting.first_frame import Exposed
from asglight.fitting.free_fits import free_fit
from asglight.fitting.linking import linked, worths
from asglight.lobes import Lobes
from asglight.lobes.data import stack

CHUNK = 16
"""Frames in memory: 25 MB of maps of 256 rows, and half as many side by side."""

SWEEPS, LINKED_SWEEPS = 2, 4
"""Over lobes that were followed: a second one takes 2 % of flicker off a room seen by hand and 5 %
of flicker and r0.5 off a tunnel, a third half as much. Over lobes that were linked, each frame
alone, the first one brings most of the way."""

GAIN = 0.3
"""Share of what materials show wrong by which free lobes must be better than followed ones. Under a
sky and in a room the median frame gains 0.03 and 0.01, the best 0.28; in a tunnel half gain 0.5."""

GAP = 8
"""Frames between such frames that are taken free as well: each change of sides darkens lobes."""

Read = Callable[[], Iterable[list[Exposed]]]
"""Reads the maps of a shot in order, about `CHUNK` at a time."""

OnChunk = Callable[[int, int], None]
"""Called with how many readings of a frame are done, and how many there will be."""


@dataclass(frozen=True)
class _Swept:
    """A shot after steps between neighbours.

    Attributes:
        lobes: Every frame.  [F, N, .]
        losses: J of each; 0 for what was not refined.
        materials: J's part of what materials show of each.
    """

    lobes: Lobes
    losses: list[float]
    materials: list[float]


def refine_shot(
    lobes: Lobes,
    read: Read,
    *,
    links: bool = False,
    threads: int = 1,
    on_chunk: OnChunk = lambda *_: None,
) -> tuple[Lobes, list[float]]:
    """Refine a shot.

    Args:
        lobes: Every frame as fitted, in the units of its map.  [F, N, .]
        read: Reads the maps; called once, or twice with `links`.
        links: Whether lobes are fitted free as well, and linked where that shows more.
        threads: Frames take steps on so many at once; the shot does not depend on it.
        on_chunk: Progress.

    Returns:
        The lobes [F, N, .] and the loss of each frame.
    """
    shot = temporal.waiting(lobes).clone()
    count = len(shot.axes)
    if not links:
        found = _swept([(shot, SWEEPS)], read(), threads, lambda done: on_chunk(done, count))[0]
        return found.lobes, found.losses
    places = cuts(shot)
    other = _linked(shot, places, read(), lambda done: on_chunk(done, 2 * count))
    ways = [(shot, SWEEPS)] if other is None else [(shot, SWEEPS), (other, LINKED_SWEEPS)]
    found, *rest = _swept(ways, read(), threads, lambda done: on_chunk(count + done, 2 * count))
    if rest:
        found = _better(found, rest[0], places)
    return found.lobes, found.losses


def _swept(
    ways: list[tuple[Lobes, int]],
    chunks: Iterable[list[Exposed]],
    threads: int,
    on_frames: Callable[[int], None],
) -> list[_Swept]:
    """Sweep shots of the same maps, each so many times, in place.

    Black frames stay as they are, and so do all of a chunk where its maps differ in size.
    """
    found = [_Swept(shot, [], []) for shot, _ in ways]
    for frames in chunks:
        first, zeros = len(found[0].losses), [0.0] * len(frames)
        for (shot, sweeps), swept in zip(ways, found, strict=True):
            chunk = Chunk(first, frames, zeros.copy(), zeros.copy())
            if len({frame.height for frame in frames}) == 1:
                for _ in range(sweeps):
                    sweep(shot, chunk, chunk.places, threads)
            swept.losses.extend(chunk.losses)
            swept.materials.extend(chunk.materials)
        on_frames(first + len(frames))
    return found


def _linked(
    shot: Lobes,
    places: list[int],
    chunks: Iterable[list[Exposed]],
    on_frames: Callable[[int], None],
) -> Lobes | None:
    """Fit every frame with free lobes and link them where these show more; None where nowhere.

    Args:
        shot: As followed.  [F, N, .]
        places: Frames after cuts.
        chunks: The maps.
        on_frames: Progress.
    """
    free: list[Lobes] = []
    gains: list[float] = []
    both: list[tuple[Tensor, Tensor]] = []
    for frames in chunks:
        for frame in frames:
            own = shot[len(free)]
            fit = free_fit(frame, free[-1] if free else own, own)
            free.append(fit.lobes)
            gains.append(fit.gain)
            both.append((worths(fit.lobes, fit.missed), worths(own, fit.followed_missed)))
        on_frames(len(free))
    freed = _stretches(torch.tensor(gains) > GAIN)
    if not bool(freed.any()):
        return None
    lobes = stack([free[k] if freed[k] else shot[k] for k in range(len(free))])
    worth = torch.stack([both[k][0 if freed[k] else 1] for k in range(len(free))])
    found = shot.clone()
    for first, last in pairwise([0, *places, len(free)]):
        part = slice(first, last)
        if bool(freed[part].any()):
            _put(found, part, linked(lobes[part], worth[part], ~freed[part]))
    return found


def _put(shot: Lobes, part: slice, lobes: Lobes) -> None:
    """Write lobes into neighbouring frames of a shot."""
    shot.axes[part], shot.sharpness[part] = lobes.axes, lobes.sharpness
    shot.amplitude[part] = lobes.amplitude


def _stretches(wanted: Tensor) -> Tensor:
    """Close gaps of up to `GAP` frames between frames that are wanted.  [F]."""
    found = wanted.clone()
    for before, after in pairwise(torch.nonzero(wanted).flatten().tolist()):
        if after - before <= GAP + 1:
            found[before:after] = True
    return found


def _better(one: _Swept, other: _Swept, places: list[int]) -> _Swept:
    """Return of each part between cuts the one in which materials show less wrong."""
    lobes, losses, materials = one.lobes.clone(), list(one.losses), list(one.materials)
    for first, last in pairwise([0, *places, len(losses)]):
        part = slice(first, last)
        if sum(other.materials[part]) < sum(one.materials[part]):
            _put(lobes, part, other.lobes[part])
            losses[part], materials[part] = other.losses[part], other.materials[part]
    return _Swept(lobes, losses, materials)
