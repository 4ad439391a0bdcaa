# SPDX-License-Identifier: Apache-2.0
"""Where the lobes come from: a stage that was read, or a fit that is still running.

The viewer asks a source for news before each picture and knows nothing of files or fitters.
"""

from dataclasses import dataclass
from typing import Protocol

from asglight.lobes import LobeTracks


@dataclass(frozen=True)
class SourceStatus:
    """How far a source has come.

    Attributes:
        frames_done: Frames that have lobes.
        frames_total: Frames there will be.
        message: What it does, in one line; empty where there is nothing to say.
        is_finished: Nothing more will come, for a good reason or a bad one.
        failure: Why it ended early, in one line; None where it did not.
    """

    frames_done: int
    frames_total: int
    message: str = ""
    is_finished: bool = False
    failure: str | None = None


class TrackSource(Protocol):
    """Gives lobe tracks that may grow while they are shown. No method waits."""

    def poll(self) -> LobeTracks | None:
        """Return the newest tracks, of the frames found so far; None where nothing is new."""
        ...

    def status(self) -> SourceStatus:
        """Return how far it has come."""
        ...

    def close(self) -> None:
        """End what runs in the background; may be called twice."""
        ...


class FixedSource:
    """Tracks that are complete."""

    def __init__(self, tracks: LobeTracks, message: str = "") -> None:
        """Take the tracks, and what to say about them."""
        self._tracks = tracks
        self._message = message
        self._is_new = True

    def poll(self) -> LobeTracks | None:
        """Return the tracks, once."""
        is_new, self._is_new = self._is_new, False
        return self._tracks if is_new else None

    def status(self) -> SourceStatus:
        """Return that everything is there."""
        count = len(self._tracks.frames)
        return SourceStatus(count, count, self._message, is_finished=True)

    def close(self) -> None:
        """Do nothing: nothing runs."""
