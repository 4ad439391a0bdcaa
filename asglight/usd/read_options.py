# SPDX-License-Identifier: Apache-2.0
"""How a stage was written, so that a layer over it, or a stage in its place, can be the same."""

from pathlib import Path

from pxr import Usd, UsdGeom

from asglight.errors import InputError
from asglight.usd import schema
from asglight.usd.options import DISTANCE_M, DOME_HEIGHT, Representation, StageOptions
from asglight.usd.spaces import space_of
from asglight.usd.stage import image_height, open_rig, rig_data


def read_options(path: str | Path) -> StageOptions:
    """Return the options that a stage was written with.

    Raises:
        InputError: There is no such stage, or it holds no lobes.
    """
    stage, rig = open_rig(path)
    stage.SetEditTarget(stage.GetSessionLayer())
    return options_of(rig)


def options_of(rig: Usd.Prim) -> StageOptions:
    """Return the options that a rig was written with.

    Args:
        rig: Of a stage whose edit target is its session layer. Which representation it shows
            changes.
    """
    space = space_of(rig)
    shown = rig.GetVariantSet(schema.VARIANT_SET).GetVariantSelection()
    return StageOptions(
        representation=shown if shown in set(Representation) else StageOptions.representation,
        distance=card_distance_of(rig),
        dome_height=_dome_height(rig),
        meters_per_unit=UsdGeom.GetStageMetersPerUnit(rig.GetStage()),
        up_axis=space.up_axis,
        primary_path=str(rig.GetPath()),
        colorspace=space.colorspace,
    )


def card_distance_of(rig: Usd.Prim) -> float:
    """Return how far the cards were from the origin when they were written, in stage units."""
    usual = DISTANCE_M / UsdGeom.GetStageMetersPerUnit(rig.GetStage())
    return float(rig_data(rig).get(schema.DISTANCE, usual))


def dome_images(rig: Usd.Prim) -> list[str]:
    """Return the dome's images that are there, as USD resolves them.

    Args:
        rig: As of `options_of`.
    """
    rig.GetVariantSet(schema.VARIANT_SET).SetVariantSelection(str(Representation.DOME))
    attribute = rig.GetPrimAtPath(schema.DOME).GetAttribute(schema.TEXTURE)
    if not attribute:
        return []
    codes = [Usd.TimeCode.Default(), *map(Usd.TimeCode, attribute.GetTimeSamples())]
    assets = [attribute.Get(code) for code in codes]
    return [asset.resolvedPath for asset in assets if asset and asset.resolvedPath]


def _dome_height(rig: Usd.Prim) -> int:
    """Return the rows of the dome's images; of a stage copied without them, the usual number."""
    images = dome_images(rig)
    try:
        return image_height(images[0]) if images else DOME_HEIGHT
    except InputError:
        return DOME_HEIGHT
