# SPDX-License-Identifier: Apache-2.0
"""Where an image is decoded: in this process, or apart from it, so that no file can end a fit.

Apart is a process (apart.py) that afterwards waits for the next image that is wanted, by whatever
thread. It is an interpreter with numpy and OpenImageIO, without torch. Pixels come back through
shared memory, so they are copied once.
"""

import atexit
import os
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from asglight.errors import InputError
from asglight.images.decoding.apart import Apart, ApartError
from asglight.images.decoding.decode import DamagedError, Header, read_header, unreadable
from asglight.images.decoding.decoding_process import SLOTS, from_json, to_json
from asglight.images.decoding.strips import STRIP_ROWS, read_strips


class Decoder(Protocol):
    """Reads headers and pixels of image files."""

    def header(self, path: Path, layer: str | None) -> Header:
        """Read what a file says of its image, as `decode.read_header`."""
        ...

    def strips(self, header: Header) -> Generator[np.ndarray]:
        """Decode the image, as `strips.read_strips`; a strip lasts until the next one."""
        ...


class Here:
    """Decodes in this process."""

    def header(self, path: Path, layer: str | None) -> Header:
        """Read what a file says of its image."""
        return read_header(path, layer)

    def strips(self, header: Header) -> Generator[np.ndarray]:
        """Decode the image."""
        yield from read_strips(header)


class Elsewhere:
    """Decodes in other processes: as many as there are threads that read at the same time."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._idle: list[Apart] = []
        self._lock = threading.Lock()
        self._owner = os.getpid()
        atexit.register(self.close)

    def header(self, path: Path, layer: str | None) -> Header:
        """Read what a file says of its image.

        Raises:
            DamagedError: As `read_header`; or the file ends the process, or occupies it for too
                long.
        """
        with self._lent(path) as process:
            process.tell({"path": str(path), "layer": layer, "folder": os.getcwd()})
            return from_json(_checked(process.reply(), path)["header"])

    def strips(self, header: Header) -> Generator[np.ndarray]:
        """Decode the image.

        Raises:
            DamagedError: As `read_strips`; or the file ends the process, or occupies it for too
                long.
        """
        slot = 4 * 3 * header.width * min(STRIP_ROWS, header.height)
        with self._lent(header.path) as process:
            memory = process.grow(SLOTS * slot)
            process.tell({"header": to_json(header), "slot": slot, "folder": os.getcwd()})
            number = rows = 0
            while (shape := _checked(process.reply(), header.path)["shape"]) is not None:
                count = shape[0] * shape[1] * shape[2]
                strip = np.frombuffer(memory, np.float32, count, number % SLOTS * slot)
                yield strip.reshape(shape)
                number, rows = number + 1, rows + shape[0]
                process.tell({})  # a slot is free
            assert rows == header.height, (rows, header)

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


def _checked(reply: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return a reply that is no refusal."""
    if "refused" not in reply:
        return reply
    message = reply["refused"]
    if reply["finding"] is None:
        raise InputError(message)
    raise DamagedError(path, reply["finding"], message.partition("; ")[2])
