# SPDX-License-Identifier: Apache-2.0
"""Reading the frames of a shot, one ahead of the frame that is being fitted."""

import os
from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, TypeVar

from asglight.errors import InputError
from asglight.images import LatlongImage, Sequence
from asglight.images.decoding.decode import DamagedError
from asglight.images.message import shown

READINGS_MAX = 3
"""Of a frame: one replaced meanwhile is read anew, one that keeps changing is refused."""

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
    """Read frames in order in a thread, at most one beyond the frame that is in use.

    Raises:
        InputError: A frame cannot be read; raised when its turn comes.
    """
    return one_ahead(partial(_read, sequence), frames)


def one_ahead(read: Callable[[int], _Image], frames: list[int]) -> Generator[_Image]:
    """Call a function for frames in order in a thread, at most one beyond the frame in use.

    What it raises is raised when the frame's turn comes.
    """
    if not frames:
        return
    with ThreadPoolExecutor(1, "asglight-read") as reader:
        pending = reader.submit(read, frames[0])
        for following in frames[1:]:
            ready = pending.result()
            pending = reader.submit(read, following)
            yield ready
        yield pending.result()


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


def _read(sequence: Sequence, frame: int) -> ReadFrame:
    """Read a frame that nobody writes meanwhile: what is half old and half new is no frame."""
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
