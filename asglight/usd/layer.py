# SPDX-License-Identifier: Apache-2.0
"""The stage as a layer: the rig, its lobes, and a variant for each representation.

What a lobe is (orientation, sharpness, amplitude, form) lies outside the variants, so every
representation turns with it and a reader needs none of them. Lights are derived values.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any

import numpy as np
import torch
from pxr import Gf, Sdf, Vt
from torch import Tensor

from asglight.lobes import LobeTracks, frames
from asglight.lobes.data import Form, Lobes
from asglight.usd import cards, distant, schema
from asglight.usd.authoring import TrackAuthor, constant
from asglight.usd.digest import author_digest, digest_of_values
from asglight.usd.options import StageOptions
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space, space_for, to_stage

LOBE_TOLERANCE = 1e-6
"""Relative. A lobe comes back to float32 rounding, about ten units in the last place."""

LIGHT_TOLERANCE = 2e-5
"""Relative. Lights are derived from lobes: four such errors, in width, height, intensity and
colour, change a card's flux by 8e-5, a thirtieth of what the shape of the best card costs."""

FLIP = Gf.Quatf(0, 1, 0, 0)
"""Half a turn about x: from the front of a bingham lobe to its back."""


def build(
    tracks: LobeTracks, options: StageOptions, textures: Sequence[str], name: str
) -> tuple[Sdf.Layer, TrackAuthor]:
    """Author the whole stage.

    Args:
        tracks: Lobes of all frames.
        options: What the stage shows, and where.
        textures: Dome images relative to the layer: one for each frame, or one for all.
        name: Of the layer's file.

    Returns:
        An anonymous layer, and the author with its sample counts.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    author = TrackAuthor(tracks.frames)
    space = space_for(options)
    lobes = continuous(to_stage(tracks.lobes, space))
    with Sdf.ChangeBlock():
        rig = _author_rig(layer, options.primary_path)
        _author_stage_metadata(layer, tracks, options)
        rig.SetInfo("customData", {schema.CUSTOM_DATA: _custom_data(tracks, options)})
        _author_asset(rig, space, name)
        rig.SetInfo("variantSetNames", Sdf.StringListOp.Create(prependedItems=[schema.VARIANT_SET]))
        rig.variantSelections[schema.VARIANT_SET] = str(options.representation)
        _author_lobes(author, rig, tracks.names, lobes)
        variants = Sdf.VariantSetSpec(rig, schema.VARIANT_SET)
        in_cards, in_distant, in_dome = (
            _lobes_in_variant(Sdf.VariantSpec(variants, str(representation)).primSpec, tracks.names)
            for representation in Representation
        )
        offset = Gf.Vec3d(0, 0, options.card_distance)
        _author_cards(author, in_cards, lobes.form, cards.values(lobes, offset[2]), offset)
        _author_distants(author, in_distant, lobes.form, distant.values(lobes))
        _author_dome(author, in_dome, textures, space)
    return layer, author


def continuous(lobes: Lobes) -> Lobes:
    """Return the lobes in float64 on the CPU, frames orthonormal and continuous in time."""
    lobes = lobes.to("cpu", torch.float64)
    return frames.continuous(replace(lobes, axes=frames.orthonormal(lobes.axes)))


def lobe_tracks(lobes: Lobes) -> dict[str, Tensor]:
    """Return the attributes that say what each lobe is.

    Args:
        lobes: Lobes of F frames, continuous in time.  [F, N, .]

    Returns:
        Quaternions [F, N, 4], sharpness [F, N, 2] and amplitude [F, N, 3].
    """
    return {
        schema.ORIENT: frames.continuous_quaternions(frames.quaternion_from_axes(lobes.axes)),
        schema.SHARPNESS: lobes.sharpness,
        schema.AMPLITUDE: lobes.amplitude,
    }


def author_textures(author: TrackAuthor, dome: Sdf.PrimSpec, textures: Sequence[str]) -> None:
    """Author which image the dome shows: one for each frame, or one for all."""
    moving = len(textures) > 1
    paths = list(textures) if moving else [textures[0]] * len(author.frames)
    keep = np.full(len(author.frames), moving)
    author.held(dome, schema.TEXTURE, [Sdf.AssetPath(path) for path in paths], keep)


def metadata_text(tracks: LobeTracks) -> str:
    """Return the fit's metadata as one JSON string.

    USD dictionaries hold neither None nor lists of mixed values.
    """
    return json.dumps(dict(tracks.metadata), allow_nan=False, ensure_ascii=False)


def _author_rig(layer: Sdf.Layer, path: str) -> Sdf.PrimSpec:
    """Define the rig, and an Xform for each prim above it."""
    rig = Sdf.CreatePrimInLayer(layer, path)
    for prefix in rig.path.GetPrefixes():
        prim = layer.GetPrimAtPath(prefix)
        prim.specifier, prim.typeName = Sdf.SpecifierDef, "Xform"
    return rig


def _author_stage_metadata(layer: Sdf.Layer, tracks: LobeTracks, options: StageOptions) -> None:
    layer.defaultPrim = layer.rootPrims[0].name
    layer.pseudoRoot.SetInfo(schema.UP_AXIS, options.up_axis)
    layer.pseudoRoot.SetInfo("metersPerUnit", options.meters_per_unit)
    layer.timeCodesPerSecond = layer.framesPerSecond = tracks.fps
    layer.startTimeCode = tracks.frames[0]
    layer.endTimeCode = tracks.frames[-1]


def _author_asset(rig: Sdf.PrimSpec, space: Space, name: str) -> None:
    """Say which asset the rig is, and what the colours of everything below it mean."""
    identifier = Sdf.AssetPath(f"./{name}")
    rig.SetInfo("assetInfo", {"identifier": identifier, "name": PurePath(name).stem})
    rig.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[schema.COLORSPACE_API]))
    constant(rig, schema.COLORSPACE, space.colorspace)


def _custom_data(tracks: LobeTracks, options: StageOptions) -> dict[str, Any]:
    """Return the rig's custom data.

    The frames are listed only where some are missing between the first and the last.
    """
    data: dict[str, Any] = {
        "version": schema.FORMAT_VERSION,
        schema.UP_AXIS: options.up_axis,
        schema.DISTANCE: options.card_distance,
        "metadata": metadata_text(tracks),
    }
    first, last = tracks.frames[0], tracks.frames[-1]
    if len(tracks.frames) != last - first + 1:
        data["frames"] = Vt.IntArray(tracks.frames)
    return data


def _author_lobes(
    author: TrackAuthor, rig: Sdf.PrimSpec, names: Sequence[str], lobes: Lobes
) -> None:
    scope = Sdf.PrimSpec(rig, schema.LOBES, Sdf.SpecifierDef, "Scope")
    tracks = lobe_tracks(lobes)
    for index, name in enumerate(names):
        lobe = Sdf.PrimSpec(scope, name, Sdf.SpecifierDef)
        lobe.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[schema.LOBE_API]))
        constant(lobe, schema.FORM, str(lobes.form))
        authored = [
            author.track(lobe, attribute, tracks[attribute][:, index], LOBE_TOLERANCE)
            for attribute in schema.LOBE_TRACKS
        ]
        author_digest(lobe, digest_of_values(authored))


def _author_cards(
    author: TrackAuthor,
    lobes: Sequence[Sdf.PrimSpec],
    form: Form,
    values: Mapping[str, Tensor],
    offset: Gf.Vec3d,
) -> None:
    for index, lobe in enumerate(lobes):
        for light, ops in _lights(lobe, form, "RectLight"):
            constant(light, schema.TRANSLATE, offset)
            constant(light, schema.OP_ORDER, [*ops, schema.TRANSLATE])
            constant(light, schema.NORMALIZE, False)
            for attribute, tensor in values.items():
                author.track(light, attribute, tensor[:, index], LIGHT_TOLERANCE)


def _author_distants(
    author: TrackAuthor,
    lobes: Sequence[Sdf.PrimSpec],
    form: Form,
    values: Mapping[str, Tensor],
) -> None:
    for index, lobe in enumerate(lobes):
        for light, ops in _lights(lobe, form, "DistantLight"):
            constant(light, schema.OP_ORDER, ops)
            constant(light, schema.NORMALIZE, True)
            for attribute, tensor in values.items():
                author.track(light, attribute, tensor[:, index], LIGHT_TOLERANCE)


def _author_dome(
    author: TrackAuthor, lobes: Sequence[Sdf.PrimSpec], textures: Sequence[str], space: Space
) -> None:
    variant = lobes[0].nameParent.nameParent
    for lobe in lobes:
        lobe.typeName = "Xform"
        constant(lobe, schema.OP_ORDER, [schema.ORIENT])
    dome = Sdf.PrimSpec(variant, schema.DOME, Sdf.SpecifierDef, "DomeLight")
    constant(dome, schema.INTENSITY, 1.0)
    constant(dome, schema.COLOR, Gf.Vec3f(1))
    constant(dome, schema.TEXTURE_FORMAT, "latlong")
    author_textures(author, dome, textures)
    if space.up_axis == "Z":  # a DomeLight has its pole at +Y, whatever is up
        constant(dome, schema.ROTATE_DOME, 90.0)
        constant(dome, schema.OP_ORDER, [schema.ROTATE_DOME])


def _lobes_in_variant(variant: Sdf.PrimSpec, names: Sequence[str]) -> list[Sdf.PrimSpec]:
    scope = Sdf.PrimSpec(variant, schema.LOBES, Sdf.SpecifierOver)
    return [Sdf.PrimSpec(scope, name, Sdf.SpecifierOver) for name in names]


def _lights(lobe: Sdf.PrimSpec, form: Form, type_name: str) -> list[tuple[Sdf.PrimSpec, list[str]]]:
    """Make a lobe's lights: the lobe's own prim, or for an antipodal lobe one child a side.

    Returns:
        Each light with the transform ops that turn it towards its side.
    """
    if form is not Form.BINGHAM:
        lobe.typeName = type_name
        return [(lobe, [schema.ORIENT])]
    lobe.typeName = "Xform"
    constant(lobe, schema.OP_ORDER, [schema.ORIENT])
    front, back = (Sdf.PrimSpec(lobe, side, Sdf.SpecifierDef, type_name) for side in schema.SIDES)
    constant(back, schema.ORIENT_BACK, FLIP)
    return [(front, []), (back, [schema.ORIENT_BACK])]
