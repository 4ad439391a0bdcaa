# SPDX-License-Identifier: Apache-2.0
"""Where an image is decoded: in this process, or apart from it, so that no file can end a fit.

Apart is a process (apart.py) that afterwards waits for the next image that is wanted, by whatever
thread. It is an interpreter with numpy, OpenImageIO and OpenEXR, without torch. It repairs and
reduces what it decodes; the result comes back through shared memory, so it is copied once.
"""

import atexit
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from asglight.errors import InputError
from asglight.images.decoding.apart import Apart, ApartError
from asglight.images.decoding.header import (
    SLOTS,
    DamagedError,
    Header,
    from_json,
    row_bytes,
    slot_rows,
    to_json,
    unreadable,
)
from asglight.images.options import ReadOptions
from asglight.images.repair import Tally


class Decoder(Protocol):
    """Reads headers and pixels of image files."""

    def header(self, path: Path, reading: ReadOptions) -> Header:
        """Read what a file says of its image, as `decode.read_header`."""
        ...

    def pixels(self, header: Header, height: int) -> tuple[np.ndarray, Tally]:
        """Decode, repair and average the image, as `strips.reduced_strips`.

        Returns:
            Result, [height, 2 height, 3] float32, and what was repaired.
        """
        ...


class Here:
    """Decodes in this process, which loads what that takes when it is first asked."""

    def header(self, path: Path, reading: ReadOptions) -> Header:
        """Read what a file says of its image."""
        from asglight.images.decoding.decode import read_header

        return read_header(path, reading)

    def pixels(self, header: Header, height: int) -> tuple[np.ndarray, Tally]:
        """Decode, repair and average the image.

        Raises:
            DamagedError: As `reduced_strips`; or it has other rows than its header says.
        """
        from asglight.images.decoding.strips import reduced_strips

        result, row = np.empty((height, 2 * height, 3), np.float32), 0
        strips = reduced_strips(header, height)
        while True:
            try:
                rows = next(strips)
            except StopIteration as end:
                _check_rows(header, row, height)
                return result, end.value
            row += len(rows)
            if row <= height:
                result[row - len(rows) : row] = rows


class Elsewhere:
    """Decodes in other processes: as many as there are threads that read at the same time."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._idle: list[Apart] = []
        self._lock = threading.Lock()
        self._owner = os.getpid()
        atexit.register(self.close)

    def header(self, path: Path, reading: ReadOptions) -> Header:
        """Read what a file says of its image.

        Raises:
            DamagedError: As `read_header`; or the file ends the process, or occupies it for too
                long.
        """
        with self._lent(path) as process:
            process.tell({"path": str(path), "reading": vars(reading), "folder": os.getcwd()})
            return from_json(_checked(process.reply(), path)["header"])

    def pixels(self, header: Header, height: int) -> tuple[np.ndarray, Tally]:
        """Decode, repair and average the image.

        Raises:
            DamagedError: As `reduced_strips`; or the file ends the process, or occupies it for too
                long.
        """
        slot = slot_rows(height) * row_bytes(height)
        result, row = np.empty((height, 2 * height, 3), np.float32), 0
        request = {"header": to_json(header), "height": height, "folder": os.getcwd()}
        with self._lent(header.path) as process:
            memory = process.grow(SLOTS * slot)
            process.tell(request)
            number = 0
            while (reply := _checked(process.reply(), header.path))["rows"]:
                rows = reply["rows"]
                values = np.frombuffer(memory, np.float32, rows * 6 * height, number % SLOTS * slot)
                number, row = number + 1, row + rows
                if row <= height:
                    result[row - rows : row] = values.reshape(rows, 2 * height, 3)
                process.tell({})  # a slot is free
            _check_rows(header, row, height)
        tally = reply["tally"]
        return result, Tally(**tally | {"first": tally["first"] and tuple(tally["first"])})

    def prepare(self) -> None:
        """Start a process for the first image, while the caller loads what it needs for others."""
        self._put(self._take())

    def close(self) -> None:
        """End the processes that wait."""
        with self._lock:
            idle, self._idle = self._idle, []
        for process in idle:
            process.close()

    @contextmanager
    def _lent(self, path: Path) -> Iterator[Apart]:
        """Give a process that decodes, and take it back if it is free again."""
        process = self._take()
        try:
            yield process
        except InputError:  # it has refused the file
            self._put(process)
            raise
        except ApartError as error:
            raise unreadable(path, str(error)) from error
        except BaseException:
            process.close()
            raise
        self._put(process)

    def _take(self) -> Apart:
        with self._lock:
            if os.getpid() != self._owner:  # forked: those that wait are the parent's
                self._owner, self._idle = os.getpid(), []
            if self._idle:
                return self._idle.pop()
        return Apart("asglight.images.decoding.decoding_process")

    def _put(self, process: Apart) -> None:
        with self._lock:
            self._idle.append(process)


HERE = Here()
APART = Elsewhere()


def _check_rows(header: Header, rows: int, height: int) -> None:
    """Refuse an image of which other rows came than its header says.

    Raises:
        DamagedError: They are more or fewer.
    """
    if rows != height:
        raise unreadable(header.path, f"{rows} of {height} rows came")


def _checked(reply: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return a reply that is no refusal."""
    if "refused" not in reply:
        return reply
    message = reply["refused"]
    if reply["finding"] is None:
        raise InputError(message)
    raise DamagedError(path, reply["finding"], message.partition("; ")[2])
