# SPDX-License-Identifier: Apache-2.0
"""A fit that runs elsewhere, `asglight fit -o shot.usda`, watched by the viewer."""

import threading
from pathlib import Path

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.shots.watching import ShotWatch
from asglight.viewer.state.source import SourceStatus
from asglight.viewer.state.viewer_state import lobes_max

INTERVAL_SECONDS = 0.2
"""Between two looks: a frame of the fastest preset takes a fifth of this on one core, the eye
reads a number that changes five times a second, and a network disk is asked seldom enough."""


class WatchSource:
    """A running shot (a `viewer.state.source.TrackSource`): files are read in a thread."""

    def __init__(self, stage: Path) -> None:
        """Look once, then go on looking in a thread.

        Raises:
            InputError: The checkpoint cannot be used.
        """
        self._name = shown(stage.name)
        self._watch = ShotWatch(stage)
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._new: LobeTracks | None = None
        self._status = SourceStatus(0, 0)
        self._look()
        self.frames = self._watch.frames
        self._thread = threading.Thread(target=self._follow, name="asglight-watch", daemon=True)
        self._thread.start()

    def poll(self) -> LobeTracks | None:
        """Return the tracks of the frames found so far; None where nothing is new."""
        with self._lock:
            new, self._new = self._new, None
            return new

    def status(self) -> SourceStatus:
        """Return how far the fit has come."""
        with self._lock:
            return self._status

    def close(self) -> None:
        """End the thread; the fit goes on."""
        self._stop.set()
        self._thread.join()

    def _follow(self) -> None:
        while not self.status().is_finished and not self._stop.wait(INTERVAL_SECONDS):
            try:
                self._look()
            except InputError as error:
                with self._lock:
                    done, total = self._status.frames_done, self._status.frames_total
                    self._status = SourceStatus(done, total, is_finished=True, failure=str(error))

    def _look(self) -> None:
        is_new = self._watch.look()
        tracks, is_written = self._watch.tracks, self._watch.is_written
        if tracks is not None and tracks.lobes.count > lobes_max(tracks.lobes.form):
            raise InputError(
                f"{self._name}: has {tracks.lobes.count} lobes; expected at most "
                f"{lobes_max(tracks.lobes.form)}, "
                "which is what the viewer holds. Fit fewer with --lobes."
            )
        done = 0 if tracks is None else len(tracks.frames)
        text = f"{self._name} is written" if is_written else f"watching the fit of {self._name}"
        with self._lock:
            if is_new:
                self._new = tracks
            self._status = SourceStatus(done, len(self._watch.frames), text, is_written)
