# SPDX-License-Identifier: Apache-2.0
"""The reduced frames of a shot that is read more than once, so that none is decoded twice.

A frame of 4096 x 2048 texels takes a tenth of a second to decode, and is 1.5 MB when it is reduced
to the fit's 512 x 256. The first frames are kept in memory, as many as there is room for; those
that follow in a file beside the output, `shot.usda.frames`, if they are worth it. The file is
deleted when the stage is written. After an interruption `--resume` takes up the file too; a frame
in it is used if its image is unchanged.

The file holds a header (JSON, one line), and of each frame a line of JSON with its number, the
state of its image, its shape and a checksum, and then its radiance. What is cut off or damaged is
not used. Where the file cannot be written or grows no more, frames are decoded again.
"""

import contextlib
import json
import threading
import zlib
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from asglight.images import Sequence
from asglight.shots.reading import ReadFrame, ahead, read_unchanging, stamp_of

SUFFIX = ".frames"

MEMORY_BYTES = 2**28
"""Of frames kept in memory: 170 frames of 512 x 256 texels, seven seconds of a shot."""

WORTH_FACTOR = 4
"""Times as many texels as the frame when it is reduced that an image has whose frame goes to disk:
smaller ones are decoded in a few milliseconds, hardly more than the disk takes."""

FORMAT = "asglight frames"
_FIRST_BYTES = b'{"format": "asglight frames"'
_HEADER_MAX, _LINE_MAX = 2**22, 1000


class Kept(NamedTuple):
    """A reduced frame.

    Attributes:
        radiance: Linear Rec.709.  [H, 2 H, 3] float32
        stamp: Size in bytes and modification time in ns of its image.
    """

    radiance: Tensor
    stamp: tuple[int, int]


class _OnDisk(NamedTuple):
    place: int
    shape: tuple[int, int, int]
    checksum: int
    stamp: tuple[int, int]


