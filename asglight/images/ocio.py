# SPDX-License-Identifier: Apache-2.0
"""Colour spaces by name, and what turns one into another, from OpenColorIO's built-in config.

The config is the studio config, which has every name of the smaller one and those of cameras
besides. A configuration that the environment variable OCIO names is not used: the same words mean
the same numbers everywhere.

Images may be in any space of the config. A stage names one of the few linear spaces with a Color
Interop ID that USD knows (`NAMES`).
"""

import difflib
import functools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from asglight.errors import InputError
from asglight.images import colour
from asglight.images.colour import Chromaticities, ColourSpace
from asglight.images.message import listing, shown

if TYPE_CHECKING:
    import OpenImageIO
    import PyOpenColorIO

CONFIG = "ocio://studio-config-latest"

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

XYZ = "CIE XYZ-D65 - Scene-referred"

ALIASES = {
    "srgb": "sRGB Encoded Rec.709 (sRGB)",
    **dict.fromkeys(("xyz", "ciexyz", "cie-xyz", "cie xyz", "xyz-d65", "cie xyz-d65"), XYZ),
}
"""Names that people use and the config lacks, in lower case."""


def interop_id(name: str) -> str:
    """Return the Color Interop ID of a linear space that a stage can name, whatever it is called.

    Args:
        name: A name of `NAMES`, of asglight.images.colour, or another that OpenColorIO has for it.

    Raises:
        InputError: OpenColorIO knows no such space, or it is not one of `NAMES`.
    """
    plain = _plain_names()
    if name.lower() in plain:
        return plain[name.lower()]
    # a name that is no text, as half a surrogate pair, is none that OpenColorIO could have
    found = config().resolve(name) if shown(name) == name else ""
    for space, known in NAMES.items():
        if known == found:
            return space
    raise InputError(
        f"colorspace: {shown(name) or 'empty'}; expected a linear space with primaries: "
        f"{', '.join(NAMES.values())}, or another name that OpenColorIO has for one of them."
    )


def input_space(name: str) -> ColourSpace:
    """Return the space that a user gives images with --input-colorspace.

    Args:
        name: Any name, alias, role or Color Interop ID of the config, whatever its case; or one of
            `ALIASES` or of asglight.images.colour.

    Raises:
        InputError: OpenColorIO knows no such space.
    """
    plain = _plain_names()
    found = NAMES[plain[name.lower()]] if name.lower() in plain else space_named(name)
    if found is None:
        every = [*config().getColorSpaceNames(), *ALIASES, *plain]
        near = {known.lower(): known for known in every}
        close = difflib.get_close_matches(name.lower(), near, n=4, cutoff=0.3)
        nearest = listing(dict.fromkeys(near[one] for one in close)) or "none"
        raise InputError(
            f"input colorspace: {shown(name) or 'empty'}; expected a name that OpenColorIO's "
            f"studio config has, such as ACEScg, sRGB or XYZ. Nearest: {nearest}. "
            "docs/reference/inputs.md lists them all."
        )
    # The numbers of a space of data are what they are: light, if the user says that they are.
    is_plain = found == NAMES[REC709] or config().isData(found)
    return ColourSpace(found, "--input-colorspace", config_name=None if is_plain else found)


def space_named(name: str) -> str | None:
    """Return the config's own name of a space; None for one that it does not know.

    A Color Interop ID is known with and without the namespace `ocio:`.
    """
    if shown(name) != name:  # no text, which OpenColorIO cannot be asked for
        return None
    names = config().getColorSpaceNames()
    bare = name.removeprefix("ocio:")
    for known in (ALIASES.get(name.lower(), name), bare, f"ocio:{bare}"):
        found = config().resolve(known)
        if found in names:
            return found
    return None


def is_data(space: str) -> bool:
    """Tell whether the config says that a space holds no colours."""
    return config().isData(space)


def chromaticities(space: str) -> Chromaticities | None:
    """Return the primaries and the white of a space; None for Rec.709, which OpenEXR implies."""
    return None if space == REC709 else colour.KNOWN[colour.INTEROP[space]]


def primaries_of(space: str) -> Chromaticities | None:
    """Return the primaries and the white of any space of the config; None where it has none."""
    found = config().get_chromaticities(space)
    if not found:
        return None
    red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = found
    return red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y


def is_linear(space: str) -> bool:
    """Tell whether numbers of a space are in proportion to light."""
    return config().isColorSpaceLinear(space)


@functools.cache
def matrix(source: str, target: str) -> NDArray[np.float64]:
    """Return the matrix between two linear spaces, for column vectors.

    Args:
        source: The space to convert from: a Color Interop ID or the config's name.
        target: The space to convert to.

    Returns:
        OpenColorIO's own numbers, which are float32.  [3, 3]
    """
    if source == target:
        return np.eye(3)
    unit = np.eye(3, dtype=np.float32).reshape(1, 3, 3)
    return converted(unit, source, target)[0].T.astype(np.float64)


def converted(values: np.ndarray, source: str, target: str = REC709) -> np.ndarray:
    """Convert colours from any space to another, curves included.

    Args:
        values: Numbers of the space, finite.  [H, W, 3] float32
        source: The space to convert from.
        target: The space to convert to.

    Returns:
        Numbers of the target.  [H, W, 3] float32
    """
    found = np.array(values, dtype=np.float32, order="C")
    _processor(NAMES.get(source, source), NAMES.get(target, target)).applyRGB(found)
    return found


@functools.cache
def _processor(source: str, target: str) -> "PyOpenColorIO.CPUProcessor":
    """Return what converts colours; OpenImageIO's `colorconvert` reads the config at each call."""
    import PyOpenColorIO  # few images need it

    every = PyOpenColorIO.Config.CreateFromFile(CONFIG)
    return every.getProcessor(source, target).getDefaultCPUProcessor()


@functools.cache
def config() -> "OpenImageIO.ColorConfig":
    """Return the config."""
    import OpenImageIO  # slow to load, and seldom wanted

    return OpenImageIO.ColorConfig(CONFIG)


def _plain_names() -> dict[str, str]:
    """Return the Color Interop IDs of linear spaces by asglight's names for their primaries."""
    plain = {known.lower(): space for space, known in colour.INTEROP.items()}
    return plain | {space: space for space in NAMES}
