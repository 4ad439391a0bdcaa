# SPDX-License-Identifier: Apache-2.0
"""Writing OpenEXR latlongs, so that a reader sees the whole new file or the whole old one."""

import contextlib
import os
import secrets
from pathlib import Path

import numpy as np
import OpenEXR
from torch import Tensor

from asglight.errors import InputError
from asglight.images.message import compressed, shown

HALF_MAX = 65504.0
COMPRESSIONS = (
    *("none", "rle", "zips", "zip", "piz", "pxr24"),
    *("b44", "b44a", "dwaa", "dwab"),
)


def write_exr(
    path: str | Path, radiance: Tensor, *, half: bool = True, compression: str = "zip"
) -> None:
    """Write a latlong as a scanline OpenEXR file of R, G, B, marked as a latlong map.

    The file is written beside its target under another name and then renamed, so a failure
    leaves the target as it was. Half floats end at 65504: an image with a larger or a non-finite
    value is written as 32-bit float even where `half` is asked for, because a sun must not clip.

    Args:
        path: The target; its folder must exist.
        radiance: Linear Rec.709.  [H, W, 3]
        half: Write 16-bit floats where the values fit.
        compression: One of `COMPRESSIONS`, named as in OpenEXR.

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
    pixels = values.numpy().astype(np.float16 if half and fits else np.float32, order="C")
    # A name of its own, so that two writers of one target do not meet; hidden from folder scans.
    temporary = path.parent / f".asglight-{secrets.token_hex(4)}.exr"
    try:
        OpenEXR.File(_header(compression), {"RGB": pixels}).write(str(temporary))
        os.replace(temporary, path)
    except (RuntimeError, OSError) as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({_reason(path, error)}); expected a folder with "
            "room and the permission to write. Check the output path."
        ) from error
    finally:
        # Nothing to remove after success or in a folder that is none; the error above says more.
        with contextlib.suppress(OSError):
            temporary.unlink()


def _header(compression: str) -> dict[str, object]:
    name = "NO" if compression == "none" else compression.upper()
    return {
        "type": OpenEXR.scanlineimage,
        "compression": getattr(OpenEXR, f"{name}_COMPRESSION"),
        "envmap": OpenEXR.ENVMAP_LATLONG,
    }


def _reason(path: Path, error: Exception) -> str:
    if not path.parent.is_dir():
        return f"no folder {shown(path.parent)}"
    if isinstance(error, OSError):
        return error.strerror or type(error).__name__
    return compressed(str(error))
