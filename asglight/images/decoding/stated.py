# SPDX-License-Identifier: Apache-2.0
"""What a file states of its colours: obeyed, or refused where it cannot be.

What is stated by name is looked up in OpenColorIO's config. What is stated twice has to agree. The
table of all attributes and lines is in docs/reference/inputs.md.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO

from asglight.errors import InputError
from asglight.images import colour, ocio
from asglight.images.colour import ASSUMED, Chromaticities, ColourSpace
from asglight.images.decoding.layers import Layer
from asglight.images.decoding.radiance import RadianceHeader
from asglight.images.message import listing, shown

OVERRIDE = "Say which it is with --input-colorspace."

NAMED_BY = ("colorInteropID", "interopID", "colorSpace", "ColorSpace", "colorspace", "color_space")
"""Attributes that name a space."""

NOTHING = ("", "unknown", "uncalibrated", "none")
"""Values that say that nothing is stated, in lower case."""

LINEAR = ("", "1", "linear", "gamma1.0")
"""What a gamma that is none is written as, in lower case."""


def of_exr(path: Path, specs: Sequence[OpenImageIO.ImageSpec], layer: Layer) -> ColourSpace:
    """Return what a part of an OpenEXR file states.

    Args:
        path: The file, for messages.
        specs: Of all parts. Chromaticities of the first hold for all (they are shared).
        layer: The layer to read.

    Raises:
        InputError: It states what is no space of colours, or two of them.
    """
    spec = specs[layer.part]
    stated = [
        space
        for space in (
            _by_name(path, spec, NAMED_BY),
            _by_numbers(path, spec, specs[0]),
            _by_aces(spec),
            _by_channels(layer),
        )
        if space is not None
    ]
    _check_gamma(path, spec)
    for other in stated[1:]:
        if not _agree(stated[0], other):
            raise InputError(
                f"{shown(path)}: states {stated[0].sentence()} and {other.sentence()}; expected "
                f"one space of colours. {OVERRIDE}"
            )
    # OpenImageIO makes its own attribute up of others, of other parts too; alone, it is the file's.
    if not stated and len(specs) == 1:
        return _by_name(path, spec, ("oiio:ColorSpace",)) or ASSUMED
    return stated[0] if stated else ASSUMED


def luminance_of(
    specs: Sequence[OpenImageIO.ImageSpec], layer: Layer, space: ColourSpace
) -> Chromaticities | None:
    """Return the primaries and white of the R, G, B that a layer's luminance is of.

    Its writer has made it by those that it states, also where the user says another space.
    Statements that mean nothing are refused elsewhere, unless the user says the space.

    Args:
        specs: As `of_exr`.
        layer: The layer to read.
        space: What its colours are.

    Returns:
        Those that are stated, else those of the space, where it has any; None for Rec.709.
    """
    if layer.kind != "luminance-chroma":
        return None
    numbers = _chromaticities(specs[layer.part], specs[0])
    if numbers is not None and colour.is_colour_space(numbers):
        return numbers
    return _primaries(space)


def of_radiance(path: Path, header: RadianceHeader) -> ColourSpace:
    """Return what the lines of a Radiance file state.

    Raises:
        InputError: A line of colour cannot be understood.
    """
    if header.faults:
        raise InputError(
            f"{shown(path)}: its header has {listing(header.faults)}; expected lines that have a "
            "meaning. Correct it, or say what its colours are with --input-colorspace."
        )
    if header.format == "xyze":  # XYZ is XYZ, whatever primaries it has been made from
        return ColourSpace("CIE XYZ", "FORMAT", config_name=ocio.XYZ)
    if header.primaries is None:
        return ASSUMED
    return _of_numbers(header.primaries, "PRIMARIES")


def of_other(path: Path, spec: OpenImageIO.ImageSpec, kind: str) -> ColourSpace:
    """Return what a float image that is neither OpenEXR nor Radiance states.

    Raises:
        InputError: It has a colour profile, which nothing here can follow.
    """
    if spec.getattribute("ICCProfile") is not None:
        described = _text(spec, "ICCProfile:profile_description") or "no description"
        raise InputError(
            f"{shown(path)}: has an ICC profile ({shown(described)}); expected linear Rec.709, or "
            f"a space by name. {OVERRIDE}"
        )
    if kind == "pnm":  # PFM states nothing; what OpenImageIO says is of integers
        return ASSUMED
    return _by_name(path, spec, (*NAMED_BY, "oiio:ColorSpace")) or ASSUMED


def notes_of(spec: OpenImageIO.ImageSpec) -> tuple[str, ...]:
    """Return what is stated of the looks of an image, which its light does not depend on."""
    notes = []
    white = white_luminance(spec)
    if white is not None:
        notes.append(
            f"whiteLuminance {white:.4g} is not applied: radiance is relative, 1 is that many nits"
        )
    neutral = _floats(spec, "adoptedNeutral")
    if neutral is not None and len(neutral) == 2:
        x, y = neutral
        notes.append(
            f"adoptedNeutral {x:.4g} {y:.4g} is not applied: it says what a display shows as grey"
        )
    return tuple(notes)


def white_luminance(spec: OpenImageIO.ImageSpec) -> float | None:
    """Return the luminance in nits that a file gives (1, 1, 1); None where it gives none."""
    value = _floats(spec, "whiteLuminance")
    return value[0] if value is not None and len(value) == 1 else None


def _by_name(
    path: Path, spec: OpenImageIO.ImageSpec, attributes: tuple[str, ...]
) -> ColourSpace | None:
    """Return the space that the first of some attributes names."""
    for attribute in attributes:
        name = _text(spec, attribute).strip()
        if name.lower() in NOTHING:
            continue
        space = ocio.space_named(name)
        if space is None:
            raise InputError(
                f"{shown(path)}: states {attribute} {shown(name)}, which OpenColorIO has not; "
                f"expected one of its names. {OVERRIDE}"
            )
        if ocio.is_data(space):
            raise InputError(
                f"{shown(path)}: states {attribute} {shown(name)}: data, no colours; expected an "
                "image. If it is light, say so with --input-colorspace."
            )
        if space == ocio.NAMES[ocio.REC709]:
            return ColourSpace(ASSUMED.name, attribute)
        return ColourSpace(space, attribute, config_name=space)
    return None


def _by_numbers(
    path: Path, spec: OpenImageIO.ImageSpec, first: OpenImageIO.ImageSpec
) -> ColourSpace | None:
    """Return the space of stated chromaticities."""
    if all(each.getattribute("chromaticities") is None for each in (spec, first)):
        return None
    numbers = _chromaticities(spec, first)
    if numbers is None:
        raise InputError(
            f"{shown(path)}: states chromaticities that are not eight numbers; expected three "
            "primaries and a white. Correct or remove them, or say what its colours are with "
            "--input-colorspace."
        )
    if not colour.is_colour_space(numbers):
        raise InputError(
            f"{shown(path)}: states chromaticities {' '.join(f'{v:.4g}' for v in numbers)}; "
            "expected three primaries and a white that span colours. Correct or remove them, or "
            "say what its colours are with --input-colorspace."
        )
    return _of_numbers(numbers, "chromaticities")


def _chromaticities(
    spec: OpenImageIO.ImageSpec, first: OpenImageIO.ImageSpec
) -> Chromaticities | None:
    """Return the numbers that a part or else the first one states; None where it has no eight."""
    holder = first if spec.getattribute("chromaticities") is None else spec
    stated = _floats(holder, "chromaticities")
    if stated is None or len(stated) != 8:
        return None
    red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = stated
    return red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y


def _floats(spec: OpenImageIO.ImageSpec, name: str) -> tuple[float, ...] | None:
    """Return the numbers of an attribute; None where it is missing or of another type."""
    value: Any = spec.getattribute(name)
    values = np.atleast_1d(np.asarray(value if value is not None else "", dtype=object)).ravel()
    if all(isinstance(each, int | float | np.number) for each in values):
        return tuple(map(float, values))
    return None


def _of_numbers(numbers: Chromaticities, said_by: str) -> ColourSpace:
    name = colour.name_of(numbers)
    if name == "Rec.709":
        return ColourSpace(ASSUMED.name, said_by)
    if name == "CIE XYZ":  # XYZ is XYZ: a white that is stated for it adapts nothing
        return ColourSpace("CIE XYZ", said_by, config_name=ocio.XYZ)
    return ColourSpace(name, said_by, chromaticities=numbers)


def _by_aces(spec: OpenImageIO.ImageSpec) -> ColourSpace | None:
    """Return what an ACES container holds (SMPTE ST 2065-4)."""
    if not spec.get_int_attribute("acesImageContainerFlag", 0):
        return None
    return _of_numbers(colour.KNOWN["ACES AP0"], "acesImageContainerFlag")


def _by_channels(layer: Layer) -> ColourSpace | None:
    if layer.kind != "xyz":
        return None
    return ColourSpace("CIE XYZ", "channels X, Y, Z", config_name=ocio.XYZ)


def _check_gamma(path: Path, spec: OpenImageIO.ImageSpec) -> None:
    """Refuse a stated gamma, of which nobody says what it was applied to."""
    for attribute in ("gamma", "Gamma", "oiio:Gamma"):
        value = spec.getattribute(attribute)
        if value is not None and str(value).lower() not in (*LINEAR, "1.0", "0.0"):
            raise InputError(
                f"{shown(path)}: states {attribute} {shown(str(value))}; expected linear light. "
                f"{OVERRIDE}"
            )


def _agree(one: ColourSpace, other: ColourSpace) -> bool:
    """Tell whether two statements have the same primaries and white, as far as each has them."""
    first, second = _primaries(one), _primaries(other)
    if first is None or second is None:
        return one.config_name == other.config_name
    if "CIE XYZ" in (colour.name_of(first), colour.name_of(second)):
        return first[:6] == second[:6] or colour.name_of(first) == colour.name_of(second)
    return all(abs(a - b) <= colour.ROUNDING for a, b in zip(first, second, strict=True))


def _primaries(space: ColourSpace) -> Chromaticities | None:
    if space.config_name is not None:
        return ocio.primaries_of(space.config_name)
    return space.chromaticities or colour.REC709


def _text(spec: OpenImageIO.ImageSpec, name: str) -> str:
    return spec.get_string_attribute(name, "")
