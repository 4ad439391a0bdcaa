# SPDX-License-Identifier: Apache-2.0
"""Edits of lobe tracks: brighter, sharper, turned, in one frame or in all; undone and redone.

Muting is an edit as well. Plain data: tracks go in and new tracks come out. An edit says by how
much, not to what, so the same edit of all frames keeps what a lobe does over time.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from asglight.lobes import Form, Lobes, LobeTracks, asg, frames
from asglight.usd.write.checks import AMPLITUDE_MAX

LOG2_MAX = 64.0
"""Largest factor of one edit, as a power of 2: nineteen decades, more than the sun over starlight,
and no product of it with a float32 leaves float64."""

TINT_MIN = 2.0**-20
"""Least component of a tint, a millionth: black on every display, and it can be turned up again."""

IDENTITY = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Edit:
    """What is done to one lobe.

    Attributes:
        lobe: Index of the lobe.
        frame_index: Place in `tracks.frames`; None for all frames.
        gain_log2: Stops by which red, green and blue of the amplitude grow.
        sharpness_log2: Powers of 2 by which the sharpness along x and y grows.
        rotation: Quaternion (w, x, y, z) by which the lobe turns, about the world's axes.
        toggles_mute: Whether a lobe that lights is muted, and a muted one lights again.
    """

    lobe: int
    frame_index: int | None = None
    gain_log2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sharpness_log2: tuple[float, float] = (0.0, 0.0)
    rotation: tuple[float, float, float, float] = IDENTITY
    toggles_mute: bool = False

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: A power is not finite or beyond LOG2_MAX, or the quaternion has no length.
        """
        powers = (*self.gain_log2, *self.sharpness_log2)
        if not all(math.isfinite(power) and abs(power) <= LOG2_MAX for power in powers):
            raise ValueError(f"powers of 2: {powers}, expected at most +-{LOG2_MAX:g}")
        length = math.hypot(*self.rotation)
        if not (math.isfinite(length) and length > 0):
            raise ValueError(f"rotation: {self.rotation}, expected a quaternion")

    @property
    def what(self) -> str:
        """What is done, in a few words."""
        if self.toggles_mute:
            return "mute on or off"
        if any(self.rotation[1:]):
            degrees = math.degrees(2 * math.acos(min(abs(self.rotation[0]), 1.0)))
            return f"turn by {degrees:.1f} deg"
        if any(self.sharpness_log2):
            return "width and height"
        red, green, blue = self.gain_log2
        return f"intensity {red:+.2f} EV" if red == green == blue else "colour"

    @property
    def is_identity(self) -> bool:
        """Whether nothing changes."""
        changes = (*self.gain_log2, *self.sharpness_log2, *self.rotation[1:], self.toggles_mute)
        return not any(changes)


