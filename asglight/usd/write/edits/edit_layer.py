# SPDX-License-Identifier: Apache-2.0
"""Edited lobes as a layer over the stage that was edited, whose own files stay as they are.

The layer sublayers the stage and overrides, for the lobes that were edited, each attribute whose
composed value differs from the one that `write_usd` would author: what the lobe is, and the lights
derived from it, in every representation that the stage holds. A lobe that is muted is invisible
and keeps its values; one that is deleted is inactive; one that was added is a prim of the layer;
one that was renamed has another `displayName` (edited_lobes.py). A dome shows all lobes together,
so it gets images of its own. Range and rate of time, units and the default prim are copied, because
USD reads them from a stage's own layer and from none below it.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Ar, Sdf
from torch import Tensor

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.usd import schema
from asglight.usd.check.lint import lint_stage
from asglight.usd.check.trust import our_own
from asglight.usd.digest import author_digest, digest_of_prim
from asglight.usd.lights import cards
from asglight.usd.lights.light import Light
from asglight.usd.options import STAGE_SUFFIXES, image_folder
from asglight.usd.read.placement import as_written
from asglight.usd.read.tracks import read_stage
from asglight.usd.schema import Representation
from asglight.usd.spaces import space_for, to_stage
from asglight.usd.stage import (
    open_stage,
    place_of,
)
from asglight.usd.write import layer, samples, staging
from asglight.usd.write.authoring import TrackAuthor
from asglight.usd.write.between import Shot
from asglight.usd.write.checks import check_images_apart, check_target, check_tracks
from asglight.usd.write.edits.edited_lobes import LobeChanges, author_added, author_states
from asglight.usd.write.edits.edited_stage import AttributeTrack, EditedStage
from asglight.usd.write.edits.over_stage import reference, with_metadata
from asglight.usd.write.stage_metadata import metadata_text
from asglight.usd.write.staging import WriteReport

LAYER_SUFFIXES = tuple(suffix for suffix in STAGE_SUFFIXES if suffix != ".usdz")
"""A package would have to hold the stage that the layer lies over."""

SAME_NUMBERS = 2.0
"""In tolerances of the attribute: the source may be off by one, and so may a rewrite of it."""

SAME_QUATERNIONS = 4 * samples.QUATERNION_TOLERANCE
"""Of a component: the source's tolerance, the rounding of its float32 slerp, that of the float32
axes that were read from it, and that of the quaternion made of them."""


def write_edit_layer(
    path: str | Path,
    source: str | Path,
    tracks: LobeTracks,
    edited: Collection[int],
    muted: Collection[int] | None = None,
    deleted: Collection[int] = (),
) -> WriteReport:
    """Write the edits of a stage's lobes as a layer over that stage.

    `read_usd` of the layer gives the edited tracks. The stage is referred to relatively where both
    lie on one drive; it may be such a layer itself. The dome's images go to `<stem>_dome` beside
    the layer, as many rows as the stage's.

    Args:
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates.
        source: The stage that was edited.
        tracks: Its tracks with the edits: the lobes of the stage in their order, then those that
            were added. What they are called is their `display_names`.
        edited: Indices of the lobes that were edited.
        muted: Indices of the lobes that are muted and have their light in the tracks, as in
            `Reading.unmuted`; all others are seen. None leaves what is muted as it is, and black
            in the tracks, as in `Reading.tracks`.
        deleted: Indices of the lobes that are deleted.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights or are not those of the stage, the target is a file
            of the stage, or nothing can be written there.
    """
    path = Path(path)
    check_tracks(tracks)
    check_target(path, LAYER_SUFFIXES)
    below = EditedStage(Path(source))
    if muted is None:
        muted, tracks = below.muted, below.unmuted(tracks, edited)
    _check_same(below, tracks, edited)
    _check_apart(path, below)
    check_images_apart(path)
    count = below.tracks.lobes.count
    changes = LobeChanges(
        tracks,
        as_written(tracks, below.placement),
        tuple(index for index in range(count, tracks.lobes.count) if index not in deleted),
        frozenset(muted),
        frozenset(index for index in deleted if index < count),
        frozenset(index for index in deleted if index >= count),
    )
    kept = [index for index in edited if index < count and index not in deleted]
    differing = [track for track in _tracks(below, changes.in_rig, kept) if _differs(below, track)]
    with staging.staged(path) as place, our_own():
        images = _images(below, changes, kept, bool(differing), place)
        built, author = _build(below, changes, differing, images)
        built.subLayerPaths = [reference(below.path, place.parent)]
        staging.export(built, place)
        _author_digests(built, place, differing)
        _check_findings(below, place)
        staging.export(built, place)
        _check_lights(below, place, kept)
        built.subLayerPaths = [reference(below.path, path.parent)]
        staging.export(built, place)
        files = [file for each in images.values() for file in each]
        return staging.move_into_place(place, path, files, author)


def _images(
    below: EditedStage, changes: LobeChanges, kept: Collection[int], differs: bool, place: Path
) -> dict[str, list[Path]]:
    """Write the images of the dome and of the fill that the edits change.

    Args:
        below: The stage that was edited.
        changes: What was edited.
        kept: Indices of the edited lobes that the stage holds and still has.
        differs: Whether an attribute of these differs from the stage's.
        place: The layer, where it is written.

    Returns:
        Files by the name of their prim; none where nothing changes there.
    """
    height, space = below.options.dome_height, space_for(below.options)
    darkened = changes.muted ^ below.muted
    is_changed = bool(differs or changes.added or darkened or changes.deleted)
    has_dome = is_changed and Representation.DOME in below.options.held
    kinds = changes.kinds(below.kinds)
    refill = is_changed and any(
        kinds[index] is cards.Kind.FILL
        for index in (*kept, *changes.added, *changes.deleted, *darkened)
        if kinds
    )
    lit = changes.lit
    images = staging.dome_images(lit, place, height, space).write() if has_dome else []
    fill = staging.fill_images(lit, kinds, place, space).write() if refill else []
    return {schema.DOME: images, schema.FILL: fill}


def _tracks(
    below: EditedStage, tracks: LobeTracks, edited: Collection[int]
) -> Iterator[AttributeTrack]:
    """Yield the attributes of the edited lobes and of their lights."""
    chosen = sorted(edited)
    lobes = tracks.lobes.select(torch.tensor(chosen, dtype=torch.long))
    lobes = layer.continuous(to_stage(lobes, space_for(below.options)), keeps_first=True)
    paths = below.lobe_paths
    own = [paths[index] for index in chosen]
    shot = Shot(lobes, np.asarray(tracks.frames, dtype=np.float64))
    for path, one in zip(own, shot.of_lobes(), strict=True):
        for name, (values, times) in layer.lobe_tracks(one).items():
            target = path.AppendProperty(name)
            yield AttributeTrack(target, None, values, times, layer.LOBE_TOLERANCE)
    lights: dict[Representation, list[layer.TimedLights]] = {}
    if Representation.CARDS in below.options.held:
        distance, kinds = below.options.card_distance, below.kinds_of(chosen)
        lights[Representation.CARDS] = layer.card_lights(shot, distance, kinds)
    if Representation.DISTANT in below.options.held:
        threefold = [below.threefold[index] for index in chosen]
        lights[Representation.DISTANT] = layer.distant_lights(shot, threefold)
    for representation, of_lobes in lights.items():
        holder = place_of(below.rig, representation)
        held = [path.ReplacePrefix(below.rig.GetPath(), holder) for path in own]
        for path, (of_lobe, times) in zip(held, of_lobes, strict=True):
            yield from _of_lobe(path, representation, of_lobe, times)


def _of_lobe(
    lobe: Sdf.Path,
    representation: Representation,
    lights: Sequence[Light],
    times: NDArray[np.float64],
) -> Iterator[AttributeTrack]:
    """Yield the tracks of one lobe's lights."""
    for light in lights:
        path = lobe.AppendChild(light.name) if light.name else lobe
        for name, values in light.tracks.items():
            target = path.AppendProperty(name)
            yield AttributeTrack(target, representation, values, times, layer.LIGHT_TOLERANCE)


