# SPDX-License-Identifier: Apache-2.0
"""Edited keys as a layer over the stage that was edited, whose own files stay as they are.

It is what `edit_layer.py` is for lobes: for the keys that were edited the layer says what they are,
and their lights. The rest stays the stage's, for a key that moves leaves its hole filled.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import torch
from pxr import Sdf, Usd

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.check.lint import lint_stage
from asglight.usd.check.trust import our_own
from asglight.usd.digest import author_digest, digest_of_prim
from asglight.usd.lights.cards import Kind
from asglight.usd.options import KeyLights, StageOptions
from asglight.usd.read.keys import read_keys
from asglight.usd.read.placement import as_written, placement_of
from asglight.usd.read.read_options import options_of
from asglight.usd.schema import Representation
from asglight.usd.spaces import space_for, to_stage
from asglight.usd.stage import lobe_prims, open_rig, place_of, readable, show
from asglight.usd.write import layer, staging
from asglight.usd.write.authoring import TrackAuthor, constant
from asglight.usd.write.between import Shot
from asglight.usd.write.checks import check_target, check_tracks
from asglight.usd.write.edit_layer import LAYER_SUFFIXES
from asglight.usd.write.over_stage import reference, with_metadata
from asglight.usd.write.staging import WriteReport


def write_key_edits(
    path: str | Path, source: str | Path, tracks: LobeTracks, edited: Collection[int]
) -> WriteReport:
    """Write the edits of a stage's keys as a layer over that stage.

    `read_keys` of the layer gives the edited keys. The stage is referred to relatively where both
    lie on one drive; it may be such a layer itself.

    Args:
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates.
        source: The stage that was edited.
        tracks: Its keys with the edits, in the order of `read_keys`.
        edited: Indices of the keys that were edited.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights or are not the keys of the stage, the target is a
            file of the stage, or nothing can be written there.
    """
    path, source = Path(path), Path(source)
    check_tracks(tracks)
    check_target(path, LAYER_SUFFIXES)
    _check_same(source, tracks, edited)
    stage, rig = open_rig(source)
    stage.SetEditTarget(stage.GetSessionLayer())
    _check_apart(path, stage, source)
    options = options_of(rig)
    with staging.staged(path) as place, our_own():
        with readable(source):
            show(rig, Representation.KEYS)
            in_rig = as_written(tracks, placement_of(rig, tracks.frames))
            prims = lobe_prims(rig, schema.KEYS)
            built, author, paths = _built(rig, prims, options, in_rig, sorted(edited))
        built.subLayerPaths = [reference(source, place.parent)]
        staging.export(built, place)
        composed, shown_rig = open_rig(place)
        composed.SetEditTarget(composed.GetSessionLayer())
        show(shown_rig, Representation.KEYS)
        for key in paths:
            digest = digest_of_prim(composed.GetPrimAtPath(key.StripAllVariantSelections()))
            author_digest(Sdf.CreatePrimInLayer(built, key), digest)
        staging.export(built, place)
        own = set(lint_stage(place)) - set(lint_stage(source))
        if own:
            raise RuntimeError(f"the layer breaks the stage's contract: {sorted(own)}")
        built.subLayerPaths = [reference(source, path.parent)]
        staging.export(built, place)
        return staging.move_into_place(place, path, [], author)


def _built(
    rig: Usd.Prim,
    prims: list[Usd.Prim],
    options: StageOptions,
    tracks: LobeTracks,
    chosen: list[int],
) -> tuple[Sdf.Layer, TrackAuthor, list[Sdf.Path]]:
    """Author the chosen keys and their lights; return the paths of the keys in the layer too."""
    built = with_metadata(rig.GetStage().GetRootLayer())
    author = TrackAuthor(tracks.frames)
    lobes = tracks.lobes.select(torch.tensor(chosen, dtype=torch.long))
    shot = Shot(
        layer.continuous(to_stage(lobes, space_for(options))),
        np.asarray(tracks.frames, dtype=np.float64),
    )
    is_distant = any(one.GetTypeName() == schema.KEY_TYPES[KeyLights.DISTANT] for one in prims)
    lights = (
        layer.distant_lights(shot, [False] * len(chosen))
        if is_distant
        else layer.card_lights(shot, options.card_distance, [Kind.SINGLE] * len(chosen))
    )
    scope = place_of(rig, Representation.KEYS).AppendChild(schema.KEYS)
    paths = [scope.AppendChild(prims[index].GetName()) for index in chosen]
    for path, one, (of_key, times) in zip(paths, shot.of_lobes(), lights, strict=True):
        prim = Sdf.CreatePrimInLayer(built, path)
        for name, values in layer.lobe_tracks(one.lobes).items():
            author.track(prim, name, values[:, 0], layer.LOBE_TOLERANCE, one.times)
        for name, values in layer.slant_tracks(one.lobes).items():
            author.track(prim, name, values[:, 0], layer.SLANT_TOLERANCE, one.times)
        for light in of_key:
            constant(prim, schema.OP_ORDER, [schema.ORIENT, *light.ops])
            for name, values in light.tracks.items():
                author.track(prim, name, values, layer.KEY_TOLERANCE, times)
    return built, author, paths


def _check_same(source: Path, tracks: LobeTracks, edited: Collection[int]) -> None:
    """Check that the stage is the one whose keys were edited."""
    keys = read_keys(source)
    held = None if keys is None else keys.tracks
    same = (
        held is not None
        and held.frames == tracks.frames
        and held.names == tracks.names
        and all(
            torch.equal(one[:, index], other[:, index])
            for index in range(tracks.lobes.count)
            if index not in set(edited)
            for one, other in (
                (held.lobes.axes, tracks.lobes.axes),
                (held.lobes.sharpness, tracks.lobes.sharpness),
                (held.lobes.amplitude, tracks.lobes.amplitude),
            )
        )
    )
    if not same:
        raise InputError(
            f"{shown(source)}: does not hold the keys that were edited; expected the stage as it "
            "was read. If it was written anew since, open it again."
        )


def _check_apart(path: Path, stage: Usd.Stage, source: Path) -> None:
    """Check that no layer of the stage would be replaced."""
    layers = [Path(used.realPath) for used in stage.GetUsedLayers() if used.realPath]
    if path.exists() and any(path.samefile(used) for used in layers):
        raise InputError(
            f"{shown(path)}: would replace files of {shown(source)}, which is edited; expected "
            "another name or folder."
        )
