# SPDX-License-Identifier: Apache-2.0
"""Strips of an OpenEXR file, decoded by the package OpenEXR: some chunks at a time.

That package decodes twice as fast as OpenImageIO does (docs/guides/production.md), but it reads a
file as a whole: every part, channel and row. So it is handed files that lie in memory and hold what
is wanted: a header like the real one, of fewer rows, and the chunks of one part that hold those, as
they are. What it is not handed is never decoded. Chunks that are not compressed are taken as they
are.

Whatever is unusual is left to OpenImageIO (strips.py), which says what is wrong with it: `Unusual`.
The format: "Technical Introduction to OpenEXR" and "OpenEXR File Layout", openexr.com.
"""

import io
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from asglight.images.decoding.reduction import Planes

HEADER_MAX = 2**20
"""Bytes of the headers of all parts: a preview image is 40 KB."""

STRIP_BYTES = 2**22
"""Of decoded channels, at least one row of chunks: they stay in the processor's cache until they
are reduced. A 4k map takes 5 to 10 % longer with 1 MB, for OpenEXR is set up for each strip, and no
less with 8 MB (docs/guides/production.md)."""

# Rows of a chunk by the number of the compression: none, RLE, ZIPS, ZIP, PIZ, PXR24, B44, B44A,
# DWAA, DWAB.
_CHUNK_ROWS = (1, 1, 1, 16, 32, 16, 32, 32, 32, 256)
_UNCOMPRESSED = 0
_PIXELS = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))

_MAGIC = 20000630
_VERSION, _TILED, _LONG_NAMES, _PARTS = 0xFF, 0x200, 0x400, 0x1000

Attributes = dict[bytes, tuple[bytes, bytes]]
"""Of a part: type and value by name."""


class Unusual(Exception):  # noqa: N818  it is no error of the file
    """A file that this does not read."""


