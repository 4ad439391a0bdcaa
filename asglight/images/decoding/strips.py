# SPDX-License-Identifier: Apache-2.0
"""Decoding the pixels of an image in strips of whole rows: it need not fit in memory.

There are two decoders. OpenImageIO reads whatever asglight reads, and says what is wrong with what
cannot be read. The package OpenEXR is twice as fast (exr_chunks.py), but prints what it meets in
damaged files: it is used where nobody sees that, in a process of its own (decoding_process.py).
Tests hold one against the other.
"""

import contextlib
from collections.abc import Generator, Iterator
from dataclasses import replace

import numpy as np
import OpenImageIO

from asglight.errors import InputError
from asglight.images.decoding.decode import finding, opened
from asglight.images.decoding.exr_chunks import ExrChunks, Unusual
from asglight.images.decoding.header import Header, unreadable
from asglight.images.decoding.reduction import Reduction
from asglight.images.infinite import Infinities, Planes
from asglight.images.linear import linearisation_of
from asglight.images.message import shown
from asglight.images.repair import Tally

# OpenImageIO decodes a strip at once. 256 rows are the largest chunk of OpenEXR (DWAB), so no chunk
# is decoded twice; at 32768 columns they take 100 MB.
STRIP_ROWS = 256


def reduced_strips(
    header: Header,
    height: int,
    *,
    is_quiet: bool = False,
) -> Generator[np.ndarray, None, Tally]:
    """Decode, make linear, repair and average the image from top to bottom, as `Reduction`.

    Args:
        header: The image.
        height: Rows of the result.
        is_quiet: Nobody sees what libraries print.

    Yields:
        Some rows of the result.  [rows, w, 3] float32

    Returns:
        What was repaired.

    Raises:
        DamagedError: The pixels are damaged or incomplete.
        InputError: They lie outside the display window, or do not fit in memory.
    """
    linear = linearisation_of(header)
    infinities = Infinities(linear.brightest)
    reduction = Reduction((header.height, header.width), height, linear.matrix)
    for planes in infinities.kept(read_strips(header, is_quiet=is_quiet)):
        if linear.curve is not None:
            planes = _planes(linear.bent(np.stack(planes, axis=-1).astype(np.float32)))
        rows = reduction.add(planes)
        if len(rows):
            yield rows
    return replace(reduction.tally, infinite=infinities.count)


def read_pixels(header: Header) -> np.ndarray:
    """Decode the whole image, as `read_strips`.  [H, W, 3] float32."""
    strips = [np.stack(planes, axis=-1).astype(np.float32) for planes in read_strips(header)]
    return np.concatenate(strips)


def read_strips(header: Header, *, is_quiet: bool = False) -> Iterator[Planes]:
    """Decode the image from top to bottom: upright, display window only, 0 outside the data window.

    Args:
        header: The image.
        is_quiet: Nobody sees what libraries print.

    Yields:
        Some rows: values in the file's primaries, whatever the file stores.  [rows, W]

    Raises:
        DamagedError: The pixels are damaged or incomplete.
        InputError: They lie outside the display window, or do not fit in memory.
    """
    with opened(header.path) as reader:
        spec = reader.spec(header.layer.part, 0)
        windows = _upright_windows(spec, header.axes)
        columns = _columns_shown(header, windows)
        if header.axes == ("-Y", "+X"):
            with contextlib.ExitStack() as stack:
                chunks = _chunks(reader, spec, header) if is_quiet else None
                if chunks is not None:
                    stack.callback(chunks.close)
                yield from _displayed(_decoded(reader, spec, header, chunks), spec, header, columns)
        else:  # any stored row may hold the top: the data window is turned as a whole
            rows = _rows(reader, spec, header, spec.y, spec.y + spec.height)
            turned = _upright_planes(rows, header.axes)
            strips = _strips(turned, windows, _rows_shown(header, windows))
            yield from _displayed(strips, windows, header, columns)


