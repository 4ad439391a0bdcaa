# SPDX-License-Identifier: Apache-2.0
"""The edit under the user's hand: controls and drags that become one live step of a history.

An edit is made for the first of the selected lobes and taken by the others relatively: each turns
by the same angle, grows by the same factor, is tinted alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import torch

from asglight.lobes import Lobes
from asglight.viewer.state.edits import rectangles
from asglight.viewer.state.edits.absolute import colour_edit, edit_of, lamp_of
from asglight.viewer.state.edits.edit import Add, Delete, Mute, Rename, Restore, Span, turn
from asglight.viewer.state.edits.history import EditHistory

TURNS = ("azimuth", "elevation", "roll")
"""Fields that others take by the same degrees about axes of their own."""

ADDED_SHARPNESS = 40.0
"""Of a lobe that is added: 15 degrees wide at half of its peak, a lamp that is easily seen and
taken hold of."""

ADDED_KEY_DEG = 20.0
"""Sides of a key that is added: a soft box of a metre at three metres."""

SOFT_MAX = 100
"""Frames over which a range may come and go: four seconds."""


class Scope(StrEnum):
    """Where an edit holds."""

    ALL = "all frames"
    ONE = "this frame"
    RANGE = "in to out"


class Moment(NamedTuple):
    """Where the playhead and its marks are, as places in the frames of the tracks.

    Attributes:
        frame: The shown frame.
        first: The in point.
        last: The out point.
    """

    frame: int
    first: int
    last: int


@dataclass
class Editing:
    """What the hand holds.

    Attributes:
        scope: Where the edit holds.
        soft: Frames over which it comes and goes around a range.
        drag_from: Direction at which a lobe was taken to be turned, or None.  [3]
        aims: Whether the drag that goes on puts a highlight.
    """

    scope: Scope = Scope.ALL
    soft: int = 0
    drag_from: Sequence[float] | None = None
    aims: bool = False

    def span(self, moment: Moment) -> Span | None:
        """Return the frames that an edit takes now; None for all."""
        if self.scope is Scope.ALL:
            return None
        if self.scope is Scope.ONE:
            return Span.at(moment.frame)
        return Span(moment.first, moment.last, self.soft)

    def reaches(self, moment: Moment) -> bool:
        """Tell whether an edit holds in full in the shown frame, so that a value can be met."""
        return self.scope is not Scope.RANGE or moment.first <= moment.frame <= moment.last

    def set_value(
        self,
        history: EditHistory,
        lobes: Sequence[int],
        moment: Moment,
        field: str,
        value: float,
    ) -> None:
        """Show lobes changed so that the first has another value in the shown frame.

        Args:
            history: Takes the edit.
            lobes: Indices of the selected lobes, the first being that of the value.
            moment: The playhead.
            field: One of absolute.FIELDS.
            value: In the units of `absolute.Lamp`.
        """
        span, frame, is_key = self.span(moment), moment.frame, history.are_keys
        first, *others = lobes
        edit = edit_of(_lobe(history, first, frame), (first, span), field, value, is_key=is_key)
        edits = [edit]
        for lobe in others:
            if field not in TURNS:
                edits.append(replace(edit, lobe=lobe))
                continue
            own = _lobe(history, lobe, frame)
            more = value - getattr(lamp_of(_lobe(history, first, frame)), field)
            edits.append(edit_of(own, (lobe, span), field, getattr(lamp_of(own), field) + more))
        history.drag(*edits)

    def set_colour(
        self,
        history: EditHistory,
        lobes: Sequence[int],
        moment: Moment,
        colour: Sequence[float],
    ) -> None:
        """Show the first of some lobes in another colour of the same luminance, others tinted so.

        Args:
            history: Takes the edit.
            lobes: Indices of the selected lobes.
            moment: The playhead.
            colour: Linear RGB.
        """
        first = _lobe(history, lobes[0], moment.frame)
        edit = colour_edit(first, (lobes[0], self.span(moment)), colour)
        history.drag(*(replace(edit, lobe=lobe) for lobe in lobes))

    def turn_to(
        self,
        history: EditHistory,
        lobes: Sequence[int],
        moment: Moment,
        direction: Sequence[float],
    ) -> None:
        """Show lobes turned from where they were taken to a direction, as one."""
        assert self.drag_from is not None
        edit = turn(lobes[0], self.span(moment), self.drag_from, direction)
        history.drag(*(replace(edit, lobe=lobe) for lobe in lobes))

    def aim(
        self,
        history: EditHistory,
        lobes: Sequence[int],
        moment: Moment,
        direction: Sequence[float],
    ) -> None:
        """Show lobes turned so that the first points to a direction.

        Args:
            history: Takes the edit.
            lobes: Indices of the selected lobes.
            moment: The playhead.
            direction: Of any length; where a mirror shows the first lobe's highlight.  [3]
        """
        self.drag_from = _lobe(history, lobes[0], moment.frame).axis_z.tolist()
        self.turn_to(history, lobes, moment, direction)

    def commit(self, history: EditHistory) -> None:
        """Make what is shown a step: the next edit starts from there."""
        history.commit()
        self.drag_from = None


def toggle_mute(history: EditHistory, lobes: Sequence[int]) -> None:
    """Mute lobes, or let them light again: all become what the first does not do now."""
    becomes_muted = lobes[0] not in history.muted
    history.commit()
    history.add(*(Mute(one) for one in lobes if (one in history.muted) is not becomes_muted))


def delete(history: EditHistory, lobes: Sequence[int]) -> None:
    """Delete lobes."""
    history.commit()
    history.add(*(Delete(lobe) for lobe in lobes))


def restore(history: EditHistory, lobes: Sequence[int]) -> None:
    """Make lobes what they were before any edit."""
    history.commit()
    history.add(*(Restore(lobe) for lobe in lobes))


def rename(history: EditHistory, lobe: int, name: str) -> None:
    """Call a lobe otherwise; without a name, as in the stage."""
    if name != history.names[lobe]:
        history.commit()
        history.add(Rename(lobe, name))


def add(history: EditHistory, frame: int, direction: Sequence[float]) -> int:
    """Add a white lobe, or a key, as bright as the median of those that light a frame.

    Args:
        history: Takes the edit.
        frame: Place of the frame.
        direction: Unit vector.

    Returns:
        Its index.
    """
    history.commit()
    every, lobe = history.tracks.lobes[frame], history.tracks.lobes.count
    peaks = every.amplitude.amax(-1)  # [N]
    if history.are_keys:
        peaks = peaks * torch.tensor([rectangles.gain(every[n]) for n in range(lobe)])
    lit = peaks[peaks > 0]
    radiance, sharpness = float(torch.median(lit)) if len(lit) else 1.0, ADDED_SHARPNESS
    if history.are_keys:
        radiance, sharpness = _square(radiance)
    x, y, z = (float(value) for value in direction)
    light = radiance, radiance, radiance
    history.add(Add(lobe, (x, y, z), sharpness, light, history.are_keys))
    return lobe


def _square(radiance: float) -> tuple[float, float]:
    """Return amplitude and sharpness of the lobe of a new key of some radiance."""
    ones = Lobes(torch.eye(3), torch.full((2,), ADDED_SHARPNESS), torch.ones(3))
    angles = torch.full((2,), math.radians(ADDED_KEY_DEG) / 2)
    square = rectangles.with_half_angles(ones, angles)
    return radiance / rectangles.gain(square), float(square.sharpness[0])


def _lobe(history: EditHistory, lobe: int, frame: int) -> Lobes:
    return history.committed.lobes[frame, lobe]
