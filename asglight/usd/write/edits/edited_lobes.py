# SPDX-License-Identifier: Apache-2.0
"""Lobes, or keys, that an edit layer mutes, deletes, adds or renames.

A muted lobe is invisible and keeps its values, so that it can light again. A deleted one is
inactive: USD has no way to take a prim of a weaker layer away. An added one is a prim of the layer,
with all that `write_usd` would say of it. A renamed one keeps its path, by which lights are linked,
and gets another `displayName`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from pxr import Sdf, Usd

from asglight.lobes import LobeTracks
from asglight.lobes.data import first_unused, lobe_names
from asglight.usd import schema
from asglight.usd.lights import cards, distant
from asglight.usd.options import StageOptions
from asglight.usd.schema import Representation
from asglight.usd.spaces import space_for, to_stage
from asglight.usd.stage import child_of, place_of
from asglight.usd.write import layer
from asglight.usd.write.authoring import TrackAuthor
from asglight.usd.write.between import Shot


@dataclass(frozen=True)
class LobeChanges:
    """What became of the lobes of a stage.

    Attributes:
        tracks: Those of the stage in their order, then those that were added.
        in_rig: The same as the rig has them.
        added: Indices of those that were added and are there.
        muted: Indices of those that are muted.
        deleted: Indices of those of the stage that are deleted.
        dropped: Indices of those that were added and deleted again.
    """

    tracks: LobeTracks
    in_rig: LobeTracks
    added: tuple[int, ...]
    muted: frozenset[int]
    deleted: frozenset[int]
    dropped: frozenset[int] = frozenset()

    @cached_property
    def lit(self) -> LobeTracks:
        """The lobes as the rig has them, all that give no light black."""
        dark = sorted(self.muted | self.deleted | self.dropped)
        lobes = self.in_rig.lobes.clone()
        lobes.amplitude[:, dark] = 0
        return replace(self.in_rig, lobes=lobes)

    def kinds(self, held: Sequence[cards.Kind]) -> list[cards.Kind]:
        """Return what each lobe is in the cards; none for a stage without them.

        Args:
            held: What those of the stage are.
        """
        if not held:
            return []
        more = cards.kinds(self.in_rig.lobes.split(len(held))[1])
        if cards.Kind.FILL not in held:  # there is none to which it could be added
            more = [cards.Kind.SINGLE if kind is cards.Kind.FILL else kind for kind in more]
        return [*held, *more]


def author_states(
    built: Sdf.Layer,
    paths: Sequence[Sdf.Path],
    held: LobeTracks,
    muted: frozenset[int],
    changes: LobeChanges,
) -> None:
    """Say which lobes of the stage are muted, deleted or called otherwise now.

    Args:
        built: The layer.
        paths: The prims of the stage's lobes.
        held: What the stage has of them.
        muted: Those that are muted in the stage.
        changes: What became of them.
    """
    for index, path in enumerate(paths):
        name = held.names[index]
        shown = changes.tracks.display_names.get(name, "")
        if shown != held.display_names.get(name, ""):
            Sdf.CreatePrimInLayer(built, path).SetInfo(schema.DISPLAY_NAME, shown)
        if index in changes.deleted:
            Sdf.CreatePrimInLayer(built, path).active = False
        elif (index in muted) is not (index in changes.muted):
            word = "invisible" if index in changes.muted else "inherited"
            _author_visibility(Sdf.CreatePrimInLayer(built, path), word)


def author_added(
    built: Sdf.Layer,
    author: TrackAuthor,
    rig: Usd.Prim,
    options: StageOptions,
    changes: LobeChanges,
    held: Sequence[cards.Kind],
) -> None:
    """Author the lobes that were added, with their lights in every representation of the stage.

    Args:
        built: The layer.
        author: Authors values over time.
        rig: The prim that holds the lobes.
        options: How the stage was written.
        changes: What became of the lobes.
        held: What the lobes of the stage are in the cards.
    """
    added = changes.added
    if not added:
        return
    chosen = torch.tensor(added, dtype=torch.long)
    lobes = changes.in_rig.lobes.select(chosen)
    in_stage = layer.continuous(to_stage(lobes, space_for(options)), keeps_first=True)
    shot = Shot(in_stage, author.frames)
    names = free_names(child_of(rig, schema.LOBES), changes, "lobe")
    scope = Sdf.CreatePrimInLayer(built, rig.GetPath().AppendChild(schema.LOBES))
    author_prims(author, scope, names, shot, changes)
    every = changes.kinds(held)
    for representation in options.held:
        lights: list[layer.TimedLights] = [((), author.frames)] * len(added)
        if representation is Representation.CARDS:
            kinds = [every[index] for index in added]
            lights = layer.card_lights(shot, options.card_distance, kinds)
        elif representation is Representation.DISTANT:
            threefold = distant.threefold(lobes, options.distant_lights)
            lights = layer.distant_lights(shot, threefold)
        holder = Sdf.CreatePrimInLayer(built, place_of(rig, representation))
        kind = schema.LIGHT_TYPES[representation]
        layer.author_lights(author, holder, kind, names, lights)


def author_prims(
    author: TrackAuthor,
    scope: Sdf.PrimSpec,
    names: Sequence[str],
    shot: Shot,
    changes: LobeChanges,
) -> None:
    """Author what was added, with what it is called and whether it is muted, without lights.

    Args:
        author: Authors values over time.
        scope: Takes the prims.
        names: Of the prims.
        shot: What they are.
        changes: What became of the lobes.
    """
    layer.author_in(author, scope, names, shot.of_lobes())
    for index, name in zip(changes.added, names, strict=True):
        prim = scope.layer.GetPrimAtPath(scope.path.AppendChild(name))
        own = changes.tracks.names[index]
        shown = changes.tracks.display_names.get(own, own)
        if shown != name:
            prim.SetInfo(schema.DISPLAY_NAME, shown)
        if index in changes.muted:
            _author_visibility(prim, "invisible")


def free_names(scope: Usd.Prim, changes: LobeChanges, kind: str) -> list[str]:
    """Return the names of the added prims: their own, unless an inactive prim has it already.

    Args:
        scope: Holds those of the stage.
        changes: What became of the lobes.
        kind: What names begin with.
    """
    taken = {prim.GetName() for prim in scope.GetAllChildren()} if scope else set()
    names: list[str] = []
    for index in changes.added:
        name = changes.tracks.names[index]
        if name in taken:
            (name,) = lobe_names(
                1, first_unused([*taken, *names, *changes.tracks.names], kind), kind
            )
        names.append(name)
    return names


def _author_visibility(prim: Sdf.PrimSpec, word: str) -> None:
    kind = Sdf.ValueTypeNames.Token
    attribute = Sdf.AttributeSpec(prim, schema.VISIBILITY, kind)
    attribute.default = word
