# SPDX-License-Identifier: Apache-2.0
"""Reading the frames of a shot, one ahead of the frame that is being fitted."""

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, TypeVar

from asglight.errors import InputError
from asglight.images import LatlongImage, Sequence
from asglight.images.message import shown

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
    path = sequence.path(frame)
    try:
        state = path.stat()
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be read ({error.strerror}); expected the image of frame "
            f"{frame}. Was it moved while asglight ran?"
        ) from error
    return state.st_size, state.st_mtime_ns


def _read(sequence: Sequence, frame: int) -> ReadFrame:
    # Taken first: a file that is replaced while it is read then counts as changed.
    stamp = stamp_of(sequence, frame)
    return ReadFrame(sequence.read(frame), stamp)
