# SPDX-License-Identifier: Apache-2.0
"""Linear colour spaces by name, and the matrices between them, from OpenColorIO's built-in config.

A name is one that the config knows (`ACEScg`, `lin_rec2020`, `Linear P3-D65`), one of
asglight.images.colour, or a Color Interop ID, which is how USD names it in a stage. A configuration
that the environment variable OCIO names is not used: the same words mean the same numbers
everywhere.
"""

import functools

import numpy as np
import OpenImageIO
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images import colour
from asglight.images.colour import Chromaticities
from asglight.images.message import shown

CONFIG = "ocio://default"

REC709 = "lin_rec709_scene"
"""The space of asglight's radiance."""

NAMES = {
    "lin_rec709_scene": "Linear Rec.709 (sRGB)",
    "lin_ap1_scene": "ACEScg",
    "lin_ap0_scene": "ACES2065-1",
    "lin_rec2020_scene": "Linear Rec.2020",
    "lin_p3d65_scene": "Linear P3-D65",
    "lin_adobergb_scene": "Linear AdobeRGB",
}
"""The config's name of each space that a stage can name, by Color Interop ID."""


def interop_id(name: str, option: str = "colorspace") -> str:
    """Return the Color Interop ID of a linear space, whatever it is called.

    Args:
        name: A name of `NAMES`, of asglight.images.colour, or another that OpenColorIO has for it.
        option: What it is the value of, for the message.

    Raises:
        InputError: OpenColorIO knows no such space, or it is not one of `NAMES`.
    """
    plain = {known.lower(): space for space, known in colour.INTEROP.items()}
    plain |= {space: space for space in NAMES}
    if name.lower() in plain:
        return plain[name.lower()]
    # a name that is no text, as half a surrogate pair, is none that OpenColorIO could have
    found = OpenImageIO.ColorConfig(CONFIG).resolve(name) if shown(name) == name else ""
    for space, known in NAMES.items():
        if known == found:
            return space
    raise InputError(
        f"{option}: {shown(name) or 'empty'}; expected a linear space with primaries: "
        f"{', '.join(NAMES.values())}, or another name that OpenColorIO has for one of them."
    )


def chromaticities(space: str) -> Chromaticities | None:
    """Return the primaries and the white of a space; None for Rec.709, which OpenEXR implies."""
    return None if space == REC709 else colour.KNOWN[colour.INTEROP[space]]


@functools.cache
def matrix(source: str, target: str) -> Tensor:
    """Return the matrix between two spaces, for column vectors.

    Args:
        source: Color Interop ID of the space to convert from.
        target: Of the space to convert to.

    Returns:
        OpenColorIO's own numbers, which are float32.  [3, 3] float64
    """
    if source == target:
        return torch.eye(3, dtype=torch.float64)
    unit = OpenImageIO.ImageBuf(np.eye(3, dtype=np.float32).reshape(1, 3, 3))
    converted = OpenImageIO.ImageBufAlgo.colorconvert(
        unit, NAMES[source], NAMES[target], colorconfig=CONFIG
    )
    assert not converted.has_error, converted.geterror()
    columns = [list(converted.getpixel(column, 0)) for column in range(3)]
    return torch.tensor(columns, dtype=torch.float64).T
