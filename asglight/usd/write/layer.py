# SPDX-License-Identifier: Apache-2.0
"""The stage as a layer: the rig, its lobes, and their lights in each representation asked for.

Several representations are the variants of a set; what a lobe is (orientation, sharpness,
amplitude, form) lies outside them, so every one turns with it and a reader needs none of them. One
alone is said on the same prims, so that a reader needs to know no variants. Lights are derived
values.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf
from torch import Tensor

from asglight.lobes import LobeTracks, frames
from asglight.lobes.data import Lobes
from asglight.lobes.motion import exact
from asglight.threads import beside, one_thread
from asglight.usd import schema
from asglight.usd.digest import author_digest, digest_of_values
from asglight.usd.lights import cards, distant
from asglight.usd.lights.light import Light
from asglight.usd.options import KeyLights, StageOptions
from asglight.usd.schema import Representation
from asglight.usd.spaces import Space, space_for, to_stage
from asglight.usd.write.authoring import TrackAuthor, constant
from asglight.usd.write.between import SampledLobe, Shot
from asglight.usd.write.keys import WrittenKeys
from asglight.usd.write.stage_metadata import author_asset, author_stage_metadata, custom_data
from asglight.usd.write.staging import relative_names

LOBE_TOLERANCE = 1e-6
"""Relative. A lobe comes back to float32 rounding, about ten units in the last place."""

LIGHT_TOLERANCE = 1e-4
"""Relative. Lights are derived from lobes: four such errors, in width, height, intensity and
colour, change a card's flux by 4e-4, a fifth of what the shape of the best cards costs, and only
where a track bends so little that its samples are left out."""


SLANT_TOLERANCE = 1e-6
"""Relative, of the slant of a key, which its lights are derived from."""

KEY_TOLERANCE = 1e-5
"""Relative, likewise of a key: with the rest it is to have the flux of the images to 1e-4."""


class Images(NamedTuple):
    """The images of a stage, by paths relative to it.

    Attributes:
        dome: One for each frame, or one for all; empty where the stage holds no dome.
        fill: Those of the lobes that are fill, likewise; empty where no lobe is.
        card: The texture of the cards; empty where none has one.
    """

    dome: Sequence[str] = ()
    fill: Sequence[str] = ()
    card: str = ""


@one_thread()  # blocks are small: threads wait for each other longer than they work
def build(
    tracks: LobeTracks,
    options: StageOptions,
    images: Images,
    name: str,
    kinds: Sequence[cards.Kind],
    keys: WrittenKeys | None = None,
) -> tuple[Sdf.Layer, TrackAuthor]:
    """Author the whole stage.

    Args:
        tracks: Lobes of all frames.
        options: What the stage shows, and where.
        images: What the lights show.
        name: Of the layer's file.
        kinds: What each lobe is in the cards.
        keys: Those of the shot, where the stage shows them.

    Returns:
        An anonymous layer, and the author with its sample counts.
    """
    layer = Sdf.Layer.CreateAnonymous(".usda")
    author = TrackAuthor(tracks.frames)
    space = space_for(options)
    lobes = continuous(to_stage(tracks.lobes, space))
    shot = Shot(lobes, author.frames)
    finding = [partial(_lights, shot, one, tracks, options, images, kinds) for one in options.held]
    with beside(finding) as found, Sdf.ChangeBlock():
        rig = _author_rig(layer, options.primary_path)
        author_stage_metadata(layer, tracks, options)
        rig.SetInfo("customData", {schema.CUSTOM_DATA: custom_data(tracks, options)})
        author_asset(rig, space, name)
        if len(options.held) > 1:
            _author_selection(rig, options)
        scope = Sdf.PrimSpec(rig, schema.LOBES, Sdf.SpecifierDef, "Scope")
        author_in(author, scope, tracks.names, shot.of_lobes())
        author_display_names(scope, tracks.names, tracks.display_names)
        holders = _holders(rig, options)
        for representation, lights in zip(options.held, found(), strict=True):
            holder = holders[representation]
            if representation is Representation.KEYS and keys is not None:
                _author_keys(author, holder, keys, options, space)
            kind = schema.LIGHT_TYPES[representation]
            author_lights(author, holder, kind, tracks.names, lights)
            if representation is Representation.CARDS and cards.Kind.FILL in kinds:
                _author_dome(author, holder, schema.FILL, images.fill, space)
            if representation is Representation.DOME:
                _author_dome(author, holder, schema.DOME, images.dome, space)
    return layer, author


def _lights(
    shot: Shot,
    representation: Representation,
    tracks: LobeTracks,
    options: StageOptions,
    images: Images,
    kinds: Sequence[cards.Kind],
) -> "list[TimedLights]":
    """Return the lights of every lobe in a representation; in a dome they have none."""
    if representation is Representation.CARDS:
        return card_lights(shot, options.card_distance, kinds, images.card)
    if representation is Representation.DISTANT:
        return distant_lights(shot, distant.threefold(tracks.lobes, options.distant_lights))
    return [((), np.asarray(tracks.frames, dtype=np.float64))] * tracks.lobes.count


def continuous(lobes: Lobes, *, keeps_first: bool = False) -> Lobes:
    """Return the lobes in float64 on the CPU, frames orthonormal and continuous in time.

    Args:
        lobes: Over time.  [F, N, .]
        keeps_first: As of `frames.continuous`: edits keep what is width and what is height, and
            with them a key's texture.
    """
    return frames.continuous(exact(lobes), keeps_first=keeps_first)


def lobe_tracks(one: SampledLobe) -> dict[str, tuple[Tensor, NDArray[np.float64]]]:
    """Return the attributes that say what a lobe is, and the times of each.

    Returns:
        Quaternions [T, 4], sharpness [T, 2] and amplitude [T, 3].
    """
    turns, shape = one.turns, one.shape
    quaternions = frames.quaternion_from_axes(turns.lobes.axes)
    return {
        schema.ORIENT: (frames.continuous_quaternions(quaternions)[:, 0], turns.times),
        schema.SHARPNESS: (shape.lobes.sharpness[:, 0], shape.times),
        schema.AMPLITUDE: (shape.lobes.amplitude[:, 0], shape.times),
    }


def slant_tracks(lobes: Lobes) -> dict[str, Tensor]:
    """Return the attributes that say how the card of a key is slanted; none where it never is.

    Args:
        lobes: One key in T samples.  [T, 1, .]
    """
    if lobes.slant is None or not bool((lobes.slant != 0).any()):
        return {}
    return dict(zip(schema.SLANT_TRACKS, lobes.slant.split([2, 3, 2], -1), strict=True))


TimedLights = tuple[Sequence[Light], NDArray[np.float64]]
"""The lights of one lobe, and the times of their samples."""


def card_lights(
    shot: Shot, distance: float, kinds: Sequence[cards.Kind], texture: str = ""
) -> list[TimedLights]:
    """Return the cards of every lobe, with samples between frames.

    Args:
        shot: The lobes.
        distance: From the origin to the cards, in stage units.
        kinds: What each lobe is.
        texture: That of the cards, relative to the stage; empty where there is none.
    """
    return [
        (cards.lights(one.lobes, one.moments, distance, [kind], texture)[0], one.times)
        for one, kind in zip(shot.of_cards(kinds), kinds, strict=True)
    ]


def distant_lights(shot: Shot, threefold: Sequence[bool]) -> list[TimedLights]:
    """Return the distant lights of every lobe, with samples between frames.

    Args:
        shot: The lobes.
        threefold: Which have three lights.
    """
    return [
        (distant.lights(one.lobes, one.moments, [is_three])[0], one.times)
        for one, is_three in zip(shot.of_distant(threefold), threefold, strict=True)
    ]


def author_textures(author: TrackAuthor, dome: Sdf.PrimSpec, textures: Sequence[str]) -> None:
    """Author which image the dome shows: one for each frame, or one for all."""
    moving = len(textures) > 1
    paths = list(textures) if moving else [textures[0]] * len(author.frames)
    keep = np.full(len(author.frames), moving)
    author.held(dome, schema.TEXTURE, [Sdf.AssetPath(path) for path in paths], keep)


def _author_rig(layer: Sdf.Layer, path: str) -> Sdf.PrimSpec:
    """Define the rig, and an Xform for each prim above it."""
    rig = Sdf.CreatePrimInLayer(layer, path)
    for prefix in rig.path.GetPrefixes():
        prim = layer.GetPrimAtPath(prefix)
        prim.specifier, prim.typeName = Sdf.SpecifierDef, "Xform"
    return rig


def _author_selection(rig: Sdf.PrimSpec, options: StageOptions) -> None:
    rig.SetInfo("variantSetNames", Sdf.StringListOp.Create(prependedItems=[schema.VARIANT_SET]))
    rig.variantSelections[schema.VARIANT_SET] = str(options.shown)


def _holders(rig: Sdf.PrimSpec, options: StageOptions) -> dict[Representation, Sdf.PrimSpec]:
    """Return where the lights of each representation are said: a variant each, or the rig."""
    if len(options.held) == 1:
        return {options.shown: rig}
    variants = Sdf.VariantSetSpec(rig, schema.VARIANT_SET)
    return {one: Sdf.VariantSpec(variants, str(one)).primSpec for one in options.held}


def author_display_names(
    scope: Sdf.PrimSpec, names: Sequence[str], called: Mapping[str, str]
) -> None:
    """Say what a person calls lobes or keys: USD's `displayName`, which other programs show."""
    for name, shown in called.items():
        if name in names:
            _child(scope, name).SetInfo(schema.DISPLAY_NAME, shown)


