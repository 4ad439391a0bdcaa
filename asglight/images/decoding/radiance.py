# SPDX-License-Identifier: Apache-2.0
"""Radiance pictures (.hdr, .pic): what their header says, and a copy that any decoder reads.

The lines are those of the Radiance file formats (Ward Larson, *Radiance File Formats*; `ra_xyze`),
and GAMMA of Walter's `rgbe.c`. EXPOSURE and COLORCORR are what the radiance has been multiplied
with; they are repeated by each program that did so, and multiply. A line that begins with a blank
is of a picture that this one was made of, and says nothing of this one.

Pixels are decoded by OpenImageIO, which knows one spelling of the header, and rows that are flat or
coded in runs of channels. For the rest, among them the old runs of pixels, `readable` writes a copy
in that spelling.
"""

import contextlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from asglight.images import colour
from asglight.images.colour import Chromaticities
from asglight.images.decoding import copies

MAGIC = b"#?"

HEADER_MAX = 65536
"""Bytes. Headers are a few lines; each program that touched the file adds one."""

_SIZE = re.compile(rb"([+-][XY])\s+(\d+)\s+([+-][XY])\s+(\d+)\s*")
_PLAIN = re.compile(rb"#\?(RADIANCE|RGBE)\n(?:.*\n)*?FORMAT=32-bit_rle_rgbe\n(?:.+\n)*\n")
_FORMATS = {"32-bit_rle_rgbe": "rgbe", "32-bit_rle_xyze": "xyze"}
_VIEWS = {
    "v": "a perspective view",
    "l": "a parallel view",
    "a": "a fisheye view",
    "h": "a fisheye view",
    "s": "a planisphere",
    "c": "a cylindrical view",
}
RUN_WIDTHS = range(8, 32768)
"""Widths of which rows may be coded in runs of channels."""


@dataclass(frozen=True)
class RadianceHeader:
    """What the lines of a Radiance file say.

    Attributes:
        format: `rgbe` or `xyze`.
        multiplier: What the radiance of each channel has been multiplied with: every EXPOSURE and
            every COLORCORR.
        gamma: The exponent that the values have been raised to the inverse of; 1 for none.
        primaries: Those of PRIMARIES; None without such a line.
        axes: How the pixels are stored, the slow axis first, such as `-Y`, `+X`.
        size: Their numbers along those axes.
        start: Offset of the pixels in bytes; 0 where there is no line of the size.
        faults: What is wrong in lines of colour, as clauses; their values are left out.
        notes: What was assumed.
    """

    format: str = "rgbe"
    multiplier: tuple[float, float, float] = (1.0, 1.0, 1.0)
    gamma: float = 1.0
    primaries: Chromaticities | None = None
    axes: tuple[str, str] = ("-Y", "+X")
    size: tuple[int, int] = (0, 0)
    start: int = 0
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_lines(path: Path) -> RadianceHeader:
    """Read the header of a Radiance file."""
    with path.open("rb") as stream:
        data = stream.read(HEADER_MAX)
    place, values = 0, _Values()
    while place < len(data):
        end = data.find(b"\n", place)
        line = data[place : end if end >= 0 else len(data)].rstrip(b"\r")
        after = end + 1 if end >= 0 else len(data)
        # The line of the size ends the header, whether or not an empty line comes before it.
        if match := _SIZE.fullmatch(line):
            axes = (match[1].decode(), match[3].decode())
            if axes[0][1] != axes[1][1]:
                return values.header(axes, (int(match[2]), int(match[4])), after)
        if place:
            values.take(line.decode("utf-8", "replace"))
        place = after
    return values.header(("-Y", "+X"), (0, 0), 0)


