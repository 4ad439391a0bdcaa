# SPDX-License-Identifier: Apache-2.0
"""Lobes and reference of a time that may lie between two frames."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import torch

from asglight.lobes import Lobes, LobeTracks, motion
from asglight.viewer.state.held import Held


@lru_cache(maxsize=4)
def shown_lobes(tracks: Held[LobeTracks], index: int, part: float) -> Lobes:
    """Return the lobes of a frame, or between it and the next one.  [N, .].

    Args:
        tracks: The shot.
        index: Place of the frame.
        part: How far to the next one (lobes/motion.py has the rule).
    """
    if not part:
        return tracks.value.lobes[index]
    pair = slice(index, index + 2)
    frames, lobes = tracks.value.frames[pair], tracks.value.lobes[pair]
    time = frames[0] + part * (frames[1] - frames[0])
    return motion.at(replace(tracks.value, frames=frames, lobes=lobes), [time])[0].to(torch.float32)


@lru_cache(maxsize=2)
def dissolved(first: Held[np.ndarray], last: Held[np.ndarray], part: float) -> np.ndarray:
    """Return two images mixed, float32 [H, W, 3]."""
    return ((1 - part) * first.value + part * last.value).astype(np.float32)
