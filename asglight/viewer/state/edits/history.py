# SPDX-License-Identifier: Apache-2.0
"""Tracks, and the steps in which they were edited: undone and redone one after the other."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from asglight.lobes import Lobes, LobeTracks
from asglight.viewer.state.edits import applying
from asglight.viewer.state.edits.carrying import Places, places_in
from asglight.viewer.state.edits.edit import Add, AnyEdit, Delete, Edit, Mute, Rename, Restore

Step = tuple[AnyEdit, ...]
"""Edits that are done and undone together: the same of all lobes that are selected."""


@dataclass(frozen=True)
class Content:
    """What edits have made of a shot.

    Attributes:
        tracks: All lobes, with those that are muted or deleted as they would light.
        muted: Indices of the lobes that give no light.
        deleted: Indices of the lobes that are gone; they keep their place until they are saved.
        labels: What lobes are called in place of their names in the stage, by index.
    """

    tracks: LobeTracks
    muted: frozenset[int] = frozenset()
    deleted: frozenset[int] = frozenset()
    labels: Mapping[int, str] = field(default_factory=dict)

    @cached_property
    def present(self) -> tuple[int, ...]:
        """Indices of the lobes that are not deleted."""
        return tuple(n for n in range(self.tracks.lobes.count) if n not in self.deleted)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What the lobes are called."""
        return tuple(self.labels.get(i, name) for i, name in enumerate(self.tracks.names))


@dataclass(frozen=True)
class _Done:
    """A step, and what undoes it: the tracks of the lobes that it changed, and all that is small.

    A lobe's track is a hundredth of the tracks of all, so a long history fits in memory; undoing
    gives the same bits.
    """

    step: Step
    tracks: Mapping[int, Lobes]
    before: Content


