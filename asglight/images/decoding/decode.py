# SPDX-License-Identifier: Apache-2.0
"""Decoding OpenEXR and Radiance files, through OpenImageIO, with every fault in one line.

OpenImageIO decodes each OpenEXR compression, stops with a reason at missing or damaged chunks
instead of leaving zeros, and leaves standard output alone, except for notes of its HTJ2K decoder
on damaged files. The header is read apart from the pixels, so that an image of the wrong shape or
of an incredible size is refused before anything is decoded (strips.py).

The OpenEXR that decodes is the one inside OpenImageIO, or, in a process of its own and twice as
fast, the package OpenEXR (exr_chunks.py).

Radiance files are taken as Rec.709 and as they are stored: OpenImageIO does not divide by the
EXPOSURE line, nor do most programs, and asglight's radiance is relative. The orientation line is
followed.
"""

import functools
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import OpenImageIO

from asglight.errors import InputError
from asglight.images import colour
from asglight.images.colour import Chromaticities
from asglight.images.decoding import layers
from asglight.images.message import compressed, shown

# 32768 x 16384 is four times the largest map in circulation, and 6.4 GB as float32.
SIZE_MAX = 32768
# The largest map in circulation, 16384 x 8192. What declares more texels has to be as large a file:
# a photograph takes a byte for every few texels, and a chunk of zeros of any size a few bytes.
TEXELS_TRUSTED = 16384 * 8192
TEXELS_A_BYTE_MAX = 1000
# Before it, damaged files could write beyond the decoder's memory (CVE-2026-40250 and others).
OPENEXR_MIN = (3, 4, 10)
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


class DamagedError(InputError):
    """A file that cannot be decoded: cut off, damaged, of no known kind, or gone.

    Attributes:
        finding: What is wrong with it, as a clause.
        frame: The frame that it is, where it is one of a sequence.
    """

    def __init__(self, path: Path, finding: str, hint: str) -> None:
        """Make the message of the path, the finding, and what was expected with what to do."""
        super().__init__(f"{shown(path)}: {finding}; {hint}")
        self.finding = finding
        self.frame: int | None = None


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
        stored_bytes: Size of the pixels with all channels of the part, as float32.
    """

    path: Path
    height: int
    width: int
    layer: layers.Layer
    axes: tuple[str, str]
    chromaticities: Chromaticities | None
    stored_bytes: int


def read_header(path: Path, layer: str | None = None) -> Header:
    """Read what a file says of its image.

    Args:
        path: An OpenEXR or Radiance file, known by its content and not by its name.
        layer: Layer or part to read; None for the plain image.

    Raises:
        InputError: The file cannot be read, or holds no image of the kind asked for.
    """
    check_decoder()
    with opened(path) as reader:
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
        _check_size(path, spec)
        height, width = spec.full_height, spec.full_width
        axes = _radiance_axes(path) if reader.format_name() == "hdr" else ("-Y", "+X")
        height, width = (width, height) if axes[0].endswith("X") else (height, width)
        stored = 4 * spec.width * spec.height * spec.nchannels
        return Header(path, height, width, chosen, axes, _chromaticities(path, spec), stored)


@functools.cache
def check_decoder() -> None:
    """Refuse to decode with an OpenEXR that a damaged file can take over.

    Raises:
        InputError: OpenImageIO was built with one.
    """
    libraries = OpenImageIO.get_string_attribute("library_list")
    found = re.search(r"OpenEXR (\d+)\.(\d+)\.(\d+)", libraries)
    if found is None or tuple(map(int, found.groups())) < OPENEXR_MIN:
        version = found[0] if found else "no OpenEXR"
        raise InputError(
            f"OpenImageIO {OpenImageIO.__version__} holds {version}; expected OpenEXR "
            f"{'.'.join(map(str, OPENEXR_MIN))} or later, because damaged files can take over "
            "earlier ones. Update it: pip install --upgrade OpenImageIO."
        )


@contextmanager
def opened(path: Path) -> Iterator[OpenImageIO.ImageInput]:
    """Open a file for decoding; whatever goes wrong inside becomes an InputError."""
    kind = _kind(path)
    try:
        reader = OpenImageIO.ImageInput.open(str(path))
        if reader is None:
            raise unreadable(path, finding(OpenImageIO))
        if reader.format_name() != kind:
            raise unreadable(path, f"its {kind} header is damaged")
        try:
            yield reader
        finally:
            # An error nobody fetched is printed by the library when the program ends.
            finding(reader)
            reader.close()
    except UnicodeError as error:
        raise unreadable(path, "a name in it is not text") from error
    except OSError as error:
        raise unreadable(path, error.strerror or "it vanished") from error
    except MemoryError as error:
        raise DamagedError(
            path, "does not fit in memory", "expected a smaller image. Reduce it first."
        ) from error


def _kind(path: Path) -> str:
    """Return the format that the first bytes of a file say it has."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            found = "a folder" if path.is_dir() else "not a regular file"
            raise DamagedError(path, f"is {found}", "expected an image file (.exr or .hdr).")
        with path.open("rb") as stream:
            start = stream.read(16)
    except OSError as error:
        raise DamagedError(
            path,
            f"cannot be opened ({error.strerror})",
            "expected an image file. Check the path and the permissions.",
        ) from error
    for magic, kind in _KINDS.items():
        if start.startswith(magic):
            return kind
    found = next((name for magic, name in _OTHERS.items() if start.startswith(magic)), None)
    if found is None:
        is_text = bool(start) and all(byte in b"\t\n\r" or 32 <= byte < 127 for byte in start)
        found = "text" if is_text else "of an unknown kind" if start else "empty"
    raise DamagedError(
        path,
        f"is {found}",
        "expected an OpenEXR or Radiance .hdr image. Was it renamed or its copy interrupted?",
    )


def unreadable(path: Path, said: str) -> InputError:
    """Return the error of a file whose decoder says why it fails."""
    if "Subsampled channels" in said:
        return InputError(
            f"{shown(path)}: has subsampled channels, as luminance-chroma (Y, RY, BY) files do; "
            "expected R, G, B at full resolution. Save it as R, G, B."
        )
    return DamagedError(
        path,
        f"cannot be decoded ({said})",
        "expected a complete image. Was its copy or its rendering interrupted?",
    )


def finding(source: object) -> str:
    """Fetch, and thereby clear, the error that OpenImageIO keeps for a reader or for itself."""
    try:
        return compressed(source.geterror())  # pyright: ignore[reportAttributeAccessIssue]
    except UnicodeDecodeError:
        return "its header is damaged"


def _check_size(path: Path, spec: OpenImageIO.ImageSpec) -> None:
    """Refuse an image that the header makes larger than a map or than its file can be."""
    width, height = max(spec.width, spec.full_width), max(spec.height, spec.full_height)
    if max(height, width) > SIZE_MAX:
        raise InputError(
            f"{shown(path)}: declares {width} x {height} texels; expected at most {SIZE_MAX} a "
            "side. Is the header damaged?"
        )
    size = path.stat().st_size
    if height * width > max(TEXELS_TRUSTED, size * TEXELS_A_BYTE_MAX):
        raise InputError(
            f"{shown(path)}: declares {width} x {height} texels in {size} bytes; expected a file "
            f"of at least {height * width // TEXELS_A_BYTE_MAX} bytes. Is the header damaged?"
        )


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
