# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks of a shot that is still being fitted."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from asglight.lobes.data import Lobes, LobeTracks


class GrowingTracks:
    """Takes the lobes of a shot frame by frame and gives the tracks of the frames so far.

    All tracks share one block of memory that each frame writes its own part of, so that giving them
    costs nothing, and those given before stay as they are.
    """

    def __init__(self, frames: Sequence[int], fps: float, metadata: Mapping[str, Any]) -> None:
        """Make room for nothing yet.

        Args:
            frames: Every frame there will be, ascending.
            fps: Frames per second.
            metadata: Of the tracks.

        Raises:
            ValueError: The frames are not ascending.
        """
        self.frames = tuple(frames)
        if any(later <= before for before, later in itertools.pairwise(self.frames)):
            raise ValueError("frames: not ascending")
        self.count = 0
        self._fps = fps
        self._metadata = metadata
        self._room: Lobes | None = None

    def append(self, lobes: Lobes) -> None:
        """Take the lobes of the next frame, as many as the first one had.  [N, .]."""
        if self._room is None:
            self._room = Lobes(
                *(
                    torch.empty(len(self.frames), *values.shape)
                    for values in (lobes.axes, lobes.sharpness, lobes.amplitude)
                ),
                form=lobes.form,
            )
        self._room.axes[self.count] = lobes.axes
        self._room.sharpness[self.count] = lobes.sharpness
        self._room.amplitude[self.count] = lobes.amplitude
        self.count += 1

    def tracks(self) -> LobeTracks | None:
        """Return the tracks of the frames so far; None before the first.  [F, N, .]."""
        if self._room is None:
            return None
        frames, lobes = self.frames[: self.count], self._room[: self.count]
        return LobeTracks(frames, self._fps, lobes, self._metadata)
