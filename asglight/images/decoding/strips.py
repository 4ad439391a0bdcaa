# SPDX-License-Identifier: Apache-2.0
"""Decoding the pixels of an image in strips of whole rows: it need not fit in memory."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO

from asglight.errors import InputError
from asglight.images.decoding.decode import Header, finding, opened, unreadable
from asglight.images.message import shown

# A strip is decoded at once. 256 rows are the largest chunk of OpenEXR (DWAB), so no chunk that
# begins where a strip begins is decoded twice; at 32768 columns they take 100 MB.
STRIP_ROWS = 256


def read_strips(header: Header) -> Iterator[np.ndarray]:
    """Decode the image from top to bottom: upright, display window only, 0 outside the data window.

    Yields:
        STRIP_ROWS rows, the last time fewer: values in the file's primaries, whatever the file
        stores.  [rows, W, 3] float32

    Raises:
        DamagedError: The pixels are damaged or incomplete.
        InputError: They lie outside the display window, or do not fit in memory.
    """
    starts = range(0, header.height, STRIP_ROWS)
    with opened(header.path) as reader:
        spec = reader.spec(header.layer.part, 0)
        if header.axes == ("-Y", "+X"):
            columns = _columns_shown(header.path, spec)
            for top in starts:
                bottom = min(top + STRIP_ROWS, header.height)
                yield _strip(reader, spec, header, top, bottom, columns)
        else:  # an old Radiance file of which any row may hold the top: turned as a whole
            stored = _rows(reader, spec, header, spec.y, spec.y + spec.height)
            upright = _upright(stored, header.axes)
            yield from (upright[top : top + STRIP_ROWS] for top in starts)


def read_pixels(header: Header) -> np.ndarray:
    """Decode the whole image, as `read_strips`.  [H, W, 3] float32."""
    return np.concatenate([*read_strips(header)])


def _rows(
    reader: OpenImageIO.ImageInput,
    spec: OpenImageIO.ImageSpec,
    header: Header,
    begin: int,
    end: int,
) -> np.ndarray:
    """Decode the layer in some rows of the data window, all channels at once where they adjoin.

    Args:
        reader: The open file.
        spec: Of the layer's part.
        header: Says which channels.
        begin: First row, counted as the file does.
        end: Row after the last.

    Returns:
        [end - begin, w, 3] float32
    """
    red, green, blue = header.layer.channels
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
    for span, is_integer in zip(spans, integer, strict=False):
        # Asked for float, the library would scale integers to 0..1; their value is meant.
        stored = OpenImageIO.UINT32 if is_integer else OpenImageIO.FLOAT
        plane = _decoded(reader, spec, header.layer.part, (begin, end), span, stored)
        if plane is None:
            raise unreadable(header.path, finding(reader))
        shaped = plane.reshape(end - begin, spec.width, span[1] - span[0])
        planes.append(shaped.astype(np.float32, copy=False))
    values = planes[0] if len(planes) == 1 else np.concatenate(planes, axis=-1)
    return values if values.shape[-1] == 3 else values.repeat(3, axis=-1)


def _decoded(
    reader: OpenImageIO.ImageInput,
    spec: OpenImageIO.ImageSpec,
    part: int,
    rows: tuple[int, int],
    channels: tuple[int, int],
    stored: OpenImageIO.BASETYPE,
) -> np.ndarray | None:
    """Decode rows and channels, each from the first to before the last; None where it fails."""
    begin, end = rows
    if not spec.tile_width:
        return reader.read_scanlines(part, 0, begin, end, spec.z, *channels, stored)
    # Tiles are decoded whole: from the one that holds the first row to the one with the last.
    first = spec.y + (begin - spec.y) // spec.tile_height * spec.tile_height
    last = spec.y - (spec.y - end) // spec.tile_height * spec.tile_height
    last = min(last, spec.y + spec.height)
    across, deep = (spec.x, spec.x + spec.width), (spec.z, spec.z + 1)
    tiles = reader.read_tiles(part, 0, *across, first, last, *deep, *channels, stored)
    return None if tiles is None else tiles[begin - first : end - first]


def _columns_shown(path: Path, spec: OpenImageIO.ImageSpec) -> tuple[slice, slice]:
    """Return the columns of the display window that hold data, and those columns of the data.

    Raises:
        InputError: The two windows have nothing in common.
    """
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    columns = slice(max(left, 0), min(left + spec.width, spec.full_width))
    overlap = min(top + spec.height, spec.full_height) - max(top, 0)
    if columns.start >= columns.stop or overlap <= 0:
        raise InputError(
            f"{shown(path)}: its data window lies outside its display window; expected them to "
            "overlap. Was it cropped by mistake?"
        )
    return columns, slice(columns.start - left, columns.stop - left)


def _strip(
    reader: OpenImageIO.ImageInput,
    spec: OpenImageIO.ImageSpec,
    header: Header,
    top: int,
    bottom: int,
    columns: tuple[slice, slice],
) -> np.ndarray:
    """Decode some rows of the display window, cropping the data window and filling with 0."""
    first = max(top + spec.full_y, spec.y)
    last = min(bottom + spec.full_y, spec.y + spec.height)
    shape = (bottom - top, spec.full_width, 3)
    if first >= last:
        return np.zeros(shape, dtype=np.float32)
    values = _rows(reader, spec, header, first, last)
    if values.shape == shape and columns[0] == columns[1]:
        return values
    canvas = np.zeros(shape, dtype=np.float32)
    rows = slice(first - spec.full_y - top, last - spec.full_y - top)
    canvas[rows, columns[0]] = values[:, columns[1]]
    return canvas


def _upright(values: np.ndarray, axes: tuple[str, str]) -> np.ndarray:
    """Turn stored pixels so that row 0 is the top and column 0 the left."""
    turned = values.swapaxes(0, 1) if axes[0].endswith("X") else values
    turned = turned[::-1] if "+Y" in axes else turned
    return np.ascontiguousarray(turned[:, ::-1] if "-X" in axes else turned)
