# SPDX-License-Identifier: Apache-2.0
"""Decoding OpenEXR and Radiance files, through OpenImageIO, with every fault in one line.

OpenImageIO decodes each OpenEXR compression, stops with a reason at missing or damaged chunks
instead of leaving zeros, refuses headers that claim far more than the file holds, and leaves
standard output alone, except for notes of its HTJ2K decoder on damaged files. The header is read
apart from the pixels, so that an image of the wrong shape is refused before anything is decoded.

Radiance files are taken as Rec.709 and as they are stored: OpenImageIO does not divide by the
EXPOSURE line, nor do most programs, and asglight's radiance is relative. The orientation line is
followed.
"""

import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO

from asglight.errors import InputError
from asglight.images import colour, layers
from asglight.images.colour import Chromaticities
from asglight.images.message import compressed, shown

# 32768 x 16384 is four times the largest map in circulation, and 6.4 GB as float32.
SIZE_MAX = 32768
# Radiance headers are a few lines; each program that touched the file adds one.
HEADER_MAX = 65536

_KINDS = {b"\x76\x2f\x31\x01": "openexr", b"#?RADIANCE": "hdr", b"#?RGBE": "hdr"}
_OTHERS = {
    b"\x89PNG": "a PNG image",
    b"\xff\xd8\xff": "a JPEG image",
    b"II*\0": "a TIFF image",
    b"MM\0*": "a TIFF image",
    b"SDPX": "a DPX image",
    b"XPDS": "a DPX image",
    b"PF\n": "a PFM image",
    b"RIFF": "a WebP or other RIFF file",
    b"\x1f\x8b": "a gzip archive",
    b"PK\x03\x04": "a zip archive",
}


@dataclass(frozen=True)
class Header:
    """What a file says of its image before the pixels are decoded.

    Attributes:
        path: The file.
        height: Rows of the upright image, that is of the display window.
        width: Columns of it.
        layer: The channels to read.
        axes: How the pixels are stored, the slow axis first, as Radiance writes it; `-Y`, `+X` is
            upright: down the rows, then along the columns.
        chromaticities: Primaries stated by the file, None for Rec.709.
    """

    path: Path
    height: int
    width: int
    layer: layers.Layer
    axes: tuple[str, str]
    chromaticities: Chromaticities | None


def read_header(path: Path, layer: str | None = None) -> Header:
    """Read what a file says of its image.

    Args:
        path: An OpenEXR or Radiance file, known by its content and not by its name.
        layer: Layer or part to read; None for the plain image.

    Raises:
        InputError: The file cannot be read, or holds no image of the kind asked for.
    """
    with _opened(path) as reader:
        parts = []
        while reader.seek_subimage(len(parts), 0):
            spec = reader.spec()
            parts.append((_text(spec, "name"), tuple(spec.channelnames)))
        chosen = layers.choose(path, parts, layer)
        spec = reader.spec(chosen.part, 0)
        if spec.deep:
            raise InputError(
                f"{shown(path)}: holds deep data; expected a flat image. Flatten it first."
            )
        height, width = spec.full_height, spec.full_width
        if max(height, width, spec.height, spec.width) > SIZE_MAX:
            raise InputError(
                f"{shown(path)}: declares {max(width, spec.width)} x {max(height, spec.height)} "
                f"texels; expected at most {SIZE_MAX} a side. Is the header damaged?"
            )
        axes = _radiance_axes(path) if reader.format_name() == "hdr" else ("-Y", "+X")
        height, width = (width, height) if axes[0].endswith("X") else (height, width)
        return Header(path, height, width, chosen, axes, _chromaticities(path, spec))


def read_pixels(header: Header) -> np.ndarray:
    """Decode the image: upright, display window only, 0 outside the data window.

    Returns:
        Values in the file's primaries, whatever the file stores.  [H, W, 3] float32

    Raises:
        InputError: The pixels are damaged, incomplete, or outside the display window.
    """
    with _opened(header.path) as reader:
        spec = reader.spec(header.layer.part, 0)
        values = _channels(reader, spec, header)  # [h, w, 3]
        return _upright(_in_display_window(header.path, spec, values), header.axes)


@contextmanager
def _opened(path: Path) -> Iterator[OpenImageIO.ImageInput]:
    """Open a file for decoding; whatever goes wrong inside becomes an InputError."""
    kind = _kind(path)
    try:
        reader = OpenImageIO.ImageInput.open(str(path))
        if reader is None:
            raise _unreadable(path, _finding(OpenImageIO))
        if reader.format_name() != kind:
            raise _unreadable(path, f"its {kind} header is damaged")
        try:
            yield reader
        finally:
            # An error nobody fetched is printed by the library when the program ends.
            _finding(reader)
            reader.close()
    except UnicodeError as error:
        raise _unreadable(path, "a name in it is not text") from error
    except OSError as error:
        raise _unreadable(path, error.strerror or "it vanished") from error
    except MemoryError as error:
        raise InputError(
            f"{shown(path)}: does not fit in memory; expected a smaller image. Reduce it first."
        ) from error