def _differs(below: EditedStage, track: AttributeTrack) -> bool:
    """Tell whether the stage shows something else at any frame.

    Between frames it then does too, for what lies there follows from the frames.
    """
    held = below.values(track)
    if held is None:
        return True
    wanted = track.values.numpy()[np.isin(track.times, below.tracks.frames)]
    if schema.VALUE_TYPES[track.path.name] == Sdf.ValueTypeNames.Quatf:  # q and -q are one rotation
        held = held * np.where((held * wanted).sum(-1, keepdims=True) < 0, -1.0, 1.0)
        return bool((np.abs(held - wanted) > SAME_QUATERNIONS).any())
    return bool((np.abs(held - wanted) > SAME_NUMBERS * track.tolerance * np.abs(wanted)).any())


def _build(
    below: EditedStage,
    changes: LobeChanges,
    differing: list[AttributeTrack],
    images: Mapping[str, Sequence[Path]],
) -> tuple[Sdf.Layer, TrackAuthor]:
    built = with_metadata(below.stage.GetRootLayer())
    rig_path = below.rig.GetPath()
    rig = Sdf.CreatePrimInLayer(built, rig_path)
    if changes.tracks.metadata != below.tracks.metadata:
        data = {"metadata": metadata_text(changes.tracks)}
        rig.SetInfo("customData", {schema.CUSTOM_DATA: data})
    author = TrackAuthor(changes.tracks.frames)
    for track in differing:
        prim = Sdf.CreatePrimInLayer(built, track.path.GetPrimPath())
        author.track(prim, track.path.name, track.values, track.tolerance, track.times)
    author_states(built, below.lobe_paths, below.tracks, below.muted, changes)
    author_added(built, author, below.rig, below.options, changes, below.kinds)
    owners = {schema.DOME: Representation.DOME, schema.FILL: Representation.CARDS}
    for name, files in images.items():
        if files:
            holder = place_of(below.rig, owners[name])
            prim = Sdf.CreatePrimInLayer(built, holder.AppendChild(name))
            layer.author_textures(author, prim, staging.relative_names(files))
    return built, author


