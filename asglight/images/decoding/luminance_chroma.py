# SPDX-License-Identifier: Apache-2.0
"""Luminance and chroma of OpenEXR: Y, RY and BY, of which chroma may be subsampled, as R, G, B.

RY = (R - Y) / Y and BY = (B - Y) / Y, and Y is the luminance that the file's primaries have
(OpenEXR, *Technical Introduction*, Luminance/Chroma Images). Chroma is stored at every second
column and row from the first one on; between them it is interpolated linearly, around the sphere.

OpenImageIO reads no subsampled channels, so those are read with the package OpenEXR and written as
a copy at full size, which OpenImageIO then reads.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO
from numpy.typing import NDArray

from asglight.images import colour
from asglight.images.colour import Chromaticities
from asglight.images.decoding import copies


def is_subsampled(path: Path) -> bool:
    """Tell whether OpenImageIO refuses a file for its subsampled channels."""
    reader = OpenImageIO.ImageInput.open(str(path))
    if reader is not None:
        reader.close()
        return False
    with contextlib.suppress(UnicodeDecodeError):
        if "Subsampled channels" in OpenImageIO.geterror():
            return True
    # of a name that does not end as OpenEXR's it says only that no reader takes the file
    return path.suffix.lower() != ".exr" and _has_subsampled(path)


def _has_subsampled(path: Path) -> bool:
    """Tell whether an OpenEXR file has subsampled channels; False of one with a damaged header."""
    import OpenEXR  # seldom wanted

    with contextlib.suppress(RuntimeError, ValueError, TypeError):
        parts = OpenEXR.File(str(path), separate_channels=True, header_only=True).parts
        channels = [one for part in parts for one in part.header["channels"]]
        return any((one.xSampling, one.ySampling) != (1, 1) for one in channels)
    return False


@contextlib.contextmanager
def readable(path: Path) -> Iterator[Path]:
    """Give a copy of a file in which every channel is at full size.

    Raises:
        OSError: The package OpenEXR cannot read it either.
    """
    import OpenEXR  # seldom wanted

    with copies.empty(".exr") as (_, copy):
        try:
            file = OpenEXR.File(str(path), separate_channels=True)
            parts = [_full(part) for part in file.parts]
            OpenEXR.File(parts).write(str(copy))
        except (RuntimeError, ValueError, TypeError) as error:
            raise OSError(None, str(error)) from error
        yield copy


def _full(part):
    """Return a part with every channel at full size, uncompressed."""
    import OpenEXR

    header = {
        name: value
        for name, value in part.header.items()
        if name not in ("channels", "compression", "type", "name", "tiles", "chunkCount")
    }
    header |= {"type": OpenEXR.scanlineimage, "compression": OpenEXR.NO_COMPRESSION}
    low, high = part.header["dataWindow"]
    width, height = (int(end - begin) + 1 for begin, end in zip(low, high, strict=True))
    channels = {}
    for name, channel in part.channels.items():
        pixels = channel.pixels
        if channel.xSampling != 1 or channel.ySampling != 1:
            pixels = _spread(pixels.astype(np.float32), (channel.ySampling, channel.xSampling))
        channels[name] = np.ascontiguousarray(pixels[:height, :width])
    return OpenEXR.Part(header, channels, part.name() or "")


def _spread(pixels: NDArray[np.float32], steps: tuple[int, int]) -> NDArray[np.float32]:
    """Interpolate samples of every so many rows and columns, the columns around the sphere."""
    rows = np.arange(pixels.shape[0] * steps[0]) / steps[0]
    columns = np.arange(pixels.shape[1] * steps[1]) / steps[1]
    above, left = rows.astype(int), columns.astype(int)
    below = np.minimum(above + 1, len(pixels) - 1)
    right = (left + 1) % pixels.shape[1]
    down = (rows - above)[:, None].astype(np.float32)
    across = (columns - left).astype(np.float32)
    tall = pixels[above] * (1 - down) + pixels[below] * down
    return tall[:, left] * (1 - across) + tall[:, right] * across


def to_rgb(
    values: NDArray[np.float32], chromaticities: Chromaticities | None
) -> NDArray[np.float32]:
    """Return R, G, B of Y, RY, BY.

    Args:
        values: Y, RY, BY.  [H, W, 3]
        chromaticities: Primaries and white of the R, G, B; None for Rec.709.

    Returns:
        [H, W, 3]
    """
    weights = colour.luminance_weights(chromaticities or colour.REC709)
    y, ry, by = np.moveaxis(values, -1, 0)
    red, blue = (ry + 1) * y, (by + 1) * y
    green = (y - weights[0] * red - weights[2] * blue) / weights[1]
    return np.stack([red, green, blue], axis=-1).astype(np.float32)