def _kind(path: Path) -> str:
    """Return the format that the first bytes of a file say it has."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            found = "a folder" if path.is_dir() else "not a regular file"
            raise InputError(f"{shown(path)}: is {found}; expected an image file (.exr or .hdr).")
        with path.open("rb") as stream:
            start = stream.read(16)
    except OSError as error:
        raise InputError(
            f"{shown(path)}: cannot be opened ({error.strerror}); expected an image file. "
            "Check the path and the permissions."
        ) from error
    for magic, kind in _KINDS.items():
        if start.startswith(magic):
            return kind
    found = next((name for magic, name in _OTHERS.items() if start.startswith(magic)), None)
    if found is None:
        is_text = bool(start) and all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in start)
        found = "text" if is_text else "of an unknown kind" if start else "empty"
    raise InputError(
        f"{shown(path)}: is {found}; expected an OpenEXR or Radiance .hdr image. "
        "Was it renamed or its copy interrupted?"
    )


def _unreadable(path: Path, finding: str) -> InputError:
    if "Subsampled channels" in finding:
        return InputError(
            f"{shown(path)}: has subsampled channels, as luminance-chroma (Y, RY, BY) files do; "
            "expected R, G, B at full resolution. Save it as R, G, B."
        )
    return InputError(
        f"{shown(path)}: cannot be decoded ({finding}); expected a complete image. "
        "Was its copy or its rendering interrupted?"
    )


def _finding(source: object) -> str:
    """Fetch, and thereby clear, the error that OpenImageIO keeps for a reader or for itself."""
    try:
        return compressed(source.geterror())  # pyright: ignore[reportAttributeAccessIssue]
    except UnicodeDecodeError:
        return "its header is damaged"


def _channels(
    reader: OpenImageIO.ImageInput, spec: OpenImageIO.ImageSpec, header: Header
) -> np.ndarray:
    """Read the layer's channels, all at once where they lie side by side."""
    part, (red, green, blue) = header.layer.part, header.layer.channels
    integer = [
        spec.channelformat(channel).basetype == OpenImageIO.UINT32 for channel in (red, green, blue)
    ]
    if (green, blue) == (red + 1, red + 2) and not any(integer):
        spans = [(red, red + 3)]
    elif header.layer.is_colour:
        spans = [(channel, channel + 1) for channel in (red, green, blue)]
    else:
        spans = [(red, red + 1)]
    planes = []
    for (begin, end), is_integer in zip(spans, integer, strict=False):
        # Asked for float, the library would scale integers to 0..1; their value is meant.
        stored = OpenImageIO.UINT32 if is_integer else OpenImageIO.FLOAT
        plane = reader.read_image(part, 0, begin, end, stored)
        if plane is None:
            raise _unreadable(header.path, _finding(reader))
        planes.append(plane.reshape(spec.height, spec.width, end - begin).astype(np.float32))
    values = planes[0] if len(planes) == 1 else np.concatenate(planes, axis=-1)
    return values if values.shape[-1] == 3 else values.repeat(3, axis=-1)


def _in_display_window(path: Path, spec: OpenImageIO.ImageSpec, values: np.ndarray) -> np.ndarray:
    """Place the data window in the display window, cropping and filling with 0."""
    top, left = spec.y - spec.full_y, spec.x - spec.full_x
    height, width = spec.full_height, spec.full_width
    if (top, left) == (0, 0) and values.shape[:2] == (height, width):
        return values
    rows = slice(max(top, 0), min(top + spec.height, height))
    columns = slice(max(left, 0), min(left + spec.width, width))
    if rows.start >= rows.stop or columns.start >= columns.stop:
        raise InputError(
            f"{shown(path)}: its data window lies outside its display window; expected them to "
            "overlap. Was it cropped by mistake?"
        )
    canvas = np.zeros((height, width, 3), dtype=np.float32)
    canvas[rows, columns] = values[
        rows.start - top : rows.stop - top, columns.start - left : columns.stop - left
    ]
    return canvas


def _upright(values: np.ndarray, axes: tuple[str, str]) -> np.ndarray:
    """Turn stored pixels so that row 0 is the top and column 0 the left."""
    turned = values.swapaxes(0, 1) if axes[0].endswith("X") else values
    turned = turned[::-1] if "+Y" in axes else turned
    return np.ascontiguousarray(turned[:, ::-1] if "-X" in axes else turned)


def _radiance_axes(path: Path) -> tuple[str, str]:
    """Return the two axes of a Radiance file's size line, such as `-Y 4 +X 8`.

    OpenImageIO states them as an Exif orientation, in which it exchanges codes 6 and 8.
    """
    with path.open("rb") as stream:
        match = re.search(rb"\n\r?\n([+-][XY]) +\d+ +([+-][XY]) +\d", stream.read(HEADER_MAX))
    return (match[1].decode(), match[2].decode()) if match else ("-Y", "+X")


def _text(spec: OpenImageIO.ImageSpec, name: str) -> str:
    return spec.get_string_attribute(name, "")


def _chromaticities(path: Path, spec: OpenImageIO.ImageSpec) -> Chromaticities | None:
    """Return the primaries the file states, if they are not Rec.709."""
    stated = spec.getattribute("chromaticities")
    if stated is None:
        interop = colour.INTEROP.get(_text(spec, "colorInteropID"), "Rec.709")
        return None if interop == "Rec.709" else colour.KNOWN[interop]
    red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = (float(v) for v in stated)
    numbers = (red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y)
    if not colour.is_colour_space(numbers):
        raise InputError(
            f"{shown(path)}: states chromaticities {' '.join(f'{v:.4g}' for v in numbers)}; "
            "expected three primaries and a white that span colours. Correct or remove them."
        )
    return None if colour.name_of(numbers) == "Rec.709" else numbers
