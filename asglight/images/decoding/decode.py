# SPDX-License-Identifier: Apache-2.0
"""Decoding OpenEXR, Radiance and other files, through OpenImageIO, with every fault in one line.

OpenImageIO decodes each OpenEXR compression, stops with a reason at missing or damaged chunks
instead of leaving zeros, and leaves standard output alone, except for notes of its HTJ2K decoder
on damaged files. The header is read apart from the pixels, so that an image of the wrong shape or
of an incredible size is refused before anything is decoded (strips.py).

The OpenEXR that decodes is the one inside OpenImageIO, or, in a process of its own and twice as
fast, the package OpenEXR (exr_chunks.py), which also reads subsampled channels
(luminance_chroma.py). What a file states of its colours is stated.py.
"""

import functools
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import OpenImageIO

from asglight.errors import InputError
from asglight.images.decoding import facts, layers, luminance_chroma, radiance, stated
from asglight.images.decoding.header import DamagedError, Header, unreadable
from asglight.images.message import compressed, shown
from asglight.images.options import ReadOptions

# 32768 x 16384 is four times the largest map in circulation, and 6.4 GB as float32.
SIZE_MAX = 32768
# The largest map in circulation, 16384 x 8192. What declares more texels has to be as large a file:
# a photograph takes a byte for every few texels, and a chunk of zeros of any size a few bytes.
TEXELS_TRUSTED = 16384 * 8192
TEXELS_A_BYTE_MAX = 1000
# Before it, damaged files could write beyond the decoder's memory (CVE-2026-40250 and others).
OPENEXR_MIN = (3, 4, 10)
_KINDS = {
    b"\x76\x2f\x31\x01": "openexr",
    radiance.MAGIC: "hdr",
    b"PF\n": "pnm",
    b"II*\0": "tiff",
    b"MM\0*": "tiff",
    b"II+\0": "tiff",
    b"MM\0+": "tiff",
    b"\x89PNG": "png",
    b"\xff\xd8\xff": "jpeg",
    b"RIFF": "webp",
}
_OTHERS = {
    b"SDPX": "a DPX image",
    b"XPDS": "a DPX image",
    b"GIF8": "a GIF image",
    b"BM": "a BMP image",
    b"8BPS": "a Photoshop image",
    b"\xff\x0a": "a JPEG XL image",
    b"\0\0\0\x0cJXL ": "a JPEG XL image",
    b"\x1f\x8b": "a gzip archive",
    b"PK\x03\x04": "a zip archive",
    b"#usda": "a USD stage",
    b"PXR-USDC": "a USD stage",
}


def read_header(path: Path, reading: ReadOptions = ReadOptions()) -> Header:  # noqa: B008  frozen
    """Read what a file says of its image.

    Args:
        path: An image file, known by its content and not by its name.
        reading: What the user says of it.

    Raises:
        InputError: The file cannot be read, or holds no image of the kind asked for.
    """
    check_decoder()
    with opened(path) as reader:
        specs, kind = [], reader.format_name()
        while kind == "openexr" and reader.seek_subimage(len(specs), 0):
            specs.append(reader.spec())
        specs = specs or [reader.spec()]
        parts = [facts.part_of(spec, is_only=len(specs) == 1) for spec in specs]
        chosen = layers.choose(path, parts, reading.layer, reading.eye)
        spec = specs[chosen.part]
        check_size(path, max(spec.width, spec.full_width), max(spec.height, spec.full_height))
        lines = radiance.read_lines(path) if kind == "hdr" else radiance.RadianceHeader()
        axes = lines.axes if kind == "hdr" else facts.axes_of(spec, kind)
        size = (spec.full_width, spec.full_height)
        width, height = size[::-1] if axes[0].endswith("X") else size
        corner, (width, height), half = facts.half_of(path, chosen, (width, height), reading.eye)
        space = facts.colour_of(path, specs, lines, chosen, kind, reading)
        notes, warnings = facts.told(spec, lines, chosen, half, reading)
        return Header(
            path,
            kind,
            height,
            width,
            corner,
            chosen,
            axes,
            space,
            stated.luminance_of(specs, chosen, space),
            1.0 if reading.colorspace else lines.gamma,
            lines.multiplier,
            stated.white_luminance(spec),
            chosen.eye or half,
            notes,
            (*warnings, *facts.warnings_of_range(spec, kind, reading)),
            4 * spec.width * spec.height * spec.nchannels,
        )


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
        with _readable(path, kind) as place:
            reader = OpenImageIO.ImageInput.open(str(place))
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


def finding(source: object) -> str:
    """Fetch, and thereby clear, the error that OpenImageIO keeps for a reader or for itself."""
    try:
        return compressed(source.geterror())  # pyright: ignore[reportAttributeAccessIssue]
    except UnicodeDecodeError:
        return "its header is damaged"


def check_size(path: Path, width: int, height: int) -> None:
    """Refuse an image that the header makes larger than a map or than its file can be."""
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


@contextmanager
def _readable(path: Path, kind: str) -> Iterator[Path]:
    """Give what OpenImageIO decodes: the file, or a copy without what it does not know."""
    if kind == "hdr":
        check_size(path, *radiance.read_lines(path).size)
        with radiance.readable(path) as place:
            yield place
    elif kind == "openexr" and luminance_chroma.is_subsampled(path):
        with luminance_chroma.readable(path) as place:
            yield place
    else:
        yield path
