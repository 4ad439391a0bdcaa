# SPDX-License-Identifier: Apache-2.0
"""What a header says of its image: its parts, where the image lies, its colours, what to tell."""

from pathlib import Path

import OpenImageIO

from asglight.errors import InputError
from asglight.images import ocio
from asglight.images.colour import ColourSpace
from asglight.images.decoding import layers, radiance, stated
from asglight.images.message import shown
from asglight.images.options import Eye, ReadOptions

# Of the Exif orientation (TIFF 6.0), the axes that rows and columns are stored along.
_ORIENTATIONS = {
    1: ("-Y", "+X"),
    2: ("-Y", "-X"),
    3: ("+Y", "-X"),
    4: ("+Y", "+X"),
    5: ("+X", "-Y"),
    6: ("-X", "-Y"),
    7: ("-X", "+Y"),
    8: ("+X", "+Y"),
}


# Bits of a channel of integers.
_UNSIGNED = {
    OpenImageIO.UINT8: 8,
    OpenImageIO.UINT16: 16,
    OpenImageIO.UINT32: 32,
    OpenImageIO.UINT64: 64,
}
_SIGNED = {
    OpenImageIO.INT8: 8,
    OpenImageIO.INT16: 16,
    OpenImageIO.INT32: 32,
    OpenImageIO.INT64: 64,
}


def part_of(spec: OpenImageIO.ImageSpec, *, is_only: bool) -> layers.Part:
    """Return what a part says of itself; in a file of one part its name means nothing."""
    views = spec.getattribute("multiView")
    interop = _text(spec, "colorInteropID")
    return layers.Part(
        "" if is_only else _text(spec, "name"),
        tuple(spec.channelnames),
        _text(spec, "view"),
        (views,) if isinstance(views, str) else _strings(views),
        bool(spec.deep),
        bool(interop) and not is_only and interop.lower() == "data",
    )


def _strings(values: object) -> tuple[str, ...]:
    """Return the words of an attribute; none where it is missing or of another type."""
    if isinstance(values, tuple | list) and all(isinstance(each, str) for each in values):
        return tuple(values)
    return ()


def axes_of(spec: OpenImageIO.ImageSpec, kind: str) -> tuple[str, str]:
    """Return how the pixels are stored: of the Exif orientation; PFM begins at the bottom."""
    if kind == "pnm":
        return ("+Y", "+X")
    return _ORIENTATIONS.get(spec.get_int_attribute("Orientation", 1), ("-Y", "+X"))


def half_of(
    path: Path, layer: layers.Layer, size: tuple[int, int], eye: Eye | None
) -> tuple[tuple[int, int], tuple[int, int], str]:
    """Return the corner and the size of an eye's image, and which half of the whole it is.

    The left eye is above (stereo panoramas of YouTube, Facebook and OTOY), or at the left.
    """
    width, height = size
    if eye is None or layer.eye is not None:
        return (0, 0), size, ""
    if width == height:
        rows = height // 2
        return (0, 0 if eye == "left" else height - rows), (width, rows), eye
    if width == 4 * height:
        columns = width // 2
        return (0 if eye == "left" else columns, 0), (columns, height), eye
    raise InputError(
        f"{shown(path)}: has no {eye} eye: it is {width} x {height} and has no views of eyes; "
        "expected views left and right, or one eye over or beside the other. Leave out --eye."
    )


def colour_of(
    path: Path,
    specs: list[OpenImageIO.ImageSpec],
    lines: radiance.RadianceHeader,
    layer: layers.Layer,
    kind: str,
    reading: ReadOptions,
) -> ColourSpace:
    """Return what the user says of the colours, else what the file does.

    Raises:
        InputError: What the file states cannot be followed; or it holds integers, and the user does
            not say what they mean, or they are signed.
    """
    _check_signs(path, specs[layer.part])
    if reading.colorspace is not None:
        return ocio.input_space(reading.colorspace)
    if kind == "openexr":
        return stated.of_exr(path, specs, layer)
    if kind == "hdr":
        return stated.of_radiance(path, lines)
    _check_range(path, specs[layer.part], kind)
    return stated.of_other(path, specs[layer.part], kind)


def told(
    spec: OpenImageIO.ImageSpec,
    lines: radiance.RadianceHeader,
    layer: layers.Layer,
    half: str,
    reading: ReadOptions,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return what a user has to know of a header: notes, and warnings."""
    notes, warnings = [*stated.notes_of(spec)], [*lines.notes]
    if lines.multiplier != (1.0, 1.0, 1.0):
        factors = " ".join(f"{value:.6g}" for value in lines.multiplier)
        notes.append(f"EXPOSURE and COLORCORR are divided out: {factors}")
    if reading.colorspace is not None:
        warnings += [f"not used, as --input-colorspace says more: {one}" for one in lines.faults]
    elif lines.gamma != 1:
        notes.append(f"GAMMA {lines.gamma:.4g} is undone")
    if half:
        notes.append(f"{half} eye: one half of a stereo image")
    elif layer.view:
        notes.append(f"view {layer.view}, of a file of several")
    return tuple(notes), tuple(warnings)


def _bits(spec: OpenImageIO.ImageSpec, kind: str) -> int:
    """Return the bits of a channel of integers that end at white; 0 for others.

    Those of OpenEXR mean their value, and may be any.
    """
    return 0 if kind == "openexr" else _UNSIGNED.get(spec.format.basetype, 0)


def _check_signs(path: Path, spec: OpenImageIO.ImageSpec) -> None:
    """Refuse an image of signed integers, in which neither black nor white has a known number."""
    bits = _SIGNED.get(spec.format.basetype, 0)
    if bits:
        raise InputError(
            f"{shown(path)}: is an image of signed {bits}-bit integers, of which nobody says where "
            "black and white are; expected OpenEXR, Radiance or another image of floats. Take the "
            "HDR original, or convert it."
        )


def _check_range(path: Path, spec: OpenImageIO.ImageSpec, kind: str) -> None:
    """Refuse an image of integers, unless the user says what they mean."""
    bits = _bits(spec, kind)
    if bits:
        raise InputError(
            f"{shown(path)}: is an image of {bits}-bit integers, in which suns and lamps are "
            "clipped at white; expected OpenEXR, Radiance or another image of floats. Take the "
            "HDR original, or read it as it is with --input-colorspace sRGB."
        )


def warnings_of_range(
    spec: OpenImageIO.ImageSpec, kind: str, reading: ReadOptions
) -> tuple[str, ...]:
    """Return what is missing in an image of integers that the user wants to have read."""
    bits = _bits(spec, kind)
    if not bits or reading.colorspace is None:
        return ()
    return (f"{bits}-bit integers: suns and lamps are clipped at white, so their light is missing",)


def _text(spec: OpenImageIO.ImageSpec, name: str) -> str:
    return spec.get_string_attribute(name, "")
