# SPDX-License-Identifier: Apache-2.0
"""How a stage was written, so that a layer over it, or a stage in its place, can be the same."""

import math
from dataclasses import replace
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom

from asglight.errors import InputError
from asglight.usd import schema
from asglight.usd.check.references import may_open
from asglight.usd.lights import cards, distant
from asglight.usd.options import DISTANCE_M, DOME_HEIGHT, Representation, StageOptions
from asglight.usd.spaces import space_of
from asglight.usd.stage import (
    child_of,
    held_representations,
    image_height,
    lobe_prims,
    meters_per_unit,
    open_rig,
    readable,
    rig_data,
    show,
    shown_representation,
)

CARD_SUFFIX = ".card.exr"
"""How the name of the cards' texture ends; another image on a card is somebody else's."""


def read_options(path: str | Path, rig: str | None = None) -> StageOptions:
    """Return the options that a stage was written with, and the axis that is up in it now.

    Args:
        path: The stage.
        rig: Path of the prim that holds the lobes, of a stage with several.

    Raises:
        InputError: There is no such stage, it holds no lobes, or a value is damaged.
    """
    stage, prim = open_rig(path, rig)
    stage.SetEditTarget(stage.GetSessionLayer())
    with readable(path):
        return replace(options_of(prim), up_axis=str(UsdGeom.GetStageUpAxis(stage)))


def options_of(rig: Usd.Prim) -> StageOptions:
    """Return the options that a rig was written with.

    Args:
        rig: Of a stage whose edit target is its session layer. Which representation it shows
            changes.
    """
    space = space_of(rig)
    data = rig_data(rig)
    shown, held = shown_representation(rig), held_representations(rig)
    first = (shown,) if shown else ()
    representations = tuple(map(str, (*first, *(one for one in held if one is not shown))))
    return StageOptions(
        representations=representations or StageOptions.representations,
        distance=card_distance_of(rig),
        dome_height=_dome_height(rig),
        meters_per_unit=meters_per_unit(rig.GetStage()),
        up_axis=space.up_axis,
        primary_path=str(rig.GetPath()),
        colorspace=space.colorspace,
        distant_lights=3 if data.get(schema.DISTANT_LIGHTS) == 3 else 1,
        card_texture=bool(data.get(schema.CARD_TEXTURE, False)),
    )


def card_distance_of(rig: Usd.Prim) -> float:
    """Return how far the cards were from the origin when they were written, in stage units."""
    usual = DISTANCE_M / meters_per_unit(rig.GetStage())
    distance = rig_data(rig).get(schema.DISTANCE, usual)
    is_number = isinstance(distance, int | float) and math.isfinite(distance) and distance > 0
    return float(distance) if is_number else usual


def card_kinds(rig: Usd.Prim) -> list[cards.Kind]:
    """Return what the light of each lobe is in a rig that shows its cards.

    What was switched off counts, as it was written.
    """
    filled = bool(child_of(rig, schema.FILL))
    return [_card_kind(prim, filled) for prim in lobe_prims(rig)]


def _card_kind(lobe: Usd.Prim, filled: bool) -> cards.Kind:
    below = [child.GetName() for child in lobe.GetAllChildren()]
    soft = {piece.name for _, pieces in cards.LEVELS[cards.Kind.SOFT] for piece in pieces}
    if any(name.rpartition("_")[2] in soft for name in below):
        return cards.Kind.SOFT
    own = [lobe, *(lobe.GetChild(side) for side in schema.SIDES if side in below)]
    if any(_has_texture(light) for light in own):
        return cards.Kind.TEXTURED
    has_own = lobe.GetTypeName() != "Xform" or len(own) > 1
    return cards.Kind.SINGLE if has_own or not filled else cards.Kind.FILL


def _has_texture(light: Usd.Prim) -> bool:
    asset = light.GetAttribute(schema.TEXTURE).Get() if light.HasAttribute(schema.TEXTURE) else None
    return bool(asset and asset.path.endswith(CARD_SUFFIX))


def threefold_lobes(rig: Usd.Prim) -> list[bool]:
    """Tell which lobes have three lights in a rig that shows its distant lights."""
    return [
        any(child.GetName().rpartition("_")[2] == distant.MIDDLE for child in prim.GetAllChildren())
        for prim in lobe_prims(rig)
    ]


def shown_kinds(rig: Usd.Prim) -> list[cards.Kind]:
    """Return what the light of each lobe is in the cards; none for a rig without them.

    Args:
        rig: As of `options_of`.
    """
    return card_kinds(rig) if _is_shown(rig, Representation.CARDS) else []


def shown_threefold(rig: Usd.Prim) -> list[bool]:
    """Tell which lobes have three distant lights; none for a rig without any.

    Args:
        rig: As of `options_of`.
    """
    return threefold_lobes(rig) if _is_shown(rig, Representation.DISTANT) else []


def dome_images(rig: Usd.Prim) -> list[str]:
    """Return the dome's images that are there, as USD resolves them.

    Args:
        rig: As of `options_of`.
    """
    return _images(rig, Representation.DOME, schema.DOME)


def fill_images(rig: Usd.Prim) -> list[str]:
    """Return the images of the cards' fill that are there, as `dome_images`."""
    return _images(rig, Representation.CARDS, schema.FILL)


def _is_shown(rig: Usd.Prim, representation: Representation) -> bool:
    """Show a representation, and tell whether the rig holds it."""
    if representation not in held_representations(rig):
        return False
    show(rig, representation)
    return True


def _images(rig: Usd.Prim, representation: Representation, name: str) -> list[str]:
    if not _is_shown(rig, representation):
        return []
    prim = child_of(rig, name)
    attribute = prim.GetAttribute(schema.TEXTURE) if prim else None
    if not attribute:
        return []
    codes = [Usd.TimeCode.Default(), *map(Usd.TimeCode, attribute.GetTimeSamples())]
    assets = [attribute.Get(code) for code in codes]
    stage = Path(rig.GetStage().GetRootLayer().realPath)
    # a damaged crate may hold a value of another type than it declares
    found = [asset.resolvedPath for asset in assets if isinstance(asset, Sdf.AssetPath)]
    return [path for path in found if path and may_open(stage, path)]


def _dome_height(rig: Usd.Prim) -> int:
    """Return the rows of the dome's images; of a stage copied without them, the usual number."""
    images = dome_images(rig)
    try:
        return image_height(images[0]) if images else DOME_HEIGHT
    except InputError:
        return DOME_HEIGHT
