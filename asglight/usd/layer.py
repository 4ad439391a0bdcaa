# SPDX-License-Identifier: Apache-2.0
"""The stage as a layer: the rig, its lobes, and a variant for each representation.

What a lobe is (orientation, sharpness, amplitude, form) lies outside the variants, so every
representation turns with it and a reader needs none of them. Lights are derived values.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from pxr import Gf, Sdf, Vt
from torch import Tensor

from asglight.lobes import LobeTracks, frames
from asglight.lobes.data import Form, Lobes
from asglight.usd import cards, distant, schema
from asglight.usd.authoring import TrackAuthor, constant
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space, to_stage

LOBE_TOLERANCE = 1e-6
"""Relative. A lobe comes back to float32 rounding, about ten units in the last place."""

LIGHT_TOLERANCE = 2e-5
"""Relative. Lights are derived from lobes: four such errors, in width, height, intensity and
colour, change a card's flux by 8e-5, a thirtieth of what the shape of the best card costs."""

FLIP = Gf.Quatf(0, 1, 0, 0)
"""Half a turn about x: from the front of a bingham lobe to its back."""


@dataclass(frozen=True)
class Placement:
    """Where the stage stands and what it shows.

    Attributes:
        representation: The variant that is selected.
        distance: Of the cards from the origin, in stage units.
        meters_per_unit: Length of a stage unit.
        textures: Dome images relative to the layer: one for each frame, or one for all.
        space: Of the stage's numbers.
    """

    representation: Representation
    distance: float
    meters_per_unit: float
    textures: Sequence[str]
    space: Space = field(default_factory=Space)


def build(tracks: LobeTracks, placement: Placement) -> tuple[Sdf.Layer, TrackAuthor]:
    """Author the whole stage.

    Returns:
        An anonymous layer, and the author with its sample counts.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    author = TrackAuthor(tracks.frames)
    lobes = continuous(to_stage(tracks.lobes, placement.space))
    with Sdf.ChangeBlock():
        _author_stage_metadata(layer, tracks, placement)
        rig = Sdf.PrimSpec(layer, schema.RIG, Sdf.SpecifierDef, "Xform")
        rig.SetInfo("customData", {schema.CUSTOM_DATA: _custom_data(tracks, placement.space)})
        rig.SetInfo("variantSetNames", Sdf.StringListOp.Create(prependedItems=[schema.VARIANT_SET]))
        rig.variantSelections[schema.VARIANT_SET] = str(placement.representation)
        _author_lobes(author, rig, lobes)
        variants = Sdf.VariantSetSpec(rig, schema.VARIANT_SET)
        in_cards, in_distant, in_dome = (
            Sdf.VariantSpec(variants, str(representation)).primSpec
            for representation in Representation
        )
        card_values = cards.values(lobes, placement.distance)
        offset = Gf.Vec3d(0, 0, placement.distance)
        _author_cards(author, in_cards, lobes.form, card_values, offset)
        _author_distants(author, in_distant, lobes.form, distant.values(lobes))
        _author_dome(author, in_dome, lobes.count, placement)
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


def _author_stage_metadata(layer: Sdf.Layer, tracks: LobeTracks, placement: Placement) -> None:
    layer.defaultPrim = schema.RIG
    layer.pseudoRoot.SetInfo(schema.UP_AXIS, placement.space.up_axis)
    layer.pseudoRoot.SetInfo("metersPerUnit", placement.meters_per_unit)
    layer.timeCodesPerSecond = layer.framesPerSecond = tracks.fps
    layer.startTimeCode = tracks.frames[0]
    layer.endTimeCode = tracks.frames[-1]


def _custom_data(tracks: LobeTracks, space: Space) -> dict[str, Any]:
    """Return the rig's custom data.

    The frames are listed only where some are missing between the first and the last.
    """
    data: dict[str, Any] = {
        "version": schema.FORMAT_VERSION,
        schema.UP_AXIS: space.up_axis,
        "metadata": metadata_text(tracks),
    }
    first, last = tracks.frames[0], tracks.frames[-1]
    if len(tracks.frames) != last - first + 1:
        data["frames"] = Vt.IntArray(tracks.frames)
    return data


def _author_lobes(author: TrackAuthor, rig: Sdf.PrimSpec, lobes: Lobes) -> None:
    scope = Sdf.PrimSpec(rig, schema.LOBES, Sdf.SpecifierDef, "Scope")
    tracks = lobe_tracks(lobes)
    for index, name in enumerate(schema.lobe_names(lobes.count)):
        lobe = Sdf.PrimSpec(scope, name, Sdf.SpecifierDef)
        lobe.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[schema.LOBE_API]))
        constant(lobe, schema.FORM, str(lobes.form))
        for attribute, values in tracks.items():
            author.track(lobe, attribute, values[:, index], LOBE_TOLERANCE)


def _author_cards(
    author: TrackAuthor,
    variant: Sdf.PrimSpec,
    form: Form,
    values: Mapping[str, Tensor],
    offset: Gf.Vec3d,
) -> None:
    count = values[schema.WIDTH].shape[1]
    for index, lobe in enumerate(_override_lobes(variant, count)):
        for light, ops in _lights(lobe, form, "RectLight"):
            constant(light, schema.TRANSLATE, offset)
            constant(light, schema.OP_ORDER, [*ops, schema.TRANSLATE])
            constant(light, schema.NORMALIZE, False)
            for attribute, tensor in values.items():
                author.track(light, attribute, tensor[:, index], LIGHT_TOLERANCE)


def _author_distants(
    author: TrackAuthor, variant: Sdf.PrimSpec, form: Form, values: Mapping[str, Tensor]
) -> None:
    count = values[schema.ANGLE].shape[1]
    for index, lobe in enumerate(_override_lobes(variant, count)):
        for light, ops in _lights(lobe, form, "DistantLight"):
            constant(light, schema.OP_ORDER, ops)
            constant(light, schema.NORMALIZE, True)
            for attribute, tensor in values.items():
                author.track(light, attribute, tensor[:, index], LIGHT_TOLERANCE)


def _author_dome(
    author: TrackAuthor, variant: Sdf.PrimSpec, count: int, placement: Placement
) -> None:
    for lobe in _override_lobes(variant, count):
        lobe.typeName = "Xform"
        constant(lobe, schema.OP_ORDER, [schema.ORIENT])
    dome = Sdf.PrimSpec(variant, schema.DOME, Sdf.SpecifierDef, "DomeLight")
    constant(dome, schema.INTENSITY, 1.0)
    constant(dome, schema.COLOR, Gf.Vec3f(1))
    constant(dome, schema.TEXTURE_FORMAT, "latlong")
    author_textures(author, dome, placement.textures)
    if placement.space.up_axis == "Z":  # a DomeLight has its pole at +Y, whatever is up
        constant(dome, schema.ROTATE_DOME, 90.0)
        constant(dome, schema.OP_ORDER, [schema.ROTATE_DOME])


def _override_lobes(variant: Sdf.PrimSpec, count: int) -> list[Sdf.PrimSpec]:
    scope = Sdf.PrimSpec(variant, schema.LOBES, Sdf.SpecifierOver)
    return [Sdf.PrimSpec(scope, name, Sdf.SpecifierOver) for name in schema.lobe_names(count)]


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