def _author_digests(built: Sdf.Layer, place: Path, differing: list[AttributeTrack]) -> None:
    """Keep with each lobe that the layer changes what it is now, so that its lights count."""
    stage = open_stage(place)
    tracks = (track for track in differing if track.representation is None)
    for path in {track.path.GetPrimPath() for track in tracks}:
        digest = digest_of_prim(stage.GetPrimAtPath(path))
        author_digest(Sdf.CreatePrimInLayer(built, path), digest)


def _check_findings(below: EditedStage, place: Path) -> None:
    """Raise if the layer breaks the contract where the stage below it does not."""
    findings = lint_stage(place)
    own = set(findings) - set(lint_stage(below.path)) if findings else set()
    if own:
        raise RuntimeError(f"the layer breaks the stage's contract: {sorted(own)}")


def _check_lights(below: EditedStage, place: Path, edited: Collection[int]) -> None:
    """Check that the edits reach the lights.

    What another program says of a light outside the variants is stronger than a layer in them.
    """
    names = {below.tracks.names[index] for index in edited}
    for change in read_stage(place).changes:
        prim = change.partition(":")[0]
        said = ("switched off", "invisible")  # which the layer may say itself
        if Sdf.Path(prim).name in names and not any(word in change for word in said):
            raise InputError(
                f"{shown(below.path)}: {change}, by another program, which a layer of edits cannot "
                f"undo; expected lights as written. Write a stage anew: asglight stitch "
                f"{shown(below.path)} -o STAGE."
            )


def _check_same(below: EditedStage, tracks: LobeTracks, edited: Collection[int]) -> None:
    """Check that the stage is the one whose tracks were edited."""
    held = below.tracks
    if not set(edited) <= set(range(tracks.lobes.count)):
        raise ValueError(f"edited: {sorted(edited)} of {tracks.lobes.count} lobes")
    alike = (
        held.frames == tracks.frames
        and held.fps == tracks.fps
        and held.lobes.form is tracks.lobes.form
        and held.names == tracks.names[: held.lobes.count]
    )
    rest = [index for index in range(held.lobes.count) if index not in set(edited)]
    kept = torch.tensor(rest, dtype=torch.long)
    if not alike or any(
        not torch.equal(getattr(held.lobes.select(kept), name), values.to("cpu", torch.float32))
        for name, values in vars(tracks.lobes.select(kept)).items()
        if isinstance(values, Tensor)
    ):
        raise InputError(
            f"{shown(below.path)}: does not hold the lobes that were edited; expected the stage "
            "as it was read. If it was written anew since, open it again."
        )


def _check_apart(path: Path, below: EditedStage) -> None:
    """Check that no file of the stage would be replaced: neither a layer nor an image."""
    target = path.resolve()
    layers = [Path(used.realPath) for used in below.stage.GetUsedLayers() if used.realPath]
    owners = {image_folder(used.resolve()): used for used in layers}
    images = [image for image in below.images if not Ar.IsPackageRelativePath(image)]
    owners |= {Path(image).resolve().parent: below.path for image in images}
    same = [used for used in layers if path.exists() and path.samefile(used)]
    owner = owners.get(image_folder(target), same[0] if same else None)
    if owner is not None:
        raise InputError(
            f"{shown(path)}: would replace files of {shown(owner)}, which is edited; expected "
            "another name or folder."
        )