class ExrChunks:
    """The chunks of one part of an open file.

    Attributes:
        window: The data window: left, top, right, bottom, all inside.
    """

    def __init__(self, path: Path, part: int, channels: tuple[str, str, str]) -> None:
        """Read header and chunk table.

        Args:
            path: The file.
            part: Number of the part.
            channels: Names of red, green and blue.

        Raises:
            Unusual: The file has something that this does not know, or is damaged.
            OSError: It cannot be read.
        """
        self._stream = path.open("rb", buffering=0)
        try:
            self._read_header(part, channels)
        except (IndexError, KeyError, ValueError, struct.error) as error:
            self.close()
            raise Unusual from error
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def spans(self) -> Iterator[tuple[int, int]]:
        """Yield rows of the data window, first and after the last, from top to bottom."""
        _, top, _, bottom = self.window
        for begin in range(top, bottom + 1, self._strip_rows):
            yield begin, min(begin + self._strip_rows, bottom + 1)

    def planes(self, begin: int, end: int) -> Planes:
        """Decode some rows, one of `spans`.

        Returns:
            Red, green and blue, of the type that the file stores where that is a float and the same
            for all three, else float32.  [end - begin, w]

        Raises:
            Unusual: The chunks are damaged or missing.
            OSError: They cannot be read.
        """
        try:
            chunks, places = self._chunks(begin, end)
            found = self._stored(chunks, places, begin, end)
            if found is None:
                found = self._decoded(chunks, places, begin, end)
        except (IndexError, KeyError, ValueError, RuntimeError, struct.error) as error:
            raise Unusual from error
        kinds = {plane.dtype for plane in found}
        if len(kinds) > 1 or kinds == {_PIXELS[0]}:
            found = [plane.astype(np.float32) for plane in found]
        red, green, blue = found
        return red, green, blue

    def _read_header(self, part: int, channels: tuple[str, str, str]) -> None:
        start = self._stream.read(HEADER_MAX)
        magic, version = struct.unpack_from("<II", start)
        known = _VERSION | _TILED | _LONG_NAMES | _PARTS
        if magic != _MAGIC or version & ~known or version & _VERSION != 2:
            raise Unusual
        parts, place = _headers(start, has_parts=bool(version & _PARTS))
        counts = [_chunk_count(one, is_tiled=_is_tiled(one, version)) for one in parts]
        wanted = parts[part]
        self._in_parts = bool(version & _PARTS)
        self.window = struct.unpack("<4i", wanted[b"dataWindow"][1])
        self._compression = wanted[b"compression"][1][0]
        self._tiles = _tile_size(wanted) if _is_tiled(wanted, version) else None
        self._listed = _channels(wanted[b"channels"][1])
        self._names = channels
        names = [name for name, _ in self._listed]
        if not set(channels) <= set(names) or len(set(names)) < len(names):
            raise Unusual
        self._flags = 2 | version & _LONG_NAMES | (_TILED if self._tiles else 0)
        self._kept = b"".join(
            _attribute(name, *wanted[name]) for name in (b"channels", b"compression")
        )
        if self._tiles:  # whatever levels there are, the largest alone is read
            self._kept += _attribute(b"tiles", b"tiledesc", struct.pack("<IIB", *self._tiles, 0))
        width, height = _size(wanted)
        row_bytes = width * sum(kind.itemsize for _, kind in self._listed)
        high = self._tiles[1] if self._tiles else _CHUNK_ROWS[self._compression]
        self._chunk_rows = high
        self._across = -(-width // self._tiles[0]) if self._tiles else 1
        self._strip_rows = high * max(1, STRIP_BYTES // (high * row_bytes))
        self._row_bytes = row_bytes
        self._table = self._read_table(place, counts, part)[: self._across * -(-height // high)]
        self._size = self._stream.seek(0, io.SEEK_END)
        # a file that was not finished has zeros for what is missing
        if len(self._table) == 0 or self._table.min() < place or self._table.max() >= self._size:
            raise Unusual

    def _read_table(self, place: int, counts: list[int], part: int) -> NDArray[np.uint64]:
        """Return where the chunks of a part are.  [chunks of it]."""
        self._stream.seek(place + 8 * sum(counts[:part]))
        found = _read(self._stream, 8 * counts[part])
        return np.frombuffer(found, "<u8")

    def _chunks(self, begin: int, end: int) -> tuple[bytearray, list[int]]:
        """Return the chunks of some rows, and where each begins in them."""
        rows = range(begin - self.window[1], end - self.window[1], self._chunk_rows)
        low = rows[0] // self._chunk_rows * self._across
        high = low + len(rows) * self._across
        table = [int(place) for place in self._table[low:high]]
        first, stop = min(table), self._size
        following = self._table[high : high + 1]
        if len(following) and first < following[0]:
            stop = int(following[0])
        head = 4 * self._in_parts + (20 if self._tiles else 8)
        # no chunk is larger than what it holds; tiles at the edges hold less
        most = len(table) * (head + self._chunk_bytes())
        if max(table) < first + most and stop - first <= most:
            self._stream.seek(first)
            return _read(self._stream, stop - first), [
                place - first + 4 * self._in_parts for place in table
            ]
        chunks, places = bytearray(), []
        for place in table:
            self._stream.seek(place)
            start = _read(self._stream, head)
            (size,) = struct.unpack_from("<i", start, head - 4)
            if not 0 <= size <= self._chunk_bytes():
                raise Unusual
            places.append(len(chunks) + 4 * self._in_parts)
            chunks += start + _read(self._stream, size)
        return chunks, places

    def _chunk_bytes(self) -> int:
        """Return the size of a decoded chunk."""
        width = self.window[2] - self.window[0] + 1
        per_texel = self._row_bytes // width
        return self._chunk_rows * per_texel * (self._tiles[0] if self._tiles else width)

    def _decoded(self, chunks: bytearray, places: list[int], begin: int, end: int) -> list[NDArray]:
        """Let OpenEXR decode chunks."""
        left, top, right, _ = self.window
        if self._tiles:  # they are numbered from the top of the data window
            row = (begin - top) // self._chunk_rows
            for number, place in enumerate(places):
                found = struct.unpack_from("<4i", chunks, place)
                down, across = divmod(number, self._across)
                if found != (across, row + down, 0, 0):
                    raise Unusual
                struct.pack_into("<i", chunks, place + 4, down)
        window = struct.pack("<4i", left, begin, right, end - 1)
        head = b"".join(
            [
                struct.pack("<II", _MAGIC, self._flags),
                self._kept,
                _attribute(b"dataWindow", b"box2i", window),
                _attribute(b"displayWindow", b"box2i", window),
                _attribute(b"lineOrder", b"lineOrder", b"\0"),
                _attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
                _attribute(b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
                _attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)),
                b"\0",
            ]
        )
        begins = len(head) + 8 * len(places)
        table = np.array(places, "<u8") + np.uint64(begins)
        whole = io.BytesIO(b"".join([head, table.tobytes(), chunks]))
        file: Any = OpenEXR.File(whole, separate_channels=True, num_threads=0)
        decoded = file.channels()  # there are none where a chunk is damaged
        planes = [decoded[name].pixels for name in self._names]
        if any(plane.shape != (end - begin, right - left + 1) for plane in planes):
            raise Unusual
        return planes

    def _stored(
        self, chunks: bytearray, places: list[int], begin: int, end: int
    ) -> list[NDArray] | None:
        """Return rows that are not compressed as they lie there: number, size, each channel.

        None where they are compressed, in tiles, or not one after the other.
        """
        length = 8 + self._row_bytes
        step = length + 4 * self._in_parts
        is_plain = self._compression == _UNCOMPRESSED and not self._tiles
        if not is_plain or places != [places[0] + step * k for k in range(len(places))]:
            return None
        lines = np.ndarray((end - begin, length), np.uint8, chunks, places[0], (step, 1))
        stated = lines[:, :8].copy().view("<i4")
        if (stated != np.stack([np.arange(begin, end), np.full(end - begin, length - 8)], 1)).any():
            raise Unusual
        width, place, planes = self.window[2] - self.window[0] + 1, 8, {}
        for name, kind in self._listed:
            after = place + width * kind.itemsize
            planes[name] = lines[:, place:after].view(kind)
            place = after
        return [planes[name] for name in self._names]


def _headers(start: bytes, *, has_parts: bool) -> tuple[list[Attributes], int]:
    """Return the attributes of every part, and where the chunk tables begin."""
    parts: list[Attributes] = []
    place = 8
    while True:
        attributes: Attributes = {}
        while start[place] != 0:
            name, place = _text(start, place)
            kind, place = _text(start, place)
            (size,) = struct.unpack_from("<i", start, place)
            place += 4
            if size < 0 or place + size >= len(start):
                raise Unusual
            attributes[name] = (kind, start[place : place + size])
            place += size
        place += 1
        parts.append(attributes)
        if not has_parts:
            return parts, place
        if start[place] == 0:
            return parts, place + 1


def _text(start: bytes, place: int) -> tuple[bytes, int]:
    end = start.index(b"\0", place)
    return start[place:end], end + 1


def _attribute(name: bytes, kind: bytes, value: bytes) -> bytes:
    return b"".join([name, b"\0", kind, b"\0", struct.pack("<i", len(value)), value])


def _channels(value: bytes) -> list[tuple[str, np.dtype]]:
    """Return name and type of every channel, in the order in which they are stored."""
    found, place = [], 0
    while value[place] != 0:
        name, place = _text(value, place)
        kind, _, across, down = struct.unpack_from("<iB3xii", value, place)
        place += 16
        if (across, down) != (1, 1):
            raise Unusual
        found.append((name.decode(), _PIXELS[kind]))
    return found


def _is_tiled(part: Attributes, version: int) -> bool:
    if b"type" in part:
        kind = part[b"type"][1].rstrip(b"\0")
        if kind not in (b"scanlineimage", b"tiledimage"):
            raise Unusual
        return kind == b"tiledimage"
    return bool(version & _TILED)


def _tile_size(part: Attributes) -> tuple[int, int]:
    width, height, _ = struct.unpack("<IIB", part[b"tiles"][1])
    if not (0 < width < 2**16 and 0 < height < 2**16):
        raise Unusual
    return width, height


def _size(part: Attributes) -> tuple[int, int]:
    left, top, right, bottom = struct.unpack("<4i", part[b"dataWindow"][1])
    return right - left + 1, bottom - top + 1


def _chunk_count(part: Attributes, *, is_tiled: bool) -> int:
    """Return how many chunks a part has; of a file of one part those of the full size count."""
    if b"chunkCount" in part:
        return struct.unpack("<i", part[b"chunkCount"][1])[0]
    width, height = _size(part)
    if not is_tiled:
        return math.ceil(height / _CHUNK_ROWS[part[b"compression"][1][0]])
    across, down = _tile_size(part)
    return math.ceil(width / across) * math.ceil(height / down)


def _read(stream: BinaryIO, size: int) -> bytearray:
    """Read so many bytes.

    Raises:
        Unusual: The file ends before.
    """
    found = bytearray(size)
    view, count = memoryview(found), 0
    while count < size:
        taken = stream.readinto(view[count:])  # pyright: ignore[reportAttributeAccessIssue]
        if not taken:
            raise Unusual
        count += taken
    return found
