# SPDX-License-Identifier: Apache-2.0
"""What one window shows, with what brings it in: state, source of lobes, reference images."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from asglight.errors import InputError
from asglight.lobes import Lobes, LobeTracks
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.source import SourceStatus, TrackSource
from asglight.viewer.state.viewer_state import ViewerState

WAIT_SECONDS = 0.02
"""Between two looks at a source that is waited for: half the time that a live frame takes."""

REFERENCE_SECONDS = 60.0
"""For one image to be decoded: a large one on a slow network disk."""


@dataclass
class Session:
    """A state and what changes it from outside.

    Attributes:
        state: What is shown. Its tracks hold every frame of the timeline; frames without lobes yet
            have black ones.
        source: Gives the lobes.
        title: What is shown, in a few words.
        stage: The file that the lobes were read from; None where there is none (yet).
        meters: Whether the first light that comes sets the exposure.
        has_view: Whether the command line has chosen the view: the one that the window had last
            is then not taken.
    """

    state: ViewerState
    source: TrackSource
    title: str
    stage: Path | None = None
    meters: bool = False
    has_view: bool = False
    _found: frozenset[int] = field(default=frozenset(), init=False)

    def update(self, direction: int = 0) -> SourceStatus:
        """Take in what is new; to be called before each picture.

        Args:
            direction: 1 while playing forward, -1 while playing backward, 0 at rest.

        Returns:
            How far the source has come.
        """
        tracks = self.source.poll()
        if tracks is not None:
            self._found = frozenset(tracks.frames)
            self.state.replace_tracks(padded(tracks, self.state.playback.frames))
        status = self.source.status()
        self.state.is_fitting = not status.is_finished
        # A fit that has ended early leaves frames without lobes, too.
        is_whole = self._found.issuperset(self.state.playback.frames)
        self.state.fitted = None if is_whole else self._found
        if self.meters:
            self.meters = not self.state.meter()
        for images in self._images():
            images.look_at(self.state.playback.frame, direction)
        return status

    def wait(self) -> None:
        """Wait until the shown frame is complete: its lobes, its rest and its reference image.

        Raises:
            InputError: The source ended before it came to this frame, or the image cannot be read.
        """
        status = self.update()
        while self.state.playback.frame not in self._found and not status.is_finished:
            time.sleep(WAIT_SECONDS)
            status = self.update()
        if status.failure is not None and self.state.playback.frame not in self._found:
            raise InputError(status.failure)
        playback = self.state.playback
        frames = {playback.frame, playback.next_frame} if playback.is_between else {playback.frame}
        for frame in sorted(frames):
            for images in self._images():
                if images.wait(frame, REFERENCE_SECONDS) is None:
                    message = images.message(frame)
                    if message is not None:
                        raise InputError(message)
        if self.meters:
            self.meters = not self.state.meter()

    def check_images(self) -> bool:
        """Tell whether the images of the shown time are there.

        Raises:
            InputError: One of them cannot be read.
        """
        for images in self._images():
            message = images.message(self.state.playback.frame)
            if message is not None:
                raise InputError(message)
        state = self.state
        is_compared = state.references is None or state.reference_image is not None
        return is_compared and (state.keyed is None or state.rest_image is not None)

    def _images(self) -> list[Reference]:
        """Return what is read while it is shown."""
        keyed = self.state.keyed
        every = (self.state.references, None if keyed is None else keyed.rest)
        return [images for images in every if images is not None]

    def close(self) -> None:
        """End what runs in the background."""
        self.source.close()
        self.state.compare_with(None)
        if self.state.keyed is not None:
            self.state.keyed.close()


def no_lobes(frames: tuple[int, ...], fps: float) -> LobeTracks:
    """Return tracks without any lobe, for a timeline whose lobes are not known yet."""
    count = len(frames)
    lobes = Lobes(torch.empty(count, 0, 3, 3), torch.empty(count, 0, 2), torch.empty(count, 0, 3))
    return LobeTracks(frames, fps, lobes)


def padded(tracks: LobeTracks, frames: tuple[int, ...]) -> LobeTracks:
    """Return tracks over a longer timeline, black where they have no frame.  [F, N, .].

    Args:
        tracks: Lobes of some frames of the timeline.
        frames: Frame numbers of the timeline, ascending.
    """
    found = set(tracks.frames)
    if not found < set(frames):
        return tracks
    places = np.array([frame in found for frame in frames])
    lobes, shape = tracks.lobes, (len(frames), tracks.lobes.count)

    def spread(values: torch.Tensor, default: np.ndarray) -> torch.Tensor:
        # In numpy: torch would wake threads for a copy of half a megabyte, and wait for them.
        every = np.broadcast_to(default, shape + default.shape).copy()
        every[places] = values.numpy()
        return torch.from_numpy(every)

    axes = spread(lobes.axes, np.eye(3, dtype=np.float32))
    sharpness = spread(lobes.sharpness, np.ones(2, np.float32))
    amplitude = spread(lobes.amplitude, np.zeros(3, np.float32))
    padded_lobes = Lobes(axes, sharpness, amplitude, lobes.form)
    return LobeTracks(frames, tracks.fps, padded_lobes, tracks.metadata)