class KeptFrames:
    """Reduced frames, in memory and on disk.

    Several threads may read at a time.
    """

    def __init__(
        self,
        sequence: Sequence,
        path: Path | None = None,
        *,
        is_needed: bool = True,
        header: dict[str, Any] | None = None,
        resume: bool = False,
        memory_bytes: int = MEMORY_BYTES,
    ) -> None:
        """Keep nothing yet, but for what an earlier run has left.

        Args:
            sequence: The shot.
            path: The file beside the output; None to keep frames in memory only.
            is_needed: Frames are read again; without it none is kept.
            header: What the run is; the file of another kind of run is not taken up.
            resume: Take up the file of an earlier run.
            memory_bytes: Of frames in memory, at most.
        """
        self._sequence = sequence
        self._path = path
        self._is_needed = is_needed
        self._header = {"format": FORMAT, **(header or {})}
        self._free = memory_bytes
        self._in_memory: dict[int, Kept] = {}
        self._images: dict[int, ReadFrame] = {}  # without their radiance
        self._on_disk: dict[int, _OnDisk] = {}
        self._stream: BinaryIO | None = None
        self._is_ours = path is not None and _is_ours(path)
        self._lock = threading.Lock()
        if resume and self._is_ours:
            self._take_up()

    def __enter__(self) -> Self:
        """Return the frames."""
        return self

    def __exit__(self, *_: object) -> None:
        """Forget the frames in memory; the file stays for a run that resumes this one."""
        self._in_memory.clear()
        self._images.clear()
        self._on_disk.clear()
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def first(self, frames: list[int]) -> Generator[ReadFrame]:
        """Read frames in order, some ahead of the one in use, and keep them.

        Raises:
            InputError: A frame cannot be read; raised when its turn comes.
        """
        return ahead(self._first, frames)

    def again(self, frames: list[int]) -> Generator[Kept]:
        """Read what frames show once more, in order.

        Raises:
            InputError: A frame cannot be read; raised when its turn comes.
        """
        return ahead(self._again, frames)

    def remove(self) -> None:
        """Delete the file: the shot is written."""
        if self._path is not None and self._is_ours:
            with contextlib.suppress(FileNotFoundError):
                self._path.unlink()

    def _first(self, frame: int) -> ReadFrame:
        kept, image = self._known(frame), self._images.get(frame)
        if kept is not None and image is not None and image.stamp == kept.stamp:
            return image._replace(image=replace(image.image, radiance=kept.radiance))
        return self._read(frame)

    def _again(self, frame: int) -> Kept:
        kept = self._known(frame)
        if kept is not None:
            return kept
        read = self._read(frame)
        return Kept(read.image.radiance, read.stamp)

    def _known(self, frame: int) -> Kept | None:
        """Return a frame that is kept, and whose image is unchanged."""
        if frame not in self._in_memory and frame not in self._on_disk:
            return None
        stamp = stamp_of(self._sequence, frame)
        with self._lock:
            kept = self._in_memory.get(frame)
            if kept is None and frame in self._on_disk and self._on_disk[frame].stamp == stamp:
                kept = self._from_disk(frame)
        return kept if kept is not None and kept.stamp == stamp else None

    def _read(self, frame: int) -> ReadFrame:
        """Read a frame, and keep it where that is of use."""
        read = read_unchanging(self._sequence, frame)
        if not self._is_needed:
            return read
        radiance = read.image.radiance
        size = radiance.numel() * radiance.element_size()
        rows, columns = read.image.source_shape
        is_worth = rows * columns >= WORTH_FACTOR * radiance[..., 0].numel()
        with self._lock:
            if size <= self._free:
                self._free -= size
                self._in_memory[frame] = Kept(radiance, read.stamp)
            elif self._path is not None and is_worth:
                self._write(frame, radiance, read.stamp)
            if frame in self._in_memory or frame in self._on_disk:
                without = replace(read.image, radiance=radiance.new_empty(0))
                self._images[frame] = read._replace(image=without)
        return read

    def _write(self, frame: int, radiance: Tensor, stamp: tuple[int, int]) -> None:
        """Append a frame to the file; where that fails, give the file up."""
        assert self._path is not None
        try:
            if self._stream is None:
                if self._path.exists() and not self._is_ours:
                    self._path = None  # somebody else's
                    return
                self._stream = self._path.open("w+b")
                self._is_ours = True
                self._stream.write(_line(self._header))
            values = radiance.contiguous().numpy()
            line = {
                "frame": frame,
                "stamp": stamp,
                "shape": values.shape,
                "checksum": zlib.crc32(values.data),
            }
            self._stream.seek(0, 2)
            self._stream.write(_line(line))
            place = self._stream.tell()
            self._stream.write(values.data)
            self._stream.flush()
        except OSError:  # as of a disk that is full, which the stage needs more
            self._on_disk.clear()
            if self._stream is not None:
                with contextlib.suppress(OSError):
                    self._stream.close()
                self._stream = None
            with contextlib.suppress(OSError):
                self.remove()
            self._path = None
        else:
            height, width, channels = values.shape
            shape = height, width, channels
            self._on_disk[frame] = _OnDisk(place, shape, line["checksum"], stamp)

    def _from_disk(self, frame: int) -> Kept | None:
        """Return a frame; None where the file does not hold any more what was written."""
        assert self._stream is not None
        there = self._on_disk[frame]
        values = np.empty(there.shape, np.float32)
        try:
            self._stream.seek(there.place)
            count = self._stream.readinto(values.data.cast("B"))
        except OSError:
            return None
        if count != values.nbytes or zlib.crc32(values.data) != there.checksum:
            return None
        return Kept(torch.from_numpy(values), there.stamp)

    def _take_up(self) -> None:
        """Find the frames that an earlier run has left; the file grows after the last whole one."""
        assert self._path is not None
        try:
            stream = self._path.open("r+b")
        except OSError:
            return
        try:
            if stream.readline(_HEADER_MAX) != _line(self._header):
                stream.close()
                return
            end = stream.tell()
            size = stream.seek(0, 2)
            stream.seek(end)
            while (found := _parsed(stream)) is not None:
                frame, there = found
                after = there.place + int(np.prod(there.shape)) * 4
                if after > size:
                    break
                self._on_disk[frame], end = there, after
                stream.seek(end)
            stream.truncate(end)
        except OSError:
            stream.close()
            self._on_disk.clear()
            return
        self._stream = stream


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(_FIRST_BYTES)) == _FIRST_BYTES
    except OSError:
        return False


def _line(values: dict[str, Any]) -> bytes:
    return json.dumps(values).encode() + b"\n"


def _parsed(stream: BinaryIO) -> tuple[int, _OnDisk] | None:
    """Read the line of a frame; None at the end, or where there is no such line."""
    line = stream.readline(_LINE_MAX)
    try:
        values = json.loads(line)
        height, width, channels = map(int, values["shape"])
        size, modified = map(int, values["stamp"])
        if not line.endswith(b"\n") or min(height, width) < 1 or channels != 3:
            return None
        there = _OnDisk(
            stream.tell(), (height, width, channels), int(values["checksum"]), (size, modified)
        )
        return int(values["frame"]), there
    except (KeyError, TypeError, ValueError):
        return None
