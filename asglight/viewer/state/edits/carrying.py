# SPDX-License-Identifier: Apache-2.0
"""Edits and selection go on with newer tracks, each with the light that it was made to.

A fit that runs gives its lobes in the order of its seeds. The stage that it writes in the end has
them by energy, without those that the shot does not need: a place there is another lamp.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from asglight.lobes import LobeTracks
from asglight.lobes.identity.naming import found_again
from asglight.viewer.state.edits.edit import AnyEdit
from asglight.viewer.state.views import Renaming, Selection


@dataclass(frozen=True)
class Places:
    """Where the lobes of tracks are in those that replace them.

    Attributes:
        before: Number of lobes of the tracks before; those beyond were added.
        after: Number of lobes of the tracks after.
        moved: The new place of each lobe whose light is still there; None where all stay.
    """

    before: int
    after: int
    moved: Mapping[int, int] | None = None

    def of(self, lobe: int) -> int | None:
        """Return where a lobe is now; None where its light is gone."""
        if lobe >= self.before:
            return lobe - self.before + self.after
        return lobe if self.moved is None else self.moved.get(lobe)

    def of_all(self, lobes: Iterable[int]) -> tuple[int, ...]:
        """Return where those lobes are now whose light is still there."""
        return tuple(place for lobe in lobes if (place := self.of(lobe)) is not None)

    def edits(self, edits: Iterable[AnyEdit]) -> tuple[AnyEdit, ...]:
        """Return edits of the same lights, without those of lights that are gone."""
        found = ((edit, self.of(edit.lobe)) for edit in edits)
        return tuple(replace(edit, lobe=place) for edit, place in found if place is not None)

    def select(self, selection: Selection) -> None:
        """Let a selection be of the same lights."""
        every = (selection.lobe, *selection.others)
        first, *others = (*self.of_all(lobe for lobe in every if lobe is not None), None)
        selection.is_new |= first != selection.lobe
        selection.lobe = first
        selection.others = tuple(other for other in others if other is not None)
        selection.solo = set(self.of_all(selection.solo))

    def renaming(self, renaming: Renaming | None) -> Renaming | None:
        """Return a name that is being typed, unless its light is gone."""
        place = None if renaming is None else self.of(renaming.lobe)
        return None if renaming is None or place is None else replace(renaming, lobe=place)


def places_in(after: LobeTracks, before: LobeTracks) -> Places:
    """Return where the lobes of tracks are in newer ones.

    A fit that only has more frames leaves all where they are, which is seen without matching them:
    it gives new tracks with every frame.

    Args:
        after: The newer tracks.
        before: The tracks that they replace, black in frames without lobes yet.
    """
    places = Places(before.lobes.count, after.lobes.count)
    if not places.before or _stays(after, before):
        return places
    same = found_again(_with_light(after), _with_light(before))
    return replace(places, moved=same or {})


def gone(edits: int) -> str:
    """Say that edits could not be carried."""
    if edits == 1:
        return "1 edit was let go: its light is gone from the fit."
    return f"{edits} edits were let go: their light is gone from the fit."


def _stays(after: LobeTracks, before: LobeTracks) -> bool:
    """Tell whether all frames that had light have the same lobes in the same order."""
    old, new = before.lobes, after.lobes
    if new is old:
        return True
    if (before.frames, old.count, old.form) != (after.frames, new.count, new.form):
        return False
    # In numpy: torch would wake threads for a few numbers, and wait for them.
    lit = old.amplitude.numpy().any((1, 2))  # [F]
    pairs = ((old.amplitude, new.amplitude), (old.sharpness, new.sharpness), (old.axes, new.axes))
    return all(np.array_equal(one.numpy()[lit], other.numpy()[lit]) for one, other in pairs)


def _with_light(tracks: LobeTracks) -> LobeTracks:
    """Return the frames that have any light: a fit that runs has none in those to come."""
    lit = (tracks.lobes.amplitude != 0).flatten(1).any(1)  # [F]
    frames = tuple(tracks.frames[place] for place in torch.nonzero(lit).flatten().tolist())
    return replace(tracks, frames=frames, lobes=tracks.lobes[lit])
