# SPDX-License-Identifier: Apache-2.0
"""What a stage says of itself as a whole: axes, unit, time, asset, and the account of its fit."""

import json
from pathlib import PurePath
from typing import Any

from pxr import Sdf, Vt

from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.options import StageOptions
from asglight.usd.spaces import Space
from asglight.usd.write.authoring import constant


def metadata_text(tracks: LobeTracks) -> str:
    """Return the fit's metadata as one JSON string.

    USD dictionaries hold neither None nor lists of mixed values.
    """
    return json.dumps(dict(tracks.metadata), allow_nan=False, ensure_ascii=False)


def author_stage_metadata(layer: Sdf.Layer, tracks: LobeTracks, options: StageOptions) -> None:
    """Author what a layer says of its default prim, axes, unit and time."""
    layer.defaultPrim = layer.rootPrims[0].name
    layer.pseudoRoot.SetInfo(schema.UP_AXIS, options.up_axis)
    layer.pseudoRoot.SetInfo("metersPerUnit", options.meters_per_unit)
    layer.timeCodesPerSecond = layer.framesPerSecond = tracks.fps
    layer.startTimeCode = tracks.frames[0]
    layer.endTimeCode = tracks.frames[-1]


def author_asset(rig: Sdf.PrimSpec, space: Space, name: str) -> None:
    """Say which asset the rig is, and what the colours of everything below it mean."""
    identifier = Sdf.AssetPath(f"./{name}")
    rig.SetInfo("assetInfo", {"identifier": identifier, "name": PurePath(name).stem})
    rig.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[schema.COLORSPACE_API]))
    constant(rig, schema.COLORSPACE, space.colorspace)


def custom_data(tracks: LobeTracks, options: StageOptions) -> dict[str, Any]:
    """Return the rig's custom data.

    The frames are listed only where some are missing between the first and the last.
    """
    data: dict[str, Any] = {
        "version": schema.FORMAT_VERSION,
        schema.UP_AXIS: options.up_axis,
        schema.DISTANCE: options.card_distance,
        schema.DISTANT_LIGHTS: options.distant_lights,
        schema.CARD_TEXTURE: options.card_texture,
        "metadata": metadata_text(tracks),
    }
    if len(options.held) == 1:
        data[schema.REPRESENTATION] = str(options.shown)
    first, last = tracks.frames[0], tracks.frames[-1]
    if len(tracks.frames) != last - first + 1:
        data["frames"] = Vt.IntArray(tracks.frames)
    return data
