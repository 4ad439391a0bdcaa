# SPDX-License-Identifier: Apache-2.0
"""What a fit can be asked for."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

from asglight.fitting.paper import fit as paper
from asglight.lobes import Form

FIT_HEIGHT = 256
"""Rows of the map that is fitted, as in Clausen et al. 2024; finer maps are averaged down to it."""

TRACKS_PER_LOBE = 2
"""Of a shot: at most half of them are lit in a frame (slots.py)."""

LOBES = 15
"""Lobes of a fit that asks for no number, as in Clausen et al. 2024."""

MAX_LOBES = 30
"""Lobes of a fit with a tolerance, at most: ten real maps come to 2 % with 17 or fewer, and a
moving sequence takes more."""


AUTO = "auto"
FORM_NAMES = (AUTO, *map(str, Form))
"""What a fit can be asked for by name; `AUTO` is the form None."""


class Preset(StrEnum):
    """How a fit is made."""

    LIVE = "live"
    """As `fast` with the fewest steps: follows a sequence while it plays."""
    FAST = "fast"
    """EM start, Levenberg-Marquardt under narrowing corners (first_frame.py, following.py)."""
    BEST = "best"
    """The same with several starts, splits and merges, and more steps: up to 30 s a first frame."""
    PAPER = "paper"
    """Clausen et al. 2024 as published (fitting/paper)."""


def form_of(name: str) -> Form | None:
    """Return the form of one of `FORM_NAMES`; None for `AUTO`."""
    return None if name == AUTO else Form(name)


@dataclass(frozen=True)
class FitOptions:
    """Settings of a fit.

    Attributes:
        lobes: Number of lobes; None for `LOBES` or, with a tolerance, for as many as it takes.
        preset: How.
        form: Lobe function; None lets `fast` and `best` choose for a still: asg, or flat or sg
            where that shows it better. `live`, `paper` and shots of several frames then take asg.
        seed: Of the `paper` preset's start; the others draw no random numbers.
        device: Where torch computes: "cpu", "cuda", "cuda:1".
        paper_steps: Adam steps of the `paper` preset for the first and for each next frame.
        tolerance: Largest irr and r0.5 (measures.py) of any frame; None fits a number of lobes.
        max_lobes: With a tolerance, lobes at most; None for `MAX_LOBES`.
        preroll: The first frame of the shot, for a part of it that is to have the same lobes as the
            other parts; None begins from nothing.
        moving: Whether other frames follow: the fit then has spare tracks (slots.py).
    """

    lobes: int | None = None
    preset: Preset = Preset.FAST
    form: Form | None = Form.ASG
    seed: int = 0
    device: str = "cpu"
    paper_steps: tuple[int, int] = (paper.FIRST_FRAME_STEPS, paper.NEXT_FRAME_STEPS)
    tolerance: float | None = None
    max_lobes: int | None = None
    preroll: int | None = None
    moving: bool = False

    @property
    def count(self) -> int:
        """Number of lobes of one fit."""
        return LOBES if self.lobes is None else self.lobes

    def lobes_of(self, tracks: int) -> int:
        """Return the number of lobes of a fit that has so many tracks."""
        return tracks // TRACKS_PER_LOBE if self.has_spare_tracks else tracks

    @property
    def has_spare_tracks(self) -> bool:
        """Whether there are `TRACKS_PER_LOBE` tracks for each lobe."""
        return self.moving and self.preset is not Preset.PAPER

    def settled(self, frames: int) -> Self:
        """Return the same settings with every number that they leave open.

        The form is chosen for a still alone: flat lobes that follow lamps can lose them, and cost
        more of irr than they gain of env (docs/method/fewer-lobes.md), and what one frame chooses
        would hold for all.

        Args:
            frames: Of the shot.
        """
        is_still = frames == 1 and self.preroll is None
        settled = self if is_still else replace(self, form=self.form or Form.ASG, moving=True)
        if self.tolerance is None:
            return replace(settled, lobes=self.count)
        return replace(settled, max_lobes=self.max_lobes or MAX_LOBES)
