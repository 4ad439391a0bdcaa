# SPDX-License-Identifier: Apache-2.0
"""The images that the lobes are compared with, at the frames of the timeline."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from asglight.images import frame_files, open_sequence
from asglight.images.frame_files import ranges, sequence_of
from asglight.images.options import ReadOptions
from asglight.viewer.reference.prefetch import FrameCache

HEIGHT_MAX = 1024
"""Rows that larger images are averaged down to: 2048 columns are as many as a screen shows of a
latlong, and an 8k frame would take 400 MB."""

BYTE_BUDGET = 2**30
"""Bytes of decoded images: 42 frames of 1024 x 2048, two seconds of a shot."""


class Reference:
    """The images of a sequence; a single image serves every frame.

    Attributes:
        name: A short name, `sky` for `sky.####.exr`.
        frames: The frames that have an image, ascending.
        timeline: The same with those that are missing.
        is_still: One image serves every frame.
        files: What is read, where it lies in files.
    """

    def __init__(
        self,
        name: str,
        frames: Sequence[int],
        read: Callable[[int], np.ndarray],
        *,
        missing: Sequence[int] = (),
        files: Sequence[Path] = (),
        byte_budget: int = BYTE_BUDGET,
    ) -> None:
        """Start to decode.

        Args:
            name: For messages.
            frames: Frame numbers, ascending, at least one.
            read: Returns the radiance of a frame, float32 [H, W, 3]; called in several threads.
            missing: Frame numbers between them that have no image.
            files: What `read` reads, where that lies in files.
            byte_budget: Bytes to fill with decoded images.
        """
        self.name = name
        self.frames = tuple(frames)
        self.timeline = tuple(sorted({*frames, *missing}))
        self.is_still = len(self.frames) == 1
        self.files = tuple(files)
        self._cache = FrameCache(read, self.frames, byte_budget=byte_budget)

    def look_at(self, frame: int, direction: int = 0) -> None:
        """Decode around a frame: 1 playing forward, -1 playing backward, 0 at rest."""
        self._cache.look_at(self._shown(frame), direction)

    def get(self, frame: int) -> np.ndarray | None:
        """Return the image of a frame if it is there, [H, W, 3], without waiting."""
        return self._cache.get(self._shown(frame))

    def message(self, frame: int) -> str | None:
        """Return why a frame has no image, in one line; None while none is known."""
        shown = self._shown(frame)
        if shown not in self.frames:
            return f"{self.name}: has no frame {frame}; it has {ranges(self.frames)}."
        return self._cache.message(shown)

    def wait(self, frame: int, timeout: float) -> np.ndarray | None:
        """Decode around a frame and wait until it has an image or a message.

        Args:
            frame: The frame.
            timeout: Seconds to wait at most.

        Returns:
            Its image, [H, W, 3]; None where there is none.
        """
        self.look_at(frame)
        return self._cache.wait(self._shown(frame), timeout)

    def cached_ranges(self) -> list[tuple[int, int]]:
        """Return the runs of decoded frames, first and last; a single image has no runs."""
        return [] if self.is_still else self._cache.cached_ranges()

    def held_line(self) -> str:
        """Return in one line that the one image stands for every frame."""
        return f"Its one image, {self._title()}, is held for every frame."

    def label(self, frame: int) -> str:
        """Return what is shown at a frame where that is not the frame itself; empty otherwise."""
        return f"{self._title()} held" if self.is_still and frame != self.frames[0] else ""

    def close(self) -> None:
        """End the decoding threads and forget the images."""
        self._cache.close()

    def _title(self) -> str:
        """Return what the one image is called: its frame, where its name has one."""
        return self.name if self.frames == (1,) else f"{self.name} {self.frames[0]}"

    def _shown(self, frame: int) -> int:
        return self.frames[0] if self.is_still else frame


def whole_sequence(source: str, frames: Sequence[int]) -> str | None:
    """Return the sequence that a single image belongs to, where a shot has frames of it.

    A shot is compared with its sequence: one image held against all of its frames would be wrong in
    each but one.

    Args:
        source: What is to be opened.
        frames: The frames of the shot.

    Returns:
        The pattern; None where the source is no single image or its sequence no other frame of the
        shot.
    """
    pattern = sequence_of(Path(source))
    if pattern is None:
        return None
    held = set(frame_files.find(pattern).files) & set(frames)
    return pattern if len(held) > 1 else None


def open_reference(
    source: str,
    *,
    frames: str | None = None,
    reading: ReadOptions = ReadOptions(),  # noqa: B008  frozen, so one default serves all calls
) -> Reference:
    """Open a file, a folder or a pattern; images are read when they are wanted.

    A frame that is missing stops nothing: it has a message.

    Args:
        source: A file; a folder that holds one image or one sequence; or a pattern.
        frames: Frames to use, such as `1001-1048`; None for all.
        reading: How the images are read.

    Raises:
        InputError: Nothing is there, or it is not one sequence.
    """
    # "hold" lets a sequence with gaps be opened; what is held is not among the frames.
    sequence = open_sequence(
        source,
        frames=frames,
        missing="hold",
        height=HEIGHT_MAX,
        reading=reading,
    )
    existing = [frame for frame in sequence.frames if frame not in sequence.missing_frames]

    def read(frame: int) -> np.ndarray:
        return sequence.read(frame).radiance.contiguous().numpy()

    files = [sequence.path(frame) for frame in existing]
    return Reference(sequence.name, existing, read, missing=sequence.missing_frames, files=files)
