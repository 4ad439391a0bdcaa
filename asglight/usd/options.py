# SPDX-License-Identifier: Apache-2.0
"""How a stage is written: what it shows, where its lobes stand, in which units and colours.

This file does without pxr, so that the command line can offer and check what a fit needs only when
it ends.
"""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from asglight.errors import InputError
from asglight.images import ocio
from asglight.images.message import forward, has_backslash, shown

PACKAGE = ".usdz"

STAGE_SUFFIXES = (".usda", ".usdc", ".usd", PACKAGE)
"""Text, crate, crate, and a package of a crate with the dome's images."""

DISTANCE_M = 1000.0
"""Of the cards where nothing else is asked for: far beyond a set, so that its lights are parallel
to the fit's precision."""

DOME_HEIGHT = 256
"""Rows of the dome's images: texels of 0.7 degrees. With half as many, a lamp narrower than a
texel moves so far that a ball of roughness 0.25 is 2 % off, and in Blender, which interpolates, 4 %
(docs/results/dcc.md)."""

_ARGUMENTS = ":SDF_FORMAT_ARGS:"

UP_AXES = ("Y", "Z")

DISTANT_LIGHTS = (1, 3)
"""How many distant lights an anisotropic lobe may have."""


class Representation(StrEnum):
    """The ways in which a stage can show the same lobes."""

    CARDS = "cards"
    """Rectangular area lights of each lobe's flux and second moments; broad lobes in one dome."""
    DISTANT = "distant"
    """One distant light a lobe, of its irradiance and second moment; for real-time engines."""
    DOME = "dome"
    """One dome light with an image of all lobes; exact to the texel."""
    KEYS = "keys"
    """A light for each lamp of the images, and a dome with the images without these lamps."""


OF_LOBES = tuple(one for one in Representation if one is not Representation.KEYS)
"""Those that show the lobes; `keys` is made of images, by `asglight keys`."""


class KeyLights(StrEnum):
    """What a key shines as."""

    RECT = "rect"
    """A RectLight: its lamp's rectangle."""
    DISTANT = "distant"
    """A DistantLight; for real-time engines."""


REST_ROWS_MIN = 16
"""Fewer show no picture, and no lamp."""

REST_ROWS_MAX = 2048
"""Rows of the rest's images where nothing else is asked for: 4k, or the images' own if fewer."""


@dataclass(frozen=True)
class KeyOptions:
    """How keys are found and written.

    Attributes:
        count: How many at most; None for as few as carry most of the lamps' light.
        lights: What each shines as.
        texture: Whether a RectLight carries the pixels of its lamp.
        rest_height: Rows of the rest's images at most.
    """

    count: int | None = None
    lights: KeyLights = KeyLights.RECT
    texture: bool = False
    rest_height: int = REST_ROWS_MAX


@dataclass(frozen=True)
class StageOptions:
    """Options of a stage; `asglight.usd.write_usd` takes them by name.

    Attributes:
        representations: What the stage holds, the one that it opens with first: `cards`, `distant`,
            `dome`, `keys`. One alone is plain prims; several are the variants of a set.
        distance: Of the cards from the origin, in stage units; None for 1,000 m.
        dome_height: Rows of the dome's images; there are twice as many columns.
        meters_per_unit: Length of a stage unit.
        up_axis: Of the stage: `Y` or `Z`.
        primary_path: The prim that holds the lobes, such as `/World/Lights/Env`.
        colorspace: Linear space of the stage's colours, by a name that OpenColorIO knows.
        distant_lights: Of an anisotropic lobe in `distant`: 1, or 3 in a row.
        card_texture: Whether cards have a Gaussian texture where that is better.
    """

    representations: tuple[str, ...] = (Representation.CARDS,)
    distance: float | None = None
    dome_height: int = DOME_HEIGHT
    meters_per_unit: float = 1.0
    up_axis: str = "Y"
    primary_path: str = "/AsgRig"
    colorspace: str = ocio.REC709
    distant_lights: int = 1
    card_texture: bool = False

    @property
    def shown(self) -> Representation:
        """Return the representation that the stage opens with."""
        return Representation(self.representations[0])

    @property
    def held(self) -> tuple[Representation, ...]:
        """Return the representations in the order in which a stage has them."""
        return tuple(one for one in Representation if one in self.representations)

    @property
    def may_show_images(self) -> bool:
        """Tell whether lights may show images; distant lights have none."""
        return self.held != (Representation.DISTANT,)

    @property
    def card_distance(self) -> float:
        """Return the distance of the cards in stage units."""
        return DISTANCE_M / self.meters_per_unit if self.distance is None else self.distance