class EditHistory:
    """Tracks, and the steps that were made to them one after the other.

    While something is dragged, `drag` replaces one live step over and over; `commit` makes it one
    of the history.

    Attributes:
        original: The tracks before any edit.
        are_keys: Whether they are keys, whose lobes stand for rectangles.
    """

    def __init__(
        self, original: LobeTracks, muted: Iterable[int] = (), *, are_keys: bool = False
    ) -> None:
        """Start without edits.

        Args:
            original: The tracks, muted lobes as they would light.
            muted: Indices of the lobes that are muted already.
            are_keys: Whether they are keys.
        """
        self.original, self.are_keys = original, are_keys
        labels = {
            index: original.display_names[name]
            for index, name in enumerate(original.names)
            if name in original.display_names
        }
        self._first = Content(original, frozenset(muted), labels=labels)
        self._committed = self._shown = self._first
        self._live: Step = ()
        self._done: list[_Done] = []
        self._undone: list[Step] = []
        self._saved: tuple[Step, ...] = ()

    @property
    def tracks(self) -> LobeTracks:
        """The tracks with all edits, the live ones included."""
        return self._shown.tracks

    @property
    def committed(self) -> LobeTracks:
        """The tracks with the edits that are steps: what a live edit starts from."""
        return self._committed.tracks

    @property
    def muted(self) -> frozenset[int]:
        """Indices of the lobes that are muted."""
        return self._shown.muted

    @property
    def deleted(self) -> frozenset[int]:
        """Indices of the lobes that are deleted."""
        return self._shown.deleted

    @property
    def present(self) -> tuple[int, ...]:
        """Indices of the lobes that are not deleted."""
        return self._shown.present

    @property
    def names(self) -> tuple[str, ...]:
        """What the lobes are called."""
        return self._shown.names

    @property
    def done(self) -> tuple[Step, ...]:
        """The steps that are in force, the live one last."""
        live = (self._live,) if self._live else ()
        return (*(done.step for done in self._done), *live)

    @property
    def edits(self) -> tuple[AnyEdit, ...]:
        """The edits of the steps that are in force."""
        return tuple(edit for step in self.done for edit in step)

    @property
    def edited_lobes(self) -> tuple[int, ...]:
        """Indices of the lobes that edits in force change, ascending."""
        return tuple(sorted({edit.lobe for edit in self.edits}))

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps in force, then those that can be made again."""
        return (*(done.step for done in self._done), *reversed(self._undone))

    @property
    def position(self) -> int:
        """How many of the steps are in force."""
        return len(self._done)

    def go_to(self, position: int) -> None:
        """Undo or redo until so many steps are in force."""
        self.cancel()
        while self.position > max(position, 0):
            self.undo()
        while self.position < position and self.can_redo:
            self.redo()

    def first_track(self, lobe: int) -> Lobes:
        """Return a lobe as it was before any edit, or as it was added.  [F, .]."""
        if lobe < self.original.lobes.count:
            return applying.track_of(self.original, lobe)
        adds = (edit for edit in self.edits if isinstance(edit, Add) and edit.lobe == lobe)
        first = applying.with_fewer(self.tracks, lobe)
        return applying.track_of(applying.with_more(first, next(adds)), lobe)

    @property
    def saved_tracks(self) -> LobeTracks:
        """The tracks as a file holds them, under the names that it shows."""
        names = self._shown.tracks.names
        shown = {names[index]: label for index, label in self._shown.labels.items()}
        return replace(self._shown.tracks, display_names=shown)

    @property
    def lit_tracks(self) -> LobeTracks:
        """The tracks with lobes that are muted or deleted black."""
        dark = self._shown.muted | self._shown.deleted
        if not dark:
            return self._shown.tracks
        lobes = self._shown.tracks.lobes.clone()
        lobes.amplitude[:, sorted(dark)] = 0
        return replace(self._shown.tracks, lobes=lobes)

    @property
    def is_changed(self) -> bool:
        """Whether any edit is in force."""
        return bool(self.done)

    @property
    def is_unsaved(self) -> bool:
        """Whether the steps in force are others than those that were saved last."""
        return self.done != self._saved

    def mark_saved(self, steps: tuple[Step, ...]) -> None:
        """Remember which steps a file holds; those made since are unsaved."""
        self._saved = steps

    def over(self, original: LobeTracks, places: Places | None = None) -> "EditHistory":
        """Return a history of other tracks with the edits of this one, of the same lights.

        Args:
            original: Tracks of the same frames, such as those that a fit has gone on with.
            places: Where the lobes are in them; found by their light where it is not known yet.
        """
        if places is None:
            places = places_in(original, self.original)
        muted = places.of_all(self._first.muted)
        moved = EditHistory(original, muted, are_keys=self.are_keys)
        for done in self._done:
            moved.add(*places.edits(done.step))
        moved.drag(*places.edits(self._live))
        moved._undone = _carried(self._undone, places)
        moved._saved = tuple(_carried(self._saved, places))
        return moved

    def restore(self, steps: Sequence[Step], original: LobeTracks) -> int:
        """Make steps again that were made to other tracks of the shot, of the same lights.

        Args:
            steps: They are made one after the other.
            original: Those tracks, before any edit.

        Returns:
            How many there are without those whose light is gone.
        """
        carried = _carried(steps, places_in(self.original, original))
        for step in carried:
            self.add(*step)
        return len(carried)

    @property
    def can_undo(self) -> bool:
        """Whether `undo` does anything."""
        return bool(self.done)

    @property
    def can_redo(self) -> bool:
        """Whether `redo` does anything."""
        return bool(self._undone) and not self._live

    def drag(self, *edits: AnyEdit) -> None:
        """Show edits of the committed tracks in place of the last live ones.

        Raises:
            ValueError: There is no such lobe or frame, or a lobe cannot be so.
        """
        changing = tuple(e for e in edits if not (isinstance(e, Edit) and e.is_identity))
        shown = self._committed
        for edit in changing:
            shown = self._after(shown, edit)
        self._shown, self._live = shown, changing

    def commit(self) -> None:
        """Make what is live a step; what was undone before is gone."""
        if not self._live:
            return
        count = self._committed.tracks.lobes.count
        tracks = {
            edit.lobe: self._committed.tracks.lobes[:, edit.lobe].clone()
            for edit in self._live
            if isinstance(edit, Edit | Restore) and edit.lobe < count
        }
        small = replace(self._committed, tracks=_emptied(self._committed.tracks))
        self._done.append(_Done(self._live, tracks, small))
        self._undone.clear()
        self._committed = self._shown
        self._live = ()

    def cancel(self) -> None:
        """Drop what is live."""
        self._live = ()
        self._shown = self._committed

    def add(self, *edits: AnyEdit) -> None:
        """Make edits a step at once, in place of a live one.

        Raises:
            ValueError: As `drag`.
        """
        self.drag(*edits)
        self.commit()

    def undo(self) -> None:
        """Drop what is live, or without anything live take back the last step."""
        if not self._live and self._done:
            done = self._done.pop()
            self._undone.append(done.step)
            self._committed = self._undo_content(done)
        self.cancel()

    def redo(self) -> None:
        """Make the step again that was undone last, unless one is live."""
        if self.can_redo:
            step = self._undone.pop()
            rest = self._undone.copy()  # committing forgets what could still be redone
            self.add(*step)
            self._undone = rest

    def _undo_content(self, done: _Done) -> Content:
        """Return what was before the last committed step."""
        tracks = self._committed.tracks
        names = done.before.tracks.names
        if len(names) < tracks.lobes.count:
            tracks = applying.with_fewer(tracks, len(names))
        for lobe, track in done.tracks.items():
            tracks = applying.with_track(tracks, lobe, track)
        return replace(done.before, tracks=tracks)

    def _after(self, content: Content, edit: AnyEdit) -> Content:
        """Return what an edit makes of a content."""
        tracks = content.tracks
        if isinstance(edit, Add):
            return replace(content, tracks=applying.with_more(tracks, edit))
        applying.track_of(tracks, edit.lobe)  # or there is no such lobe
        if isinstance(edit, Edit):
            return replace(content, tracks=applying.apply(tracks, edit))
        if isinstance(edit, Restore):
            first = self.first_track(edit.lobe)
            return replace(content, tracks=applying.with_track(tracks, edit.lobe, first))
        if isinstance(edit, Mute):
            return replace(content, muted=content.muted ^ {edit.lobe})
        if isinstance(edit, Delete):
            return replace(content, deleted=content.deleted | {edit.lobe})
        assert isinstance(edit, Rename)
        labels = {place: label for place, label in content.labels.items() if place != edit.lobe}
        if edit.name and edit.name != tracks.names[edit.lobe]:
            labels[edit.lobe] = edit.name
        return replace(content, labels=labels)


def _emptied(tracks: LobeTracks) -> LobeTracks:
    """Return tracks without their numbers, only to know how many lobes there were."""
    return replace(tracks, frames=(), lobes=tracks.lobes[:0])


def _carried(steps: Sequence[Step], places: Places) -> list[Step]:
    """Return steps of the same lights, without those that nothing is left of."""
    return [step for step in map(places.edits, steps) if step]
