# SPDX-License-Identifier: Apache-2.0
"""Frames as they come: files in a folder that is written, or raw numbers from a stream.

A feed is followed by its newest frame. What came while a frame was being fitted is dropped but for
the last, so a frame waits for one fit at most before its own; or every frame is taken in its turn.
"""

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong
from asglight.images.decoding.decoders import APART
from asglight.images.decoding.header import DamagedError
from asglight.images.frame_files import NothingThereError, find_growing, is_pattern
from asglight.images.message import shown
from asglight.images.options import ReadOptions

POLL_SECONDS = 0.02
"""Between two looks into a folder: half a frame at 24 a second, and a hundred times what a look at
a thousand files takes."""

SETTLED_SECONDS = 1.0
"""Since a file changed, from which it counts as whole, and is passed over if it cannot be read: who
writes a frame of 24 a second takes a 24th of that."""


_Stamp = tuple[int, int, int] | None


class Taken(NamedTuple):
    """A frame of a feed.

    Attributes:
        number: Of the frame: in its file's name, or counted from 1.
        radiance: [H, 2 H, 3]
        dropped: Frames that were passed over since the one before.
        arrived: When it was seen, in seconds of `time.monotonic`.
    """

    number: int
    radiance: Any
    dropped: int
    arrived: float


@dataclass(frozen=True)
class RawFormat:
    """Raw frames: red, green and blue of each texel after each other, rows from the top.

    Attributes:
        width: Texels of a row; twice the rows.
        height: Rows.
        kind: `float16` or `float32`, little-endian.
    """

    width: int
    height: int
    kind: str

    @property
    def type(self) -> np.dtype:
        """Return the type of a number."""
        return np.dtype(self.kind).newbyteorder("<")

    @property
    def size(self) -> int:
        """Return the bytes of a frame."""
        return 3 * self.width * self.height * self.type.itemsize

    def array(self, data: bytes) -> np.ndarray:
        """Return a frame.  [H, W, 3]."""
        return np.frombuffer(data, self.type).reshape(self.height, self.width, 3)


