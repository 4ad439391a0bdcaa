# SPDX-License-Identifier: Apache-2.0
"""A latlong image: read, checked, repaired, converted to Rec.709, reduced."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images.decoding.decoders import HERE, Decoder
from asglight.images.decoding.header import Header
from asglight.images.loss import check_loss
from asglight.images.message import shown
from asglight.images.options import ReadOptions
from asglight.images.repair import Repair

# What an image of some other width : height usually is.
_SHAPES = {
    (
        1,
        1,
    ): "an angular map, a mirror ball or one face of a cube, or stereo, one eye over the other",
    (4, 3): "a cube cross",
    (3, 4): "a cube cross",
    (6, 1): "a strip of cube faces",
    (1, 6): "a strip of cube faces",
    (1, 2): "a latlong turned by 90 degrees",
    (16, 9): "a camera plate",
    (3, 2): "a photograph",
    (4, 1): "stereo, one eye beside the other, or only half of the sphere",
}


@dataclass(frozen=True)
class LatlongImage:
    """Radiance over the sphere, and where it comes from.

    Attributes:
        radiance: Linear Rec.709, finite and >= 0, row 0 = +Y.  [H, W, 3] float32
        header: What the file says of it, and what was made of that.
        source_shape: Rows and columns in the file, before any reduction.
        repair: What was changed before use.
    """

    radiance: Tensor
    header: Header
    source_shape: tuple[int, int]
    repair: Repair

    @property
    def path(self) -> Path:
        """Return the file it was read from."""
        return self.header.path


def read_latlong(
    path: str | Path,
    *,
    height: int | None = None,
    reading: ReadOptions = ReadOptions(),  # noqa: B008  frozen, so one default serves all calls
    decoder: Decoder = HERE,
) -> LatlongImage:
    """Read an image file of any resolution as radiance.

    What is no light is repaired first, at full resolution; then the image is averaged down by solid
    angle. A smaller image is never enlarged. Colours are converted to linear Rec.709 from what the
    file states or the user says.

    Args:
        path: The file: OpenEXR, Radiance, TIFF or PFM of floats; others with a space of colours.
        height: Rows of the result, of 2 * height columns; None keeps the file's.
        reading: Which of its images is read, in which colours, and how much of it may be lost.
        decoder: Where the file is decoded: in this process, or apart from it.

    Raises:
        DamagedError: The file cannot be decoded, or lost too much of its light.
        InputError: It is not a 2:1 image, or states what cannot be followed.
    """
    check_height(height)
    reading.check()
    header = read_header(Path(path), reading, decoder)
    size = (header.height, header.width)
    rows = header.height if height is None else min(height, header.height)
    values, tally = decoder.pixels(header, rows)
    account = tally.account(values)
    check_loss(
        header.path,
        account,
        header.height * header.width,
        reading.repair,
        is_converted=not header.colour.is_rec709,
    )
    return LatlongImage(
        radiance=torch.from_numpy(values),
        header=header,
        source_shape=size,
        repair=account,
    )


def read_header(
    path: Path,
    reading: ReadOptions = ReadOptions(),  # noqa: B008
    decoder: Decoder = HERE,
) -> Header:
    """Read the header of a file and make sure that it is a latlong.

    Raises:
        InputError: The file cannot be read, or is not a 2:1 image.
    """
    header = decoder.header(path, reading)
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
            way = "Convert it to latlong first"
            if "stereo" in name:
                way += ", or, if it is stereo, take one eye with --eye left or --eye right"
            return f"It is {across}:{down}: probably {name}. {way}."
    # Within 2 % it is a latlong that lost or gained a few rows or columns.
    if abs(width / (2 * height) - 1) <= 0.02:
        return "It is almost 2:1: probably a latlong that was cropped or padded. Resize it."
    return "Is it a camera plate or a crop? Stitch or convert it to latlong first."
