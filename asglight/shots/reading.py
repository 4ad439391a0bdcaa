# SPDX-License-Identifier: Apache-2.0
"""Reading the frames of a shot, ahead of the frame that is being fitted."""

import os
from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, TypeVar

from asglight.errors import InputError
from asglight.images import LatlongImage, Sequence
from asglight.images.decoding.header import DamagedError
from asglight.images.message import shown

READINGS_MAX = 3
"""Of a frame: one replaced meanwhile is read anew, one that keeps changing is refused."""

READERS_MAX = 16
"""Frames read at a time, each in a process of its own with up to 200 MB: with a tenth of a second
for a frame of 4k, more than any fit follows."""

_Image = TypeVar("_Image")


class ReadFrame(NamedTuple):
    """A frame's image, and the state of its file when it was read.

    Attributes:
        image: The image.
        stamp: Size in bytes and modification time in ns.
    """

    image: LatlongImage
    stamp: tuple[int, int]


def read_ahead(sequence: Sequence, frames: list[int]) -> Generator[ReadFrame]:
    """Read frames in order in threads, some beyond the frame that is in use (`ahead`).

    Raises:
        InputError: A frame cannot be read; raised when its turn comes.
    """
    return ahead(partial(read_unchanging, sequence), frames)


def ahead(read: Callable[[int], _Image], frames: list[int]) -> Generator[_Image]:
    """Call a function for frames in order in threads, some beyond the frame in use.

    It begins with one frame ahead. Whenever the caller has to wait for a frame, one more is read
    ahead, until there are two for each reader: so small images take one reader, and large ones as
    many as the caller leaves cores to.

    Args:
        read: Returns a frame; called in several threads.
        frames: The frames.

    Raises:
        InputError: What the function raises is raised when the frame's turn comes.
    """
    readers = min(cores(), READERS_MAX)
    limit, coming = 1, deque(frames)
    with ThreadPoolExecutor(readers, "asglight-read") as pool:
        pending: deque[Future[_Image]] = deque()
        try:
            while coming or pending:
                while coming and len(pending) < limit:
                    pending.append(pool.submit(read, coming.popleft()))
                if not pending[0].done():
                    limit = min(limit + 1, 2 * readers)
                ready = pending.popleft().result()
                if coming:  # before the caller goes to work
                    pending.append(pool.submit(read, coming.popleft()))
                yield ready
        finally:
            for reading in pending:
                reading.cancel()


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def stamp_of(sequence: Sequence, frame: int) -> tuple[int, int]:
    """Return size and modification time of the file that a frame is read from.

    An interpolated frame is known by the first of its two files.

    Raises:
        InputError: The file is gone.
    """
    state = _state(sequence, frame)
    return state.st_size, state.st_mtime_ns


def _state(sequence: Sequence, frame: int) -> os.stat_result:
    path = sequence.path(frame)
    try:
        return path.stat()
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be read ({error.strerror}); expected the image of frame "
            f"{frame}. Was it moved while asglight ran?"
        ) from error


def read_unchanging(sequence: Sequence, frame: int) -> ReadFrame:
    """Read a frame that nobody writes meanwhile: what is half old and half new is no frame.

    Raises:
        InputError: It cannot be read, or keeps changing.
    """
    for _ in range(READINGS_MAX):
        before = _state(sequence, frame)
        try:
            image = sequence.read_or_fill(frame)
        except DamagedError:
            if _is_same(before, _state(sequence, frame)):
                raise
        else:
            if _is_same(before, _state(sequence, frame)):
                return ReadFrame(image, (before.st_size, before.st_mtime_ns))
    raise InputError(
        f"{shown(sequence.path(frame))}: changes while it is read; expected the finished image of "
        f"frame {frame}. Is it still being rendered? Start again when it is done."
    )


def _is_same(before: os.stat_result, after: os.stat_result) -> bool:
    """Tell whether a file is still the one that it was, and unwritten since."""
    return (before.st_ino, before.st_size, before.st_mtime_ns) == (
        after.st_ino,
        after.st_size,
        after.st_mtime_ns,
    )
