# SPDX-License-Identifier: Apache-2.0
"""Another fit of the same shot, B, to be held against the one that is edited, A.

B is looked at only: with the camera, the balls and the playhead of A.
"""

import bisect
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import torch

from asglight.lobes import Lobes, LobeTracks, asg
from asglight.viewer.state.balls import Ball
from asglight.viewer.state.camera import Camera
from asglight.viewer.state.held import Held
from asglight.viewer.state.shown import shown_lobes


class Timed(Protocol):
    """Something at a time."""

    @property
    def time(self) -> float:
        """The frame, or a time between two."""
        ...


class Lit(Protocol):
    """What lights balls and a map, and how they are looked at."""

    @property
    def tracks(self) -> LobeTracks:
        """All lobes of all frames."""
        ...

    @property
    def playback(self) -> Timed:
        """The playhead."""
        ...

    @property
    def lit(self) -> tuple[int, ...]:
        """Indices of the lobes that light."""
        ...

    @property
    def lit_lobes(self) -> Lobes:
        """Those lobes at the shown time.  [L, .]."""
        ...

    @property
    def camera(self) -> Camera:
        """Where the balls are seen from."""
        ...

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The row of balls."""
        ...

    @property
    def is_moving(self) -> bool:
        """Whether the picture has to be quick."""
        ...


@dataclass(frozen=True)
class Against:
    """The other fit.

    Attributes:
        name: What it is called.
        tracks: Its lobes; those that give no light are black.
        stage: The file that they were read from; None where there is none.
    """

    name: str
    tracks: LobeTracks
    stage: Path | None = None

    def lobes_at(self, time: float) -> Lobes:
        """Return its lobes at a time; before its first and after its last frame those of it.

        Args:
            time: A frame, or a time between two.  [N, .]
        """
        frames = self.tracks.frames
        time = max(frames[0], min(frames[-1], time))
        index = bisect.bisect_right(frames, time) - 1
        if frames[index] == time:
            return shown_lobes(Held(self.tracks), index, 0.0)
        part = (time - frames[index]) / (frames[index + 1] - frames[index])
        return shown_lobes(Held(self.tracks), index, part)

    def label(self, time: float) -> str:
        """Return what is shown of it at a time."""
        first, last = self.tracks.frames[0], self.tracks.frames[-1]
        if first <= time <= last:
            return f"B: {self.name}"
        return f"B: {self.name}, held at {first if time < first else last}"

    def seen_with(self, state: Lit) -> Lit:
        """Return it as the camera and the playhead of another see it."""
        return _Seen(
            self.tracks,
            state.playback,
            tuple(range(self.tracks.lobes.count)),
            self.lobes_at(state.playback.time),
            state.camera,
            state.balls,
            state.is_moving,
        )

    def radiance(self, time: float, direction: torch.Tensor) -> torch.Tensor:
        """Return what it shows in a direction.  [3] -> [3]."""
        return asg.evaluate(self.lobes_at(time), direction[None])[0]


class _Seen(NamedTuple):
    tracks: LobeTracks
    playback: Timed
    lit: tuple[int, ...]
    lit_lobes: Lobes
    camera: Camera
    balls: tuple[Ball, ...]
    is_moving: bool
