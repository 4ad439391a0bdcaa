# SPDX-License-Identifier: Apache-2.0
"""How much of what `asglight bench` can measure is measured: three efforts, every number stated."""

from dataclasses import dataclass
from enum import StrEnum

from asglight.fitting.options import LOBES
from asglight.fitting.paper import fit as paper
from asglight.judging.compare.methods import METHODS
from asglight.lobes import Form
from asglight.peers.approximation import LOBE_FLOATS

LOBE_COUNTS = (1, 2, 4, 8, 15, 30, 60, 120)

SWEPT = ("fast", "best", "paper", "em")
"""Methods that are asked for several numbers of lobes."""

PEERS = tuple(name for name in METHODS if name not in SWEPT)
"""Methods that are points: one fit each."""

PEERS_AT_ONCE = ("mjp", "wavelets", "sh", "variance-cut", "median-cut")
"""Of these, those that take less than a second on 256 x 512 texels; the others take 10 to 120."""

PAPER_SHARE, PAPER_SHARE_QUICK = 10, 100
"""The paper's recipe takes one in so many of its steps, or it would take half an hour."""

STEP_RATIO = 4
"""Between two runs of the paper's recipe: the shorter ones together take a third of the longest.
With another number of lobes than the run's it takes the steps of the second longest."""

WIDTHS = (64, 128, 256, 512, 1024, 2048, 4096)
FRAME_COUNTS = (10, 30, 100, 300, 1_000, 3_000, 10_000)

CROWD = 120
"""Lobes of the fit of `fast` that is timed beside the usual one: its time is to grow with them."""

CROWDED = "fast, crowd"
"""What that fit is called among those that are timed in turn."""


class Effort(StrEnum):
    """How much is measured."""

    QUICK = "quick"
    DEFAULT = "default"
    FULL = "full"


@dataclass(frozen=True)
class Plan:
    """What is measured.

    Attributes:
        effort: Its name.
        lobes: Number of lobes where one number is meant.
        counts: Numbers of lobes by method of `SWEPT`.
        paper_steps: Adam steps of the paper's recipe for a first frame.
        peers: Of `PEERS`.
        checkpoints: States of a fit on its way that are judged, at most.
        races: Fits of `fast`, of EM and of `fast` with `crowd` lobes in turn, for the ratios of
            their times.
        crowd: Those lobes.
        repeats: Times that a point of the scaling is timed; the least counts.
        frames: Frames of a sequence that are followed, from the first on, where nobody chose any;
            None for all.
        widths: Columns of the maps of the scaling with texels.
        frame_counts: Lengths of the scaling with frames.
    """

    effort: Effort
    lobes: int
    counts: dict[str, tuple[int, ...]]
    paper_steps: int
    peers: tuple[str, ...]
    checkpoints: int
    races: int
    crowd: int
    repeats: int
    frames: int | None
    widths: tuple[int, ...]
    frame_counts: tuple[int, ...]

    @property
    def floats(self) -> int:
        """The budget of the peers: that of `lobes` anisotropic lobes."""
        return LOBE_FLOATS[Form.ASG] * self.lobes

    def paper_ladder(self, count: int) -> tuple[int, ...]:
        """Return the paper's runs with a number of lobes: their steps, ascending."""
        ladder = [self.paper_steps]
        while ladder[0] >= 2 * STEP_RATIO:
            ladder.insert(0, ladder[0] // STEP_RATIO)
        return tuple(ladder) if count == self.lobes else tuple(ladder[-2:][:1])


def plan_of(effort: Effort, lobes: int = LOBES, paper_steps: int | None = None) -> Plan:
    """Return the plan of an effort.

    Args:
        effort: How much.
        lobes: Number of lobes where one number is meant.
        paper_steps: Steps of the paper's recipe; None for the effort's share of all of them.
    """
    share = {Effort.QUICK: PAPER_SHARE_QUICK, Effort.DEFAULT: PAPER_SHARE, Effort.FULL: 1}[effort]
    steps = paper_steps or paper.FIRST_FRAME_STEPS // share
    few, some = LOBE_COUNTS[:6:2], LOBE_COUNTS[:6]  # 1, 4, 15; to 30
    counts = {
        Effort.QUICK: {"fast": (1, 4, 15, 30), "best": (), "paper": (), "em": (1, 4, 15, 30)},
        Effort.DEFAULT: {"fast": LOBE_COUNTS, "best": some, "paper": few, "em": LOBE_COUNTS},
        Effort.FULL: dict.fromkeys(SWEPT, LOBE_COUNTS),
    }[effort]
    quick, full = effort is Effort.QUICK, effort is Effort.FULL
    return Plan(
        effort,
        lobes,
        {name: tuple(sorted({*numbers, lobes})) for name, numbers in counts.items()},
        steps,
        PEERS_AT_ONCE if quick else PEERS,
        checkpoints=5 if quick else 12,
        races=3,
        crowd=CROWD,
        repeats=1 if quick else 3,
        frames=8 if quick else None if full else 24,
        widths=WIDTHS if full else WIDTHS[:4] if quick else WIDTHS[:5],
        frame_counts=FRAME_COUNTS if full else (10, 20, 40) if quick else FRAME_COUNTS[:4],
    )
