# SPDX-License-Identifier: Apache-2.0
"""The edit under the user's hand: controls and drags that become one live edit of a history."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from asglight.lobes import Lobes
from asglight.viewer.state.edits.absolute import colour_edit, edit_of
from asglight.viewer.state.edits.history import EditHistory, turn


class Scope(StrEnum):
    """Where an edit holds."""

    ALL = "all frames"
    ONE = "this frame"


@dataclass
class Editing:
    """What the hand holds.

    Attributes:
        scope: Where the edit holds.
        drag_from: Direction at which a lobe was taken to be turned, or None.  [3]
    """

    scope: Scope = Scope.ALL
    drag_from: Sequence[float] | None = None

    def set_value(
        self, history: EditHistory, lobe: int, frame_index: int, field: str, value: float
    ) -> None:
        """Show a lobe with another value in a frame; `field` is one of absolute.FIELDS."""
        place = lobe, self._frame(frame_index)
        history.drag(edit_of(self._lobe(history, lobe, frame_index), place, field, value))

    def set_colour(
        self, history: EditHistory, lobe: int, frame_index: int, colour: Sequence[float]
    ) -> None:
        """Show a lobe in another colour of the same luminance."""
        place = lobe, self._frame(frame_index)
        history.drag(colour_edit(self._lobe(history, lobe, frame_index), place, colour))

    def turn_to(
        self, history: EditHistory, lobe: int, frame_index: int, direction: Sequence[float]
    ) -> None:
        """Show a lobe turned from where it was taken to a direction."""
        assert self.drag_from is not None
        history.drag(turn(lobe, self._frame(frame_index), self.drag_from, direction))

    def commit(self, history: EditHistory) -> None:
        """Make what is shown a step: the next edit starts from there."""
        history.commit()
        self.drag_from = None

    def _lobe(self, history: EditHistory, lobe: int, frame_index: int) -> Lobes:
        return history.committed.lobes[frame_index, lobe]

    def _frame(self, frame_index: int) -> int | None:
        return None if self.scope is Scope.ALL else frame_index