def _chunks(
    reader: OpenImageIO.ImageInput, spec: OpenImageIO.ImageSpec, header: Header
) -> ExrChunks | None:
    """Return what reads the file quickly; None where nothing does."""
    # A copy may be read in place of a file with subsampled chroma.
    if reader.format_name() != "openexr" or header.layer.kind == "luminance-chroma":
        return None
    red, green, blue = (spec.channelnames[channel] for channel in header.layer.channels)
    try:
        chunks = ExrChunks(header.path, header.layer.part, (red, green, blue))
    except (Unusual, OSError):
        return None
    window = (spec.x, spec.y, spec.x + spec.width - 1, spec.y + spec.height - 1)
    if chunks.window != window:
        chunks.close()
        return None
    return chunks


def _decoded(
    reader: OpenImageIO.ImageInput,
    spec: OpenImageIO.ImageSpec,
    header: Header,
    chunks: ExrChunks | None,
) -> Iterator[tuple[int, Planes]]:
    """Decode the data window from top to bottom.

    Yields:
        The first row, counted as the file does, and some rows from it on.  [rows, w]
    """
    low, high = _rows_shown(header, spec)
    end = spec.y + spec.height
    starts = range(spec.y, end, STRIP_ROWS)
    spans = [(top, min(top + STRIP_ROWS, end)) for top in starts]
    for begin, after in spans if chunks is None else chunks.spans():
        if after <= low or begin >= high:
            continue
        planes = None
        if chunks is not None:
            with contextlib.suppress(Unusual, OSError):
                planes = chunks.planes(begin, after)
        yield begin, planes or _rows(reader, spec, header, begin, after)


def _strips(
    planes: Planes, windows: OpenImageIO.ImageSpec, shown_rows: tuple[int, int]
) -> Iterator[tuple[int, Planes]]:
    """Yield those strips of an upright data window that have rows of the image, as `_decoded`.

    Args:
        planes: The data window.  [h, w]
        windows: As `_upright_windows`.
        shown_rows: As `_rows_shown`.
    """
    first = max(shown_rows[0], windows.y)
    end = min(shown_rows[1], windows.y + windows.height)
    for begin in range(first, end, STRIP_ROWS):
        rows = slice(begin - windows.y, min(begin + STRIP_ROWS, end) - windows.y)
        red, green, blue = (np.ascontiguousarray(plane[rows]) for plane in planes)
        yield begin, (red, green, blue)


def _displayed(
    decoded: Iterator[tuple[int, Planes]],
    spec: OpenImageIO.ImageSpec,
    header: Header,
    columns: tuple[slice, slice],
) -> Iterator[Planes]:
    """Crop strips of the data window to the image, and fill it with 0.

    Args:
        decoded: The strips that have rows of it, as `_decoded`.
        spec: Has the windows, upright.
        header: The image.
        columns: As `_columns_shown`.
    """
    low, high = _rows_shown(header, spec)
    row = low
    for begin, planes in decoded:
        yield from _black(begin - row, header.width)
        skipped = max(low - begin, 0)
        red, green, blue = (plane[skipped : high - begin] for plane in planes)
        row = begin + skipped + len(red)
        if columns[0] == columns[1] and red.shape[1] == header.width:
            yield red, green, blue
        else:
            yield _placed((red, green, blue), header.width, columns)
    yield from _black(high - row, header.width)


def _rows_shown(header: Header, spec: OpenImageIO.ImageSpec) -> tuple[int, int]:
    """Return the first row of the image and the one after the last, counted as the file does."""
    low = spec.full_y + header.corner[1]
    return low, low + header.height


def _black(rows: int, width: int) -> Iterator[Planes]:
    for top in range(0, rows, STRIP_ROWS):
        plane = np.zeros((min(STRIP_ROWS, rows - top), width), np.float32)
        yield plane, plane, plane


def _placed(planes: Planes, width: int, columns: tuple[slice, slice]) -> Planes:
    canvas = np.zeros((3, len(planes[0]), width), planes[0].dtype)
    for plane, place in zip(planes, canvas, strict=True):
        place[:, columns[0]] = plane[:, columns[1]]
    return _split(canvas)


def _planes(values: np.ndarray) -> Planes:
    """Split pixels into planes.  [rows, W, 3]."""
    return _split(np.ascontiguousarray(np.moveaxis(values, -1, 0)))


