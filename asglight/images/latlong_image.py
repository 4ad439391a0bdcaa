# SPDX-License-Identifier: Apache-2.0
"""A latlong image: read, checked, repaired, converted to Rec.709, reduced."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images import colour, ocio
from asglight.images.decoding import decode
from asglight.images.decoding.decoders import HERE, Decoder
from asglight.images.message import shown
from asglight.images.repair import Repair

# What an image of some other width : height usually is.
_SHAPES = {
    (1, 1): "an angular map, a mirror ball or one face of a cube",
    (4, 3): "a cube cross",
    (3, 4): "a cube cross",
    (6, 1): "a strip of cube faces",
    (1, 6): "a strip of cube faces",
    (1, 2): "a latlong turned by 90 degrees",
    (16, 9): "a camera plate",
    (3, 2): "a photograph",
    (4, 1): "only half of the sphere",
}


@dataclass(frozen=True)
class LatlongImage:
    """Radiance over the sphere, and where it comes from.

    Attributes:
        radiance: Linear Rec.709, finite and >= 0, row 0 = +Y.  [H, W, 3] float32
        path: The file it was read from.
        source_shape: Rows and columns in the file, before any reduction.
        repair: What was changed before use.
        converted_from: Name of the file's primaries where they were not Rec.709.
    """

    radiance: Tensor
    path: Path
    source_shape: tuple[int, int]
    repair: Repair
    converted_from: str | None = None


def read_latlong(
    path: str | Path,
    *,
    height: int | None = None,
    layer: str | None = None,
    colorspace: str | None = None,
    decoder: Decoder = HERE,
) -> LatlongImage:
    """Read an OpenEXR or Radiance .hdr file of any resolution as radiance.

    Negative and non-finite values become 0 first, at full resolution; then the image is averaged
    down by solid angle. A smaller image is never enlarged. Primaries stated by an OpenEXR file are
    converted to Rec.709; the EXPOSURE and PRIMARIES lines of a Radiance file are not applied.

    Args:
        path: The file.
        height: Rows of the result, of 2 * height columns; None keeps the file's.
        layer: Layer or part of an OpenEXR file; None takes the plain R, G, B, else the only layer.
        colorspace: Linear space of the file's colours, by a name that OpenColorIO knows, whatever
            the file states; None for what it states, or Rec.709.
        decoder: Where the file is decoded: in this process, or apart from it.

    Raises:
        InputError: The file cannot be read, or is not a 2:1 image; or there is no such space.
    """
    check_height(height)
    header = read_header(Path(path), layer, decoder)
    source = header.chromaticities if colorspace is None else _chromaticities(colorspace)
    matrix = None if source is None else colour.to_rec709(source)
    size = (header.height, header.width)
    rows = header.height if height is None else min(height, header.height)
    values, tally = decoder.pixels(header, rows, matrix)
    return LatlongImage(
        radiance=torch.from_numpy(values),
        path=header.path,
        source_shape=size,
        repair=tally.account(values),
        converted_from=None if source is None else colour.name_of(source),
    )


def check_colorspace(colorspace: str | None) -> None:
    """Refuse a space that is not linear, or that nobody knows."""
    if colorspace is not None:
        _chromaticities(colorspace)


def _chromaticities(colorspace: str) -> colour.Chromaticities | None:
    return ocio.chromaticities(ocio.interop_id(colorspace, "input colorspace"))


def read_header(path: Path, layer: str | None = None, decoder: Decoder = HERE) -> decode.Header:
    """Read the header of a file and make sure that it is a latlong.

    Raises:
        InputError: The file cannot be read, or is not a 2:1 image.
    """
    header = decoder.header(path, layer)
    if header.width != 2 * header.height:
        raise InputError(
            f"{shown(path)}: is {header.width} x {header.height}; expected a 2:1 latlong. "
            f"{_guess(header.width, header.height)}"
        )
    return header


def check_height(height: int | None) -> None:
    """Refuse a number of rows below 1."""
    if height is not None and height < 1:
        raise InputError(f"height: {height} rows; expected 1 or more. Leave it out to keep all.")


def _guess(width: int, height: int) -> str:
    """Say what an image that is not 2:1 probably is."""
    for (across, down), name in _SHAPES.items():
        # 1 %: cameras and encoders pad to multiples of 16 (1088 rows for 1080).
        if abs(width * down / (height * across) - 1) <= 0.01:
            return f"It is {across}:{down}: probably {name}. Convert it to latlong first."
    # Within 2 % it is a latlong that lost or gained a few rows or columns.
    if abs(width / (2 * height) - 1) <= 0.02:
        return "It is almost 2:1: probably a latlong that was cropped or padded. Resize it."
    return "Is it a camera plate or a crop? Stitch or convert it to latlong first."