def author_in(
    author: TrackAuthor, scope: Sdf.PrimSpec, names: Sequence[str], lobes: Sequence[SampledLobe]
) -> None:
    """Author what lobes are, as prims of a scope."""
    for name, one in zip(names, lobes, strict=True):
        lobe = Sdf.PrimSpec(scope, name, Sdf.SpecifierDef)
        lobe.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[schema.LOBE_API]))
        constant(lobe, schema.FORM, str(one.shape.lobes.form))
        authored = [
            author.track(lobe, attribute, values, LOBE_TOLERANCE, times)
            for attribute, (values, times) in lobe_tracks(one).items()
        ]
        for attribute, values in slant_tracks(one.shape.lobes).items():
            times = one.shape.times
            authored.append(author.track(lobe, attribute, values[:, 0], SLANT_TOLERANCE, times))
        author_digest(lobe, digest_of_values(authored))


def author_lights(
    author: TrackAuthor,
    holder: Sdf.PrimSpec,
    type_name: str,
    names: Sequence[str],
    lights: Sequence[TimedLights],
) -> None:
    """Author the lights of every lobe; a lobe without one is data.

    In a variant a lobe says once more that it has the op that it orders, without a value: readers
    that look at a prim before they compose it find the op there.
    """
    scope = _child(holder, schema.LOBES)
    for name, (own, times) in zip(names, lights, strict=True):
        lobe = _child(scope, name)
        if lobe.specifier == Sdf.SpecifierOver:
            Sdf.AttributeSpec(lobe, schema.ORIENT, schema.VALUE_TYPES[schema.ORIENT])
        if not any(light.name == "" for light in own):
            lobe.typeName = "Xform"
            constant(lobe, schema.OP_ORDER, [schema.ORIENT])
        for light in own:
            _author_light(author, lobe, type_name, light, times)


