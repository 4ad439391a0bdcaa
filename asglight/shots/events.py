# SPDX-License-Identifier: Apache-2.0
"""What a running shot tells its caller: one event at a time, to one callback.

The events carry numbers and no wording, so that a terminal, a log file and a viewer can each show
them their own way; only a `Notice` is a sentence.
"""

from collections.abc import Callable
from dataclasses import dataclass

from asglight.images import Repair


@dataclass(frozen=True)
class Started:
    """The input was found and the output can be written; or the shot is fitted once more.

    Attributes:
        frames: Frames of the shot.
        done: How many of them an earlier run has fitted.
    """

    frames: int
    done: int


@dataclass(frozen=True)
class Prerolled:
    """One more frame before a part of a shot was followed; nothing of it is kept.

    Attributes:
        done: Frames so far.
        frames: Frames before the part.
    """

    done: int
    frames: int


@dataclass(frozen=True)
class Searched:
    """One number of lobes was tried on one frame, in search of the fewest that a tolerance allows.

    Attributes:
        frame: Frame number.
        lobes: How many.
        error: The larger of irr and r0.5.
    """

    frame: int
    lobes: int
    error: float


@dataclass(frozen=True)
class StepDone:
    """One optimiser step of a frame, where a frame takes many.

    Attributes:
        frame: Frame number.
        step: The step, from 1.
        steps: Steps of this frame.
        loss: The preset's own loss.
    """

    frame: int
    step: int
    steps: int
    loss: float


@dataclass(frozen=True)
class FrameDone:
    """One frame was fitted, and is safe on disk where there is a checkpoint.

    Attributes:
        frame: Frame number.
        position: Its place in the shot, from 1.
        frames: Frames of the shot.
        loss: The preset's own loss.
        flux_error: Flux of the lobes over that of the map, minus 1.
        seconds: Time this frame took.
        seconds_left: Expected time for the rest.
        repair: What was changed in its image.
        repeats: The earlier frame with the same pixels, whose lobes it has; None where it was
            fitted.
    """

    frame: int
    position: int
    frames: int
    loss: float
    flux_error: float
    seconds: float
    seconds_left: float
    repair: Repair
    repeats: int | None = None


@dataclass(frozen=True)
class Refined:
    """Some more frames were fitted between both neighbours, in the pass over the whole shot.

    Attributes:
        done: Frames read once more so far.
        frames: How many will be: those of the shot that repeat no other.
    """

    done: int
    frames: int


@dataclass(frozen=True)
class Keyed:
    """One more frame was searched for lamps, or cut into keys and rest.

    Attributes:
        label: Which of these.
        done: Frames so far.
        frames: Frames of the shot.
    """

    label: str
    done: int
    frames: int


@dataclass(frozen=True)
class Farmed:
    """One more frame of any part was fitted somewhere, or a part is finished.

    Attributes:
        done: Frames fitted so far, of all parts of all shots.
        frames: Frames of all parts of all shots.
        seconds_left: Expected time for the rest; None before the first frame.
        finished: The part that is finished, such as `day 1015-1034`; None between.
    """

    done: int
    frames: int
    seconds_left: float | None
    finished: str | None = None


@dataclass(frozen=True)
class Notice:
    """One line that the user should see; nothing stops."""

    text: str


Event = Started | Prerolled | Searched | StepDone | FrameDone | Refined | Keyed | Farmed | Notice
OnProgress = Callable[[Event], None]


def ignore(event: Event) -> None:
    """Take an event and do nothing with it."""