def _split(values: np.ndarray) -> Planes:
    red, green, blue = values
    return red, green, blue


def _rows(
    reader: OpenImageIO.ImageInput,
    spec: OpenImageIO.ImageSpec,
    header: Header,
    begin: int,
    end: int,
) -> Planes:
    """Let OpenImageIO decode the layer in some rows of the data window.

    All channels are decoded at once where they adjoin.

    Args:
        reader: The open file.
        spec: Of the layer's part.
        header: Says which channels.
        begin: First row, counted as the file does.
        end: Row after the last.

    Returns:
        Red, green and blue.  [end - begin, w] float32
    """
    red, green, blue = header.layer.channels
    integer = [
        header.kind == "openexr" and spec.channelformat(channel).basetype == OpenImageIO.UINT32
        for channel in (red, green, blue)
    ]
    if (green, blue) == (red + 1, red + 2) and not any(integer):
        spans = [(red, red + 3)]
    elif header.layer.is_colour:
        spans = [(channel, channel + 1) for channel in (red, green, blue)]
    else:
        spans = [(red, red + 1)]
    planes = []
    for span, is_integer in zip(spans, integer, strict=False):
        # Asked for float, the library scales integers to 0..1; in OpenEXR their value is meant.
        stored = OpenImageIO.UINT32 if is_integer else OpenImageIO.FLOAT
        found = _read(reader, spec, header.layer.part, (begin, end), span, stored)
        if found is None:
            raise unreadable(header.path, finding(reader))
        shaped = found.reshape(end - begin, spec.width, span[1] - span[0])
        planes += [*np.moveaxis(shaped.astype(np.float32, copy=False), -1, 0)]
    first, *others = map(np.ascontiguousarray, planes)
    return (first, others[0], others[1]) if others else (first, first, first)


def _read(
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


def _columns_shown(header: Header, spec: OpenImageIO.ImageSpec) -> tuple[slice, slice]:
    """Return the columns of the image that hold data, and those columns of the data.

    Raises:
        InputError: The two windows have nothing in common.
    """
    left = spec.x - spec.full_x - header.corner[0]
    top = spec.y - spec.full_y - header.corner[1]
    columns = slice(max(left, 0), min(left + spec.width, header.width))
    overlap = min(top + spec.height, header.height) - max(top, 0)
    if columns.start >= columns.stop or overlap <= 0:
        raise InputError(
            f"{shown(header.path)}: its data window lies outside its display window; expected "
            "them to overlap. Was it cropped by mistake?"
        )
    return columns, slice(columns.start - left, columns.stop - left)


def _upright_planes(planes: Planes, axes: tuple[str, str]) -> Planes:
    """Turn stored pixels so that row 0 is the top and column 0 the left, without a copy."""
    red, green, blue = (_upright(plane, axes) for plane in planes)
    return red, green, blue


def _upright(values: np.ndarray, axes: tuple[str, str]) -> np.ndarray:
    turned = values.swapaxes(0, 1) if axes[0].endswith("X") else values
    turned = turned[::-1] if "+Y" in axes else turned
    return turned[:, ::-1] if "-X" in axes else turned


def _upright_windows(spec: OpenImageIO.ImageSpec, axes: tuple[str, str]) -> OpenImageIO.ImageSpec:
    """Return the two windows as they lie when the image stands upright, and nothing else.

    Args:
        spec: Where they lie among the stored rows.
        axes: How those are stored.
    """
    if axes == ("-Y", "+X"):
        return spec
    left, top = spec.x - spec.full_x, spec.y - spec.full_y
    (width, height), full = (spec.width, spec.height), (spec.full_width, spec.full_height)
    if axes[0].endswith("X"):
        left, top, width, height, full = top, left, height, width, full[::-1]
    windows = OpenImageIO.ImageSpec(width, height, spec.nchannels, OpenImageIO.FLOAT)
    windows.full_width, windows.full_height = full
    windows.x = full[0] - left - width if "-X" in axes else left
    windows.y = full[1] - top - height if "+Y" in axes else top
    return windows