def _child(parent: Sdf.PrimSpec, name: str) -> Sdf.PrimSpec:
    """Return a prim below another; in a variant, which has none yet, an override of it."""
    found = parent.layer.GetPrimAtPath(parent.path.AppendChild(name))
    return found or Sdf.PrimSpec(parent, name, Sdf.SpecifierOver)


def _author_light(
    author: TrackAuthor,
    lobe: Sdf.PrimSpec,
    type_name: str,
    light: Light,
    times: NDArray[np.float64],
    tolerance: float = LIGHT_TOLERANCE,
) -> None:
    if light.name:
        prim, ops = Sdf.PrimSpec(lobe, light.name, Sdf.SpecifierDef, type_name), light.ops
    else:
        prim, ops = lobe, (schema.ORIENT, *light.ops)
        lobe.typeName = type_name
    for attribute, value in light.constants.items():
        constant(prim, attribute, value)
    constant(prim, schema.OP_ORDER, list(ops))
    for attribute, tensor in light.tracks.items():
        author.track(prim, attribute, tensor, tolerance, times)


def _author_keys(
    author: TrackAuthor,
    holder: Sdf.PrimSpec,
    keys: WrittenKeys,
    options: StageOptions,
    space: Space,
) -> None:
    """Author the lights of the keys, and the rest."""
    scope = Sdf.PrimSpec(holder, schema.KEYS, Sdf.SpecifierDef, "Scope")
    if keys.lobes is not None:
        shot = Shot(continuous(to_stage(keys.lobes, space)), author.frames)
        author_in(author, scope, keys.names, shot.of_lobes())
        count = len(keys.names)
        if keys.lights is KeyLights.DISTANT:
            lights = distant_lights(shot, [False] * count)
        else:
            lights = card_lights(shot, options.card_distance, [cards.Kind.SINGLE] * count)
        kind = schema.KEY_TYPES[keys.lights]
        author_display_names(scope, keys.names, keys.display_names)
        author_key_lights(author, scope, kind, keys.names, lights)
        for name, images in zip(keys.names, keys.textures, strict=True):
            if images:
                author_textures(author, _child(scope, name), relative_names(images))
    _author_dome(author, holder, schema.REST, relative_names(keys.rest), space)


def author_key_lights(
    author: TrackAuthor,
    scope: Sdf.PrimSpec,
    type_name: str,
    names: Sequence[str],
    lights: Sequence[TimedLights],
) -> None:
    """Author the light of every key, whose prims there are."""
    for name, (own, times) in zip(names, lights, strict=True):
        for light in own:
            _author_light(author, _child(scope, name), type_name, light, times, KEY_TOLERANCE)


def _author_dome(
    author: TrackAuthor, holder: Sdf.PrimSpec, name: str, textures: Sequence[str], space: Space
) -> None:
    dome = Sdf.PrimSpec(holder, name, Sdf.SpecifierDef, "DomeLight")
    constant(dome, schema.INTENSITY, 1.0)
    constant(dome, schema.COLOR, Gf.Vec3f(1))
    constant(dome, schema.TEXTURE_FORMAT, "latlong")
    author_textures(author, dome, textures)
    if space.up_axis == "Z":  # a DomeLight has its pole at +Y, whatever is up
        constant(dome, schema.ROTATE_DOME, 90.0)
        constant(dome, schema.OP_ORDER, [schema.ROTATE_DOME])