def without_keys(options: StageOptions) -> StageOptions:
    """Return options of a stage without keys: cards, where it holds nothing else."""
    names = tuple(one for one in options.representations if one != Representation.KEYS)
    return replace(options, representations=names or (Representation.CARDS,))


def image_folder(path: Path) -> Path:
    """Return the folder of a stage's images."""
    return path.parent / f"{path.stem}_dome"


def stages_beside(path: Path) -> list[Path]:
    """Return the stages whose images would lie in the same folder: of one name but the extension.

    A package has its images within.
    """
    with_folder = [suffix for suffix in STAGE_SUFFIXES if suffix != PACKAGE]
    if path.suffix.lower() not in with_folder or not path.parent.is_dir():
        return []
    found = [one for one in path.parent.iterdir() if one.stem == path.stem]
    stages = [one for one in found if one.suffix.lower() in with_folder and one.is_file()]
    return [one for one in stages if not (path.exists() and one.samefile(path))]


def check_stage_name(path: Path) -> None:
    """Refuse a name that USD could not refer to from within the stage.

    Raises:
        InputError: It has control characters, or backslashes on a system where they are letters,
            or USD takes a part of it for arguments.
    """
    if not path.name.isprintable():
        raise InputError(f"{shown(path)}: control characters in the name; expected none.")
    if has_backslash(path.name):
        raise InputError(
            f"{shown(path)}: has a backslash, which separates no folders here and which USD cannot "
            f"refer to; expected slashes. Write {shown(forward(path))}."
        )
    if _ARGUMENTS in path.name:
        raise InputError(
            f"{shown(path)}: has {_ARGUMENTS} in its name, which USD takes for arguments; expected "
            "another name."
        )


def check_key_options(options: KeyOptions) -> None:
    """Refuse options that no keys can be found with.

    Raises:
        InputError: One is out of range, or two do not go together.
    """
    if options.count is not None and options.count < 1:
        raise InputError(f"keys: {options.count}; expected auto or a number above 0.")
    if options.rest_height < REST_ROWS_MIN:
        raise InputError(
            f"rest height: {options.rest_height}; expected {REST_ROWS_MIN} rows or more."
        )
    if options.texture and options.lights is KeyLights.DISTANT:
        raise InputError(
            "keys texture: given with distant lights, which have none; expected --keys-as rect."
        )


def check_stage_options(options: StageOptions) -> None:
    """Refuse options that no stage can be written with.

    Raises:
        InputError: One is out of range.
    """
    _check_representations(options.representations)
    lengths = {"distance": options.distance, "meters per unit": options.meters_per_unit}
    for name, value in lengths.items():
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: {value:g}; expected a finite number above 0.")
    if options.dome_height < 2:
        raise InputError(f"dome height: {options.dome_height}; expected 2 rows or more.")
    if options.distant_lights not in DISTANT_LIGHTS:
        raise InputError(f"distant lights: {options.distant_lights}; expected 1 or 3.")
    if options.up_axis not in UP_AXES:
        raise InputError(
            f"up axis: {shown(options.up_axis)}; expected one of {', '.join(UP_AXES)}."
        )
    root, *names = options.primary_path.split("/")
    # what Python takes for a name, USD does: XID_Start or _, then XID_Continue
    if root or not names or not all(name.isidentifier() for name in names):
        raise InputError(
            f"primary path: {shown(options.primary_path) or 'empty'}; expected a prim path such as "
            "/World/Lights/Env: names of letters, digits and _ that begin with no digit."
        )
    ocio.interop_id(options.colorspace)


def parse_representations(text: str) -> tuple[str, ...]:
    """Return the representations of a list such as `cards,dome`.

    Raises:
        InputError: One is not known, or named twice.
    """
    names = tuple(name.strip() for name in text.split(","))
    _check_representations(names)
    return names


def _check_representations(names: tuple[str, ...]) -> None:
    known = names and set(names) <= set(Representation)
    if not known or len(set(names)) < len(names):
        raise InputError(
            f"representations: {shown(','.join(names)) or 'none'}; expected some of "
            f"{', '.join(Representation)}, each once, such as cards,dome."
        )
