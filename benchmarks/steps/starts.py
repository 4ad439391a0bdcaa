# SPDX-License-Identifier: Apache-2.0
"""What a first frame's start and its splits are worth: other settings beside `fast`, map by map.

    python -m benchmarks.steps.starts --maps ../shared/hdri

One fit decides little: which minimum a start ends in hangs on the grid it is seen on. So each map
is fitted as it is and turned about the vertical axis. Rows are geometric means of the
errors over those of `fast`; seconds are of the processor, in the mean.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.first_frame.fit import BEST, FAST, FirstFrameSettings, Level, soft_to_sharp
from asglight.fitting.options import LOBES
from asglight.judging.clock import Clock
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form
from asglight.threads import one_thread
from benchmarks.given import maps_given

TURNS = (0.0, 1 / 3, 2 / 3)
"""Of the whole circle, rounded to texels."""

METRICS = ("env", "irr", "irrMax", "r0.5", "r0.25")


def early(rounds: int) -> tuple[Level, ...]:
    """Return the levels with their splits under the third pair of corners, which is soft."""
    without = soft_to_sharp(rounds=0)
    return (*without[:2], replace(without[2], rounds=rounds), *without[3:])


SETTINGS = {
    "fast": FAST,
    "best": BEST,
    "fast, spreads count up to 30 degrees": replace(FAST, spreads_deg=(30.0,)),
    "fast, up to 4 degrees": replace(FAST, spreads_deg=(4.0,)),
    "fast, up to 1 degree": replace(FAST, spreads_deg=(1.0,)),
    "fast without splits": replace(FAST, levels=soft_to_sharp(rounds=0)),
    "fast, 6 rounds of splits": replace(FAST, levels=soft_to_sharp(rounds=6)),
    "fast, 2 rounds while corners are soft": replace(FAST, levels=early(rounds=2)),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map at every turn with all settings, print a table."""
    maps = maps_given("starts", __doc__, argv).values()
    turned = [_turned(radiance, part) for radiance in maps for part in TURNS]
    print(table({name: [measured(one, each) for one in turned] for name, each in SETTINGS.items()}))
    return 0


def _turned(radiance: Tensor, part: float) -> Tensor:
    return radiance.roll(round(part * radiance.shape[1]), dims=1)


def measured(reference: Tensor, settings: FirstFrameSettings) -> dict[str, float]:
    """Return J, the errors and the seconds of one fit.  [H, 2 H, 3]."""
    with one_thread(), torch.inference_mode():
        clock = Clock()
        fit = first_frame.fit_first_frame(reference, LOBES, Form.ASG, settings)
        seconds = clock.seconds()["cpu_seconds"]
    errors = frame_errors(fit.lobes, reference).values
    return {"J": fit.loss, "seconds": seconds} | {name: errors[name] for name in METRICS}


def table(found: dict[str, list[dict[str, float]]]) -> str:
    """Return a row for each, in ratios to the first.

    Args:
        found: What was measured of each map, by the name of the settings.
    """
    names = ("J", *METRICS)
    lines = [f"| settings | {' | '.join(names)} | s |", "|---|" + "--:|" * (len(names) + 1)]
    first = next(iter(found.values()))
    for label, rows in found.items():
        pairs = list(zip(rows, first, strict=True))
        ratios = [_mean_ratio([(row[name], one[name]) for row, one in pairs]) for name in names]
        seconds = statistics.fmean(row["seconds"] for row in rows)
        lines.append(f"| {label} | {' | '.join(f'{r:.2f}' for r in ratios)} | {seconds:.1f} |")
    return "\n".join(lines)


def _mean_ratio(pairs: Sequence[tuple[float, float]]) -> float:
    return math.exp(statistics.fmean(math.log(above / below) for above, below in pairs))


if __name__ == "__main__":
    raise SystemExit(main())
