# SPDX-License-Identifier: Apache-2.0
"""Writing OpenEXR latlongs, so that a reader sees the whole new file or the whole old one."""

from pathlib import Path

import OpenEXR
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images.colour import Chromaticities
from asglight.images.message import compressed, shown
from asglight.images.output import written_beside

HALF_MAX = 65504.0
COMPRESSIONS = (
    *("none", "rle", "zips", "zip", "piz", "pxr24"),
    *("b44", "b44a", "dwaa", "dwab"),
)


def write_exr(
    path: str | Path,
    radiance: Tensor,
    *,
    half: bool = True,
    compression: str = "zip",
    chromaticities: Chromaticities | None = None,
    latlong: bool = True,
) -> None:
    """Write an image as a scanline OpenEXR file of R, G, B.

    The file is written beside its target under another name and then renamed, so a failure
    leaves the target as it was. Half floats end at 65504: an image with a larger or a non-finite
    value is written as 32-bit float even where `half` is asked for, because a sun must not clip.

    Args:
        path: The target; its folder must exist.
        radiance: Linear.  [H, W, 3]
        half: Write 16-bit floats where the values fit.
        compression: One of `COMPRESSIONS`, named as in OpenEXR.
        chromaticities: Primaries and white that the file states; None for Rec.709.
        latlong: Mark it as a latlong map.

    Raises:
        InputError: The file cannot be written there.
    """
    assert radiance.shape[2:] == (3,), radiance.shape
    path = Path(path)
    if compression not in COMPRESSIONS:
        raise InputError(
            f"compression: {shown(compression)}; expected one of {', '.join(COMPRESSIONS)}."
        )
    values = radiance.detach().cpu()
    # A comparison with NaN is false, so NaN selects float too.
    fits = bool((values.abs() <= HALF_MAX).all())
    # In C order: OpenEXR writes the memory of an array and not its strides.
    pixels = values.to(torch.float16 if half and fits else torch.float32).contiguous().numpy()
    with written_beside(path) as place:
        try:
            header = _header(compression, chromaticities, latlong=latlong)
            OpenEXR.File(header, {"RGB": pixels}).write(str(place))
        except RuntimeError as error:
            raise OSError(None, compressed(str(error))) from error


def _header(
    compression: str, chromaticities: Chromaticities | None, *, latlong: bool
) -> dict[str, object]:
    name = "NO" if compression == "none" else compression.upper()
    stated: dict[str, object] = {}
    if chromaticities is not None:
        stated["chromaticities"] = chromaticities
    if latlong:
        stated["envmap"] = OpenEXR.ENVMAP_LATLONG
    return {
        **stated,
        "type": OpenEXR.scanlineimage,
        "compression": getattr(OpenEXR, f"{name}_COMPRESSION"),
    }
