# SPDX-License-Identifier: Apache-2.0
"""What a state is made of: how lobes, environment, comparison and probe are looked at."""

from dataclasses import dataclass, field
from enum import Enum, StrEnum, auto
from typing import Literal

import numpy as np

from asglight.viewer.state.display import Comparison, Subject


class Request(Enum):
    """What only the window can do; it empties the list after every picture."""

    OPEN = auto()
    OPEN_AGAINST = auto()
    SAVE_EDITS = auto()
    SAVE_PICTURE = auto()
    RENDER = auto()
    RENDER_LABELLED = auto()
    RENDER_TURNTABLE = auto()
    QUIT = auto()


RENDERS = (Request.RENDER, Request.RENDER_LABELLED, Request.RENDER_TURNTABLE)


class Theme(StrEnum):
    """Colours of the window around the pictures."""

    DARK = "dark"
    LIGHT = "light"


class Scene(StrEnum):
    """What the lights shine on."""

    BALLS = "row of balls"
    GROUND = "ball on the ground"
    """One ball and a post, with a shadow for each lobe."""


GROUND_BALL = 3
"""The ball of roughness 0.5 stands on the ground: it shows both highlights and shade."""


class ScopeKind(StrEnum):
    """How brightness is shown."""

    HISTOGRAM = "histogram"
    WAVEFORM = "waveform"


class ScopePlace(StrEnum):
    """Of which picture."""

    BALLS = "balls"
    MAP = "map"


class ScopeSide(StrEnum):
    """Of which of two that are compared."""

    FIT = "fit"
    REFERENCE = "reference"


@dataclass
class Scope:
    """What is measured.

    Attributes:
        kind: How it is shown.
        place: Of which picture.
        side: Of which of two.
    """

    kind: ScopeKind = ScopeKind.HISTOGRAM
    place: ScopePlace = ScopePlace.BALLS
    side: ScopeSide = ScopeSide.FIT


class Outlines(StrEnum):
    """Which lobes are drawn over the map."""

    ALL = "all outlines"
    SELECTED = "selected only"
    NONE = "no outlines"


@dataclass
class Environment:
    """The environment around the balls.

    Attributes:
        intensity_ev: Stops added to all of its radiance.
        is_shown: Whether it is seen behind the balls.
    """

    intensity_ev: float = 0.0
    is_shown: bool = False


@dataclass
class Selection:
    """Which lobes are looked at: a matter of the view; muting is an edit.

    Attributes:
        lobe: Index of the selected one whose controls are shown.
        others: Those selected beside it.
        solo: While there are any, only these light.
        is_new: Whether the list has not shown it yet.
    """

    lobe: int | None = None
    others: tuple[int, ...] = ()
    solo: set[int] = field(default_factory=set)
    is_new: bool = False


@dataclass
class ListRoom:
    """How the panel of lobes is divided.

    Attributes:
        share: Of its height that the list has; None for what the controls leave it.
        controls: Height of the controls in the last picture, in points.
    """

    share: float | None = None
    controls: float = 0.0


@dataclass
class Renaming:
    """A name that is being typed.

    Attributes:
        lobe: Index of the lobe.
        text: What has been typed.
        has_begun: Whether the field has the keyboard.
    """

    lobe: int
    text: str
    has_begun: bool = False


@dataclass
class Compared:
    """What is shown of the fit and its reference.

    Attributes:
        comparison: Which of both.
        subject: What counts as fit and as reference.
        wipe: Share of the columns left of the wipe.
        is_flipped: Whether a held key shows the other one.
    """

    comparison: Comparison = Comparison.FIT
    subject: Subject = Subject.TOTAL
    wipe: float = 0.5
    is_flipped: bool = False

    @property
    def shown(self) -> Comparison:
        """What is shown now: while flipped, the reference; the fit where that is shown already."""
        if not self.is_flipped:
            return self.comparison
        is_reference = self.comparison is Comparison.REFERENCE
        return Comparison.FIT if is_reference else Comparison.REFERENCE


@dataclass(frozen=True)
class Probe:
    """Where numbers are read.

    Attributes:
        place: The map, or the balls.
        x: Share of the picture's columns from the left.
        y: Share of its rows from the top; of the strip of balls (gl/arrangement.py).
    """

    place: Literal["map", "balls"]
    x: float
    y: float


@dataclass(frozen=True)
class Inspected:
    """What lies under the pointer.

    Attributes:
        place: Where: the map, or a ball's name.
        direction: In the environment's coordinates; on a ball, what a mirror would show.  [3]
        fit: Radiance of what is shown as fit.  [3]
        reference: Of what is shown as reference, where there is one.  [3]
        shares: Indices of the lobes that send light from the direction, and their share of its
            luminance, the largest first.
    """

    place: str
    direction: np.ndarray
    fit: np.ndarray | None
    reference: np.ndarray | None
    shares: list[tuple[int, float]]
