# SPDX-License-Identifier: Apache-2.0
"""What a fit can be asked for."""

from dataclasses import dataclass
from enum import StrEnum

from asglight.fitting import paper
from asglight.lobes import Form

FIT_HEIGHT = 256
"""Rows of the map that is fitted, as in Clausen et al. 2024; finer maps are averaged down to it."""


class Preset(StrEnum):
    """How a fit is made."""

    LIVE = "live"
    """As `fast` with the fewest steps: follows a sequence while it plays."""
    FAST = "fast"
    """EM start, Levenberg-Marquardt under narrowing corners (first_frame.py, following.py)."""
    BEST = "best"
    """The same with several starts, splits and merges, and more steps: up to 30 s a first frame."""
    PAPER = "paper"
    """Clausen et al. 2024 as published (paper.py)."""


@dataclass(frozen=True)
class FitOptions:
    """Settings of a fit.

    Attributes:
        lobes: Number of lobes.
        preset: How.
        form: Lobe function.
        seed: Of the `paper` preset's start; the others draw no random numbers.
        device: Where torch computes: "cpu", "cuda", "cuda:1".
        paper_steps: Adam steps of the `paper` preset for the first and for each next frame.
    """

    lobes: int = 15
    preset: Preset = Preset.FAST
    form: Form = Form.ASG
    seed: int = 0
    device: str = "cpu"
    paper_steps: tuple[int, int] = (paper.FIRST_FRAME_STEPS, paper.NEXT_FRAME_STEPS)
