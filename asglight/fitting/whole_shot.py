# SPDX-License-Identifier: Apache-2.0
"""The pass over a whole shot, some frames at a time.

Frame by frame, a fit knows only what came before. Here every frame takes some more steps between
its two neighbours (between.py), and lobes that some frames can spare are lit elsewhere in them
(replanning.py).
"""

from collections.abc import Iterable, Iterator

import torch

from asglight.fitting import temporal
from asglight.fitting.between import Chunk, sweep
from asglight.fitting.first_frame import Exposed
from asglight.fitting.replanning import replan
from asglight.lobes import Lobes

CHUNK = 16
"""Frames in memory: 25 MB of maps of 256 rows, and half as many side by side."""

ROUNDS = 2
"""Of plans in `best`, each with a sweep over all frames. A third one has 3 % less of r0.5 and
flicker in a tunnel, for a third more time. `fast` has none: they take as long as following."""


def refine_shot(
    lobes: Lobes, chunks: Iterable[list[Exposed]], rounds: int = 0
) -> Iterator[tuple[int, Lobes, list[float]]]:
    """Refine a shot some frames at a time.

    Args:
        lobes: Every frame as fitted, in the units of its map.  [F, N, .]
        chunks: The maps in order, about `CHUNK` at a time.
        rounds: Of plans.

    Yields:
        Index of the first frame of a chunk, the chunk's lobes [F', N, .] and its losses.
    """
    shot = temporal.waiting(lobes).clone()
    first = 0
    for frames in chunks:
        zeros = [0.0] * len(frames)
        chunk = Chunk(first, frames, zeros.copy(), zeros.copy())
        _refine(shot, chunk, rounds)
        yield first, shot[first : first + len(frames)].clone(), chunk.losses
        first += len(frames)


def _refine(shot: Lobes, chunk: Chunk, rounds: int) -> None:
    """Refine the frames of a chunk in place.

    Black frames stay as they are, and so do all where the maps differ in size.
    """
    if len({frame.height for frame in chunk.frames}) > 1:
        return
    allowed = torch.ones(len(chunk.frames), shot.count, dtype=torch.bool)
    sweep(shot, chunk, chunk.places)
    for later in range(rounds):
        replan(shot, chunk, allowed, later)
        sweep(shot, chunk, chunk.places)
