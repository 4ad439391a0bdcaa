# SPDX-License-Identifier: Apache-2.0
"""The edit under the user's hand: sliders and drags that become one live edit of a history."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from asglight.lobes import Form
from asglight.viewer.balls import WHITE, Rgb
from asglight.viewer.edits import EditHistory, scale_amplitude, scale_sharpness, turn

SHARPNESS_STOPS = 6.0
"""Powers of 2 of one edit's sharpness: a lobe eight times wider or narrower, and again."""


class Scope(StrEnum):
    """Where an edit holds."""

    ALL = "all frames"
    ONE = "this frame"


@dataclass
class Editing:
    """Where the sliders of the selected lobe stand.

    Attributes:
        scope: Where the edit holds.
        gain_ev: Stops added to the amplitude.
        tint: Linear RGB factors of the amplitude.
        sharpness_x: Powers of 2 by which the sharpness along x grows.
        sharpness_y: The same along y.
        drag_from: Direction at which a lobe was taken to be turned, or None.  [3]
    """

    scope: Scope = Scope.ALL
    gain_ev: float = 0.0
    tint: Rgb = WHITE
    sharpness_x: float = 0.0
    sharpness_y: float = 0.0
    drag_from: Sequence[float] | None = None

    def light(self, history: EditHistory, lobe: int, frame_index: int) -> None:
        """Show a lobe as bright and coloured as the sliders say."""
        frame = self._frame(frame_index)
        history.drag(scale_amplitude(lobe, frame, self.gain_ev, self.tint))

    def sharpen(self, history: EditHistory, lobe: int, frame_index: int) -> None:
        """Show a lobe as narrow as the sliders say."""
        along_y = self.sharpness_y
        if history.original.lobes.form is Form.SG:  # isotropic: x speaks for both
            along_y = self.sharpness_x
        frame = self._frame(frame_index)
        history.drag(scale_sharpness(lobe, frame, self.sharpness_x, along_y))

    def turn_to(
        self, history: EditHistory, lobe: int, frame_index: int, direction: Sequence[float]
    ) -> None:
        """Show a lobe turned from where it was taken to a direction."""
        assert self.drag_from is not None
        history.drag(turn(lobe, self._frame(frame_index), self.drag_from, direction))

    def commit(self, history: EditHistory) -> None:
        """Make what is shown a step, and put the sliders back: the next edit starts from there."""
        history.commit()
        self.gain_ev = self.sharpness_x = self.sharpness_y = 0.0
        self.tint = WHITE
        self.drag_from = None

    def _frame(self, frame_index: int) -> int | None:
        return None if self.scope is Scope.ALL else frame_index