class _Values:
    """What has been read of a header so far."""

    def __init__(self) -> None:
        self._format: str | None = None
        self._multiplier = np.ones(3)
        self._gamma = 1.0
        self._primaries: Chromaticities | None = None
        self._faults: list[str] = []
        self._notes: list[str] = []

    def take(self, line: str) -> None:
        """Take one line."""
        if not line or line[0].isspace() or line.startswith("#"):
            return
        name, equals, text = line.partition("=")
        name, text = name.strip().upper(), text.strip()
        if not equals:
            return
        if name == "FORMAT":
            self._format = _FORMATS.get(text)
            if self._format is None:
                self._fault(f"FORMAT={text}", "32-bit_rle_rgbe or 32-bit_rle_xyze")
        elif name == "EXPOSURE":
            self._multiply(line, _positive(text, 1))
        elif name == "COLORCORR":
            self._multiply(line, _positive(text, 3))
        elif name == "GAMMA":
            gamma = _positive(text, 1)
            if gamma is None:
                self._fault(line, "a number above 0")
            else:
                self._gamma *= gamma[0]
        elif name == "PRIMARIES":
            self._primaries = _primaries(text)
            if self._primaries is None:
                self._fault(line, "eight numbers: x and y of red, green, blue and white")
        elif name == "VIEW":
            self._take_view(text)

    def _take_view(self, text: str) -> None:
        kinds = re.findall(r"(?:^|\s)-vt([a-z])", text)
        if kinds and kinds[-1] in _VIEWS:
            self._notes.append(
                f"VIEW says that it is {_VIEWS[kinds[-1]]}; taken as a latlong, for it is 2:1"
            )

    def _multiply(self, line: str, factors: list[float] | None) -> None:
        if factors is None:
            self._fault(line, "numbers above 0")
            return
        with np.errstate(over="ignore", under="ignore"):  # told when all lines are read
            self._multiplier = self._multiplier * np.array(factors)

    def _fault(self, line: str, expected: str) -> None:
        self._faults.append(f"{line.strip()[:80]} (expected {expected})")

    def header(self, axes: tuple[str, str], size: tuple[int, int], start: int) -> RadianceHeader:
        """Return what the lines say together."""
        notes, faults = self._notes, self._faults
        if self._format is None and not any(fault.startswith("FORMAT") for fault in faults):
            notes = ["no FORMAT line; taken as 32-bit_rle_rgbe", *notes]
        red, green, blue = (float(value) for value in self._multiplier)
        multiplier = (red, green, blue)
        if not all(math.isfinite(value) and value > 0 for value in multiplier):
            faults = [*faults, "EXPOSURE and COLORCORR that multiply to no number"]
            multiplier = (1.0, 1.0, 1.0)
        return RadianceHeader(
            self._format or "rgbe",
            multiplier,
            self._gamma,
            self._primaries,
            axes,
            size,
            start,
            tuple(faults),
            tuple(notes),
        )


def _positive(text: str, count: int) -> list[float] | None:
    """Return that many numbers above 0; None where the text holds something else."""
    numbers = _numbers(text)
    if numbers is None or len(numbers) != count or min(numbers) <= 0:
        return None
    return numbers


def _primaries(text: str) -> Chromaticities | None:
    numbers = _numbers(text)
    if numbers is None or len(numbers) != 8:
        return None
    red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = numbers
    found = (red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y)
    return found if colour.is_colour_space(found) else None


def _numbers(text: str) -> list[float] | None:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None


@contextlib.contextmanager
def readable(path: Path) -> Iterator[Path]:
    """Give a file that OpenImageIO decodes: this one, or a copy in the spelling that it knows.

    Yields:
        The file; a copy is gone afterwards.
    """
    header = read_lines(path)
    if not header.start:  # nothing to copy: the decoder says what is wrong
        yield path
        return
    with path.open("rb") as stream:
        head = stream.read(header.start)
        row = stream.read(4)
    stored = path.stat().st_size - header.start
    count = header.size[0] * header.size[1]
    in_runs = (
        header.size[1] in RUN_WIDTHS
        and row[:2] == b"\x02\x02"
        and row[2:4] == header.size[1].to_bytes(2)
    )
    is_flat = not in_runs and stored >= 4 * count
    plain = _PLAIN.match(head)
    if (in_runs or is_flat) and plain and plain.end() == head[:-1].rfind(b"\n") + 1:
        yield path
        return
    pixels: Any = np.memmap(path, np.uint8, "r", header.start) if stored else np.zeros(0, np.uint8)
    if not (in_runs or is_flat):
        pixels = unrolled(pixels, count)
    (slow, fast), (rows, columns) = header.axes, header.size
    with copies.empty(".hdr") as (copy, place):
        copy.write(
            f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{slow} {rows} {fast} {columns}\n".encode()
        )
        copy.write(memoryview(pixels))
        copy.flush()
        yield place


def unrolled(stored: np.ndarray, count: int) -> np.ndarray:
    """Return flat pixels of the old runs: (1, 1, 1, n) repeats the pixel before n times more.

    Of several such in a row each next one counts 256 times as much (Radiance, `oldreadcolrs`).

    Args:
        stored: Bytes of whole pixels; what is left over is no pixel.  [n] uint8
        count: Pixels of the image.

    Returns:
        Bytes of the pixels, as many as there are up to `count`.  [<= 4 count] uint8
    """
    pixels = np.asarray(stored)[: len(stored) // 4 * 4].reshape(-1, 4)
    is_run = (pixels[:, :3] == 1).all(axis=1)
    own = np.flatnonzero(~is_run)
    if not len(own):
        return pixels[:0].ravel()
    pixels, is_run = pixels[own[0] :], is_run[own[0] :]  # nothing to repeat before the first one
    own = own - own[0]
    place = np.cumsum(~is_run) - 1  # of the pixel that each entry is or repeats
    nth = np.arange(len(pixels)) - own[place] - 1  # of the runs that follow it
    # More than four of them would count beyond 2^32.
    shift = np.where(is_run, np.clip(8 * nth, 0, 32), 0)
    repeats = np.where(is_run, pixels[:, 3].astype(np.int64) << shift, 1)
    times = np.minimum(np.bincount(place, np.minimum(repeats, count)), count).astype(np.int64)
    ends = np.cumsum(times)
    enough = int(np.searchsorted(ends, count)) + 1
    return np.repeat(pixels[own[:enough]], times[:enough], axis=0)[:count].ravel()
