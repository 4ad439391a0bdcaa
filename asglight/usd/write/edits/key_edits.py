# SPDX-License-Identifier: Apache-2.0
"""Edited keys as a layer over the stage that was edited, whose own files stay as they are.

It is what `edit_layer.py` is for lobes: for the keys that were edited the layer says what they are,
and their lights; a key that is muted is invisible, one that is deleted is inactive, one that was
added is a prim of the layer, and a new name is a `displayName` (edited_lobes.py). The rest stays
the stage's, for a key that moves leaves its hole filled: the light of one that is deleted is gone.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from pxr import Sdf, Usd

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
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
from asglight.usd.stage import child_of, key_lights, lobe_prims, open_rig, place_of, readable, show
from asglight.usd.write import layer, staging
from asglight.usd.write.authoring import TrackAuthor, constant
from asglight.usd.write.between import Shot
from asglight.usd.write.checks import check_images_apart, check_target, check_tracks
from asglight.usd.write.edits.edit_layer import LAYER_SUFFIXES
from asglight.usd.write.edits.edited_lobes import (
    LobeChanges,
    author_prims,
    author_states,
    free_names,
)
from asglight.usd.write.edits.over_stage import reference, with_metadata
from asglight.usd.write.staging import WriteReport


class _Source:
    """The keyed stage that was edited, as it is on disk; it shows its keys.

    Attributes:
        path: The stage.
        stage: Its composition.
        rig: The prim that holds the keys.
        tracks: Its keys, those that are muted as they would light; None where it has none.
        muted: Indices of the muted ones.
        prims: Those of the keys.
        options: How the stage was written.
    """

    def __init__(self, path: Path) -> None:
        """Read the stage.

        Raises:
            InputError: There is no such stage, or a value is damaged.
        """
        self.path = path
        keys = read_keys(path)
        self.tracks = None if keys is None else keys.unmuted
        self.muted = frozenset[int]() if keys is None else keys.muted
        self.frames = () if keys is None else keys.times
        self.stage, self.rig = open_rig(path)
        self.stage.SetEditTarget(self.stage.GetSessionLayer())
        self.options = options_of(self.rig)
        with readable(path):
            show(self.rig, Representation.KEYS)
            self.prims = lobe_prims(self.rig, schema.KEYS)

    @property
    def count(self) -> int:
        """How many keys there are."""
        return 0 if self.tracks is None else self.tracks.lobes.count

    @property
    def scope(self) -> Sdf.Path:
        """Where a layer says what keys are."""
        return place_of(self.rig, Representation.KEYS).AppendChild(schema.KEYS)

    @property
    def paths(self) -> list[Sdf.Path]:
        """Where it says it of each."""
        return [self.scope.AppendChild(prim.GetName()) for prim in self.prims]

    def is_same(self, tracks: LobeTracks, index: int) -> bool:
        """Tell whether a key of the stage is to the bit what tracks have of it."""
        if self.tracks is None:
            return False
        chosen = torch.tensor([index])
        pair = stack([one.lobes.select(chosen) for one in (self.tracks, tracks)])
        held = (pair.axes, pair.sharpness, pair.amplitude, pair.slant)
        return all(one is None or torch.equal(*one) for one in held)


def write_key_edits(
    path: str | Path,
    source: str | Path,
    tracks: LobeTracks,
    edited: Collection[int],
    muted: Collection[int] | None = None,
    deleted: Collection[int] = (),
) -> WriteReport:
    """Write the edits of a stage's keys as a layer over that stage.

    `read_keys` of the layer gives the edited keys. The stage is referred to relatively where both
    lie on one drive; it may be such a layer itself.

    Args:
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates.
        source: The stage that was edited.
        tracks: Its keys with the edits: those of the stage in the order of `read_keys`, then those
            that were added. What they are called is their `display_names`.
        edited: Indices of the keys that were edited.
        muted: Indices of the keys that are muted and have their light in the tracks, as in
            `Keys.unmuted`; all others are seen. None leaves what is muted as it is, and black in
            the tracks, as in `Keys.tracks`.
        deleted: Indices of the keys that are deleted.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights or are not the keys of the stage, the target is a
            file of the stage, or nothing can be written there.
    """
    path = Path(path)
    check_tracks(tracks)
    check_target(path, LAYER_SUFFIXES)
    below = _Source(Path(source))
    if muted is None:
        muted, tracks = below.muted, _unmuted(below, tracks, edited)
    _check_same(below, tracks, edited)
    _check_apart(path, below.stage, below.path)
    check_images_apart(path)
    changes = _changes(below, tracks, frozenset(muted), frozenset(deleted))
    kept = [
        index
        for index in sorted(set(edited) - set(deleted))
        if index < below.count and not below.is_same(tracks, index)
    ]
    with staging.staged(path) as place, our_own():
        built, author = _built(below, changes, kept)
        built.subLayerPaths = [reference(below.path, place.parent)]
        staging.export(built, place)
        composed, shown_rig = open_rig(place)
        composed.SetEditTarget(composed.GetSessionLayer())
        show(shown_rig, Representation.KEYS)
        for key in (below.paths[index] for index in kept):
            digest = digest_of_prim(composed.GetPrimAtPath(key.StripAllVariantSelections()))
            author_digest(Sdf.CreatePrimInLayer(built, key), digest)
        staging.export(built, place)
        own = set(lint_stage(place)) - set(lint_stage(below.path))
        if own:
            raise RuntimeError(f"the layer breaks the stage's contract: {sorted(own)}")
        built.subLayerPaths = [reference(below.path, path.parent)]
        staging.export(built, place)
        return staging.move_into_place(place, path, [], author)


def _changes(
    below: _Source, tracks: LobeTracks, muted: frozenset[int], deleted: frozenset[int]
) -> LobeChanges:
    with readable(below.path):
        in_rig = as_written(tracks, placement_of(below.rig, tracks.frames))
    added = range(below.count, tracks.lobes.count)
    return LobeChanges(
        tracks,
        in_rig,
        tuple(index for index in added if index not in deleted),
        muted,
        deleted - set(added),
        deleted & set(added),
    )


def _built(below: _Source, changes: LobeChanges, kept: list[int]) -> tuple[Sdf.Layer, TrackAuthor]:
    """Author what became of the keys.

    Args:
        below: The stage.
        changes: What became of its keys.
        kept: Those of the stage that shine otherwise now.
    """
    built = with_metadata(below.stage.GetRootLayer())
    author = TrackAuthor(changes.tracks.frames)
    if kept:
        shot, lights = _lights(below, changes.in_rig, kept)
        of_kept = [below.paths[index] for index in kept]
        for path, one, (of_key, times) in zip(of_kept, shot.of_lobes(), lights, strict=True):
            prim = Sdf.CreatePrimInLayer(built, path)
            for name, (values, own_times) in layer.lobe_tracks(one).items():
                author.track(prim, name, values, layer.LOBE_TOLERANCE, own_times)
            shape = one.shape
            for name, values in layer.slant_tracks(shape.lobes).items():
                author.track(prim, name, values[:, 0], layer.SLANT_TOLERANCE, shape.times)
            for light in of_key:
                constant(prim, schema.OP_ORDER, [schema.ORIENT, *light.ops])
                for name, values in light.tracks.items():
                    author.track(prim, name, values, layer.KEY_TOLERANCE, times)
    if below.tracks is not None:
        author_states(built, below.paths, below.tracks, below.muted, changes)
    if changes.added:
        scope = Sdf.CreatePrimInLayer(built, below.scope)
        shot, lights = _lights(below, changes.in_rig, changes.added)
        names = free_names(child_of(below.rig, schema.KEYS), changes, "key")
        author_prims(author, scope, names, shot, changes)
        kind = schema.KEY_TYPES[key_lights(below.prims)]
        layer.author_key_lights(author, scope, kind, names, lights)
    return built, author


def _lights(
    below: _Source, in_rig: LobeTracks, chosen: Sequence[int]
) -> tuple[Shot, list[layer.TimedLights]]:
    """Return some keys over time, and their lights."""
    options: StageOptions = below.options
    lobes = in_rig.lobes.select(torch.tensor(chosen, dtype=torch.long))
    shot = Shot(
        layer.continuous(to_stage(lobes, space_for(options)), keeps_first=True),
        np.asarray(in_rig.frames, dtype=np.float64),
    )
    if key_lights(below.prims) is KeyLights.DISTANT:
        return shot, layer.distant_lights(shot, [False] * len(chosen))
    return shot, layer.card_lights(shot, options.card_distance, [Kind.SINGLE] * len(chosen))


def _unmuted(below: _Source, tracks: LobeTracks, edited: Collection[int]) -> LobeTracks:
    """Return tracks with the light of the muted keys that were not edited."""
    chosen = torch.tensor(sorted(below.muted - set(edited)), dtype=torch.long)
    if below.tracks is None or tracks.lobes.count < below.count or not len(chosen):
        return tracks
    lobes = tracks.lobes.replaced(chosen, below.tracks.lobes.select(chosen))
    return replace(tracks, lobes=lobes)


def _check_same(below: _Source, tracks: LobeTracks, edited: Collection[int]) -> None:
    """Check that the stage is the one whose keys were edited."""
    names = () if below.tracks is None else below.tracks.names
    same = (
        below.frames == tracks.frames
        and names == tracks.names[: below.count]
        and all(below.is_same(tracks, n) for n in range(below.count) if n not in set(edited))
    )
    if not same:
        raise InputError(
            f"{shown(below.path)}: does not hold the keys that were edited; expected the stage as "
            "it was read. If it was written anew since, open it again."
        )


def _check_apart(path: Path, stage: Usd.Stage, source: Path) -> None:
    """Check that no layer of the stage would be replaced."""
    layers = [Path(used.realPath) for used in stage.GetUsedLayers() if used.realPath]
    if path.exists() and any(path.samefile(used) for used in layers):
        raise InputError(
            f"{shown(path)}: would replace files of {shown(source)}, which is edited; expected "
            "another name or folder."
        )