class Newest:
    """Holds the newest frame until it is taken; frames are put in one thread and taken in another.

    Nothing is waited for on the side that puts.
    """

    def __init__(self) -> None:
        """Hold nothing."""
        self._changed = threading.Condition()
        self._held: tuple[int, bytes, float] | None = None
        self._is_over = False
        self._dropped = 0
        self._failure: BaseException | None = None

    def put(self, number: int, data: bytes) -> None:
        """Take the place of the frame that is held, if one is."""
        with self._changed:
            self._dropped += self._held is not None
            self._held = number, data, time.monotonic()
            self._changed.notify()

    def end(self, failure: BaseException | None = None) -> None:
        """Say that no more will come, and why if something is wrong."""
        with self._changed:
            self._is_over, self._failure = True, failure
            self._changed.notify()

    def take(self) -> tuple[int, bytes, float, int] | None:
        """Wait for a frame; return its number, data, arrival and how many were dropped for it.

        Returns:
            None at the end.

        Raises:
            BaseException: What the feed ended with, after the last frame.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._held is not None or self._is_over)
            if self._held is None:
                if self._failure is not None:
                    raise self._failure
                return None
            (number, data, arrived), self._held = self._held, None
            dropped, self._dropped = self._dropped, 0
            return number, data, arrived, dropped


def raw_frames(stream: BinaryIO, form: RawFormat, *, every: bool) -> Iterator[Taken]:
    """Take frames from a stream until it ends.

    Args:
        stream: What they are read from.
        form: What they are.
        every: Take every frame, and let who writes the stream wait; else the newest.

    Raises:
        InputError: The stream ends within a frame, or cannot be read.
    """
    if every:
        for number, data in _whole_frames(stream, form):
            yield Taken(number, form.array(data), 0, time.monotonic())
        return
    newest = Newest()
    threading.Thread(
        target=_put_all, args=(stream, form, newest), name="asglight-feed", daemon=True
    ).start()
    while (found := newest.take()) is not None:
        number, data, arrived, dropped = found
        yield Taken(number, form.array(data), dropped, arrived)


def _put_all(stream: BinaryIO, form: RawFormat, newest: Newest) -> None:
    """Put every frame of a stream; this is what the thread does."""
    try:
        for number, data in _whole_frames(stream, form):
            newest.put(number, data)
    except BaseException as error:  # nobody else hears of it, and who takes would wait for ever
        newest.end(error)
    else:
        newest.end()


def _whole_frames(stream: BinaryIO, form: RawFormat) -> Iterator[tuple[int, bytes]]:
    number = 0
    while data := _read(stream, form.size):
        number += 1
        if len(data) < form.size:
            raise InputError(
                f"standard input: ends {len(data):,} bytes into frame {number}; expected whole "
                f"frames of {form.size:,} bytes ({form.width} x {form.height} x 3 {form.kind}). "
                "Check --size and --type."
            )
        yield number, data


def _read(stream: BinaryIO, count: int) -> bytes:
    """Read so many bytes, fewer at the end only: a pipe gives what it has."""
    parts, missing = [], count
    try:
        while missing and (part := stream.read(missing)):
            parts.append(part)
            missing -= len(part)
    except OSError as error:
        raise InputError(
            f"standard input: cannot be read ({error.strerror}); expected raw frames."
        ) from error
    return b"".join(parts)


class Folder:
    """A folder or a pattern whose files come one by one."""

    def __init__(
        self,
        source: str,
        reading: ReadOptions,
        *,
        every: bool = False,
        idle: float | None = None,
        on_skip: Callable[[str], None] = lambda _: None,
        pause: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Look at nothing yet.

        Args:
            source: The folder, or a pattern such as `sky.####.exr`.
            reading: How its images are read.
            every: Take every frame in the order of their numbers; else the newest.
            idle: Seconds without a new frame after which the feed ends; None for never.
            on_skip: Called with why a file is passed over.
            pause: Waits so many seconds.
            clock: Tells the seconds.
        """
        self._source, self._reading, self._every = source, reading, every
        self._idle, self._on_skip = idle, on_skip
        self._pause, self._clock = pause, clock
        self._seen: dict[int, float] = {}
        self._failed: dict[int, tuple[_Stamp, float]] = {}
        self._passed_over: set[int] = set()

    def frames(self) -> Iterator[Taken]:
        """Take frames as their files become whole.

        Raises:
            InputError: There is no such folder, it holds more than one sequence, or an image is no
                latlong.
        """
        if not (is_pattern(self._source) or os.path.exists(self._source)):
            raise InputError(
                f"{shown(self._source)}: is not there; expected the folder that is written, or a "
                "pattern such as sky.####.exr."
            )
        last, quiet_since = -math.inf, self._clock()
        while self._idle is None or self._clock() - quiet_since < self._idle:
            files = {number: path for number, path in self._files().items() if number > last}
            for number in files.keys() - self._seen.keys():
                self._seen[number] = quiet_since = self._clock()
            found = self._first_whole(files)
            if found is None:
                self._pause(POLL_SECONDS)
                continue
            number, radiance = found
            dropped = len([one for one in files if one < number and one not in self._passed_over])
            yield Taken(number, radiance, dropped, self._seen[number])
            last, quiet_since = number, self._clock()

    def _files(self) -> dict[int, Path]:
        """Return the files by frame; none before the first is there."""
        try:
            found = find_growing(self._source)
        except NothingThereError:
            return {}
        if not found.still:
            self._source = found.pattern  # what else comes into the folder is no frame
        return found.files

    def _first_whole(self, files: dict[int, Path]) -> tuple[int, Tensor] | None:
        """Return the frame whose turn it is, if one can be read."""
        for number in sorted(files.keys() - self._passed_over, reverse=not self._every):
            radiance = self._read(number, files[number])
            if radiance is not None:
                return number, radiance
            if self._every and number not in self._passed_over:
                return None  # it is being written; its turn comes first
        return None

    def _read(self, number: int, path: Path) -> Tensor | None:
        """Read a frame; None where it is being written, or was passed over."""
        before = _stamp(path)
        try:
            image = read_latlong(path, height=FIT_HEIGHT, reading=self._reading, decoder=APART)
        except DamagedError as error:
            stamp, since = self._failed.get(number, (None, 0.0))
            if stamp != before:
                self._failed[number] = before, self._clock()
            elif self._clock() - since >= SETTLED_SECONDS:
                self._passed_over.add(number)
                self._on_skip(str(error))
            return None
        return image.radiance if _stamp(path) == before else None


def _stamp(path: Path) -> _Stamp:
    """Return what changes while a file is written; None where it is gone."""
    try:
        state = os.stat(path)
    except OSError:
        return None
    return state.st_ino, state.st_size, state.st_mtime_ns