def scale_amplitude(
    lobe: int,
    frame_index: int | None,
    stops: float,
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> Edit:
    """Make a lobe brighter or darker, and multiply its colour by a tint.

    Args:
        lobe: Index of the lobe.
        frame_index: Place in `tracks.frames`; None for all frames.
        stops: The amplitude is multiplied by 2^stops.
        tint: Linear RGB factors, >= 0.
    """
    red, green, blue = (stops + math.log2(max(factor, TINT_MIN)) for factor in tint)
    return Edit(lobe, frame_index, gain_log2=(red, green, blue))


def scale_sharpness(lobe: int, frame_index: int | None, along_x: float, along_y: float) -> Edit:
    """Make a lobe narrower or wider along its axes.

    Args:
        lobe: Index of the lobe.
        frame_index: Place in `tracks.frames`; None for all frames.
        along_x: The sharpness along axis_x is multiplied by 2^along_x.
        along_y: The sharpness along axis_y likewise; the same for a lobe of the sg form.
    """
    return Edit(lobe, frame_index, sharpness_log2=(along_x, along_y))


def toggle_mute(lobe: int) -> Edit:
    """Mute a lobe in all frames, or let a muted one light again.

    Args:
        lobe: Index of the lobe.
    """
    return Edit(lobe, toggles_mute=True)


def turn(
    lobe: int, frame_index: int | None, source: Sequence[float], target: Sequence[float]
) -> Edit:
    """Turn a lobe the shortest way that takes one direction to another.

    Args:
        lobe: Index of the lobe.
        frame_index: Place in `tracks.frames`; None turns all frames alike.
        source: Direction of any length, such as that at which a drag began.  [3]
        target: Direction to which it goes.  [3]
    """
    return Edit(lobe, frame_index, rotation=shortest_rotation(source, target))


def shortest_rotation(
    source: Sequence[float], target: Sequence[float]
) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of the smallest rotation between two directions.

    It is the product of the target and the mean direction: (mean . source, source x mean). For
    opposite directions it is a half turn about some axis at right angles to them.

    Args:
        source: Direction of any length.  [3]
        target: Direction of any length.  [3]
    """
    start, end = (_unit(direction) for direction in (source, target))
    mean = start + end
    if float(mean.norm()) < 1e-7:  # opposite to rounding: the sum has lost its direction
        x, y, z = frames.axes_around(start)[0].tolist()
        return (0.0, x, y, z)
    middle = mean / mean.norm()
    x, y, z = torch.linalg.cross(start, middle).tolist()
    return (float(start @ middle), x, y, z)


def apply(tracks: LobeTracks, edit: Edit) -> LobeTracks:
    """Return tracks in which one lobe is edited; every other value is the same to the last bit.

    Sharpness that is scaled stays within the limits of asglight.lobes.asg, amplitude below what a
    stage can hold.

    Args:
        tracks: Lobes of F frames.
        edit: What to do.

    Raises:
        ValueError: There is no such lobe or frame, or a lobe of the sg form would get two
            sharpnesses.
    """
    return _with_track(tracks, edit.lobe, _edited(_track(tracks, edit), edit))


class EditHistory:
    """Tracks, and the edits that were made to them one after the other.

    While something is dragged, `drag` replaces one live edit over and over; `commit` makes it a
    step. A step remembers its lobe's track as it was, so that undoing gives the same bits.

    Attributes:
        original: The tracks before any edit.
    """

    def __init__(self, original: LobeTracks) -> None:
        """Start without edits."""
        self.original = original
        self._committed = original
        self._shown = original
        self._live: Edit | None = None
        self._done: list[tuple[Edit, Lobes]] = []
        self._undone: list[Edit] = []
        self._saved: tuple[Edit, ...] = ()

    @property
    def tracks(self) -> LobeTracks:
        """The tracks with all edits, the live one included."""
        return self._shown

    @property
    def committed(self) -> LobeTracks:
        """The tracks with the edits that are steps: what a live edit starts from."""
        return self._committed

    @property
    def edits(self) -> tuple[Edit, ...]:
        """The edits that are in force, the live one last."""
        live = () if self._live is None else (self._live,)
        return (*(edit for edit, _ in self._done), *live)

    @property
    def edited_lobes(self) -> tuple[int, ...]:
        """Indices of the lobes that edits in force change, ascending."""
        return tuple(sorted({edit.lobe for edit in self.edits}))

    @property
    def steps(self) -> tuple[Edit, ...]:
        """The edits that are steps, those in force first, then those that can be made again."""
        return (*(edit for edit, _ in self._done), *reversed(self._undone))

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

    @property
    def muted(self) -> frozenset[int]:
        """Indices of the lobes that are muted."""
        muted: set[int] = set()
        for edit in self.edits:
            if edit.toggles_mute:
                muted ^= {edit.lobe}
        return frozenset(muted)

    @property
    def saved_tracks(self) -> LobeTracks:
        """The tracks as a file holds them: with all edits, muted lobes black."""
        muted = self.muted
        if not muted:
            return self._shown
        lobes = self._shown.lobes.clone()
        lobes.amplitude[:, sorted(muted)] = 0
        return replace(self._shown, lobes=lobes)

    @property
    def is_changed(self) -> bool:
        """Whether any edit is in force."""
        return bool(self.edits)

    @property
    def is_unsaved(self) -> bool:
        """Whether the edits in force are others than those that were saved last."""
        return self.edits != self._saved

    def mark_saved(self, edits: tuple[Edit, ...]) -> None:
        """Remember which edits a file holds; those made since are unsaved."""
        self._saved = edits

    def over(self, original: LobeTracks) -> "EditHistory":
        """Return a history of other tracks with the edits of this one that they can take.

        Args:
            original: Tracks of the same frames, such as those that a fit has gone on with.
        """
        moved = EditHistory(original)
        for edit, _ in self._done:
            if edit.lobe < original.lobes.count:
                moved.add(edit)
        moved._undone = self._undone.copy()
        moved._saved = self._saved
        if self._live is not None and self._live.lobe < original.lobes.count:
            moved.drag(self._live)
        return moved

    @property
    def can_undo(self) -> bool:
        """Whether `undo` does anything."""
        return bool(self.edits)

    @property
    def can_redo(self) -> bool:
        """Whether `redo` does anything."""
        return bool(self._undone) and self._live is None

    def drag(self, edit: Edit) -> None:
        """Show an edit of the committed tracks in place of the last live one.

        Raises:
            ValueError: As `apply`.
        """
        self._shown = self._committed if edit.is_identity else apply(self._committed, edit)
        self._live = None if edit.is_identity else edit

    def commit(self) -> None:
        """Make the live edit a step; what was undone before is gone."""
        if self._live is None:
            return
        self._done.append((self._live, _track(self._committed, self._live).clone()))
        self._undone.clear()
        self._committed = self._shown
        self._live = None

    def cancel(self) -> None:
        """Drop the live edit."""
        self._live = None
        self._shown = self._committed

    def add(self, edit: Edit) -> None:
        """Make an edit a step at once, in place of a live one.

        Raises:
            ValueError: As `apply`.
        """
        self.drag(edit)
        self.commit()

    def undo(self) -> None:
        """Drop the live edit, or without one take back the last step."""
        if self._live is None and self._done:
            edit, before = self._done.pop()
            self._undone.append(edit)
            self._committed = _with_track(self._committed, edit.lobe, before)
        self.cancel()

    def redo(self) -> None:
        """Make the step again that was undone last, unless an edit is live."""
        if self.can_redo:
            edit = self._undone.pop()
            rest = self._undone.copy()  # committing forgets what could still be redone
            self.add(edit)
            self._undone = rest


def _unit(direction: Sequence[float]) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.as_tensor(direction, dtype=torch.float64), dim=0)


def _track(tracks: LobeTracks, edit: Edit) -> Lobes:
    """Return the edited lobe in all frames.  [F, .]."""
    if not 0 <= edit.lobe < tracks.lobes.count:
        raise ValueError(f"lobe: {edit.lobe} of {tracks.lobes.count}")
    if edit.frame_index is not None and not 0 <= edit.frame_index < len(tracks.frames):
        raise ValueError(f"frame_index: {edit.frame_index} of {len(tracks.frames)}")
    return tracks.lobes[:, edit.lobe]


def _with_track(tracks: LobeTracks, lobe: int, track: Lobes) -> LobeTracks:
    lobes = tracks.lobes.clone()
    lobes.axes[:, lobe] = track.axes
    lobes.sharpness[:, lobe] = track.sharpness
    lobes.amplitude[:, lobe] = track.amplitude
    return replace(tracks, lobes=lobes)


def _edited(track: Lobes, edit: Edit) -> Lobes:
    """Edit one lobe's track [F, .]: in float64, then rounded once."""
    if track.form is Form.SG and edit.sharpness_log2[0] != edit.sharpness_log2[1]:
        raise ValueError(f"sharpness_log2: {edit.sharpness_log2}, expected equal ones for sg")
    track = track.clone()
    index = edit.frame_index
    chosen = slice(None) if index is None else slice(index, index + 1)
    part = track[chosen].to(torch.float64)
    if any(edit.gain_log2):
        gain = torch.exp2(part.amplitude.new_tensor(edit.gain_log2))
        track.amplitude[chosen] = (
            (part.amplitude * gain).clamp(max=AMPLITUDE_MAX).to(track.amplitude)
        )
    for axis, power in enumerate(edit.sharpness_log2):
        if power:
            sharpness = part.sharpness[:, axis] * 2.0**power
            limits = asg.SHARPNESS_MIN, asg.SHARPNESS_MAX
            track.sharpness[chosen, axis] = sharpness.clamp(*limits).to(track.sharpness)
    if any(edit.rotation[1:]):
        quaternion = part.axes.new_tensor(edit.rotation)
        turned = asg.rotate(part, frames.axes_from_quaternion(quaternion).mT)
        track.axes[chosen] = frames.orthonormal(turned.axes).to(track.axes)
    return track
