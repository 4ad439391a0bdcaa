# SPDX-License-Identifier: Apache-2.0
"""How well a sequence is followed, whichever way it is turned: the presets side by side.

    python -m benchmarks.shots.turned ../shared/sequences/tunnel

Where lamps rush past, a hair decides which lobe goes to which lamp, so one sequence decides little.
It is followed six ways: as it is and turned by a third, forward, backward and mirrored; with
--turns 8 as it is and turned by one to seven ninths, 24 ways. `--afresh 5 7 10 15` adds `fast` from
nothing in every frame, with so many lobes that jump as they like. Errors are those of
asglight.fitting.loss.measures, within 1 % of the judge's. The worst way is that with the largest
mean r0.5, also over the mean of all ways; the worst frame has the largest r0.5, in the luckiest and
the unluckiest way; flicker is taken of what r0.5 shows.
"""

import argparse
import statistics
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, measures
from asglight.fitting.loss.probes import probe, split
from asglight.fitting.options import LOBES, FitOptions, Preset
from asglight.judging.following import follow, matched, refined
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.identity.tracks import as_tracks
from benchmarks.given import add_sequence, frames_given

PRESETS = (Preset.LIVE, Preset.FAST, Preset.BEST)


class Shot(NamedTuple):
    """What was measured of one followed sequence.

    Attributes:
        irr: Of each frame.
        rough: r0.5 of each frame.
        flicker: Of what r0.5 shows: sum |change of fit - change of ref| / sum of ref.
        seconds: Wall seconds of a frame after the first.
    """

    irr: list[float]
    rough: list[float]
    flicker: float
    seconds: float


def main(argv: Sequence[str] | None = None) -> int:
    """Follow a sequence in each way with each preset, print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.shots.turned", description=__doc__)
    add_sequence(parser)
    parser.add_argument("--turns", type=int, default=2, metavar="N", help="orientations (2)")
    parser.add_argument(
        "--afresh", type=int, nargs="+", metavar="N", default=[], help="lobes of fits from nothing"
    )
    options = parser.parse_args(argv)
    if any(count < 1 for count in options.afresh):
        parser.error(f"--afresh {min(options.afresh)}; expected one or more")
    if options.turns < 1:
        parser.error(f"--turns {options.turns}; expected one or more")
    turned = ways(frames_given(parser, options), options.turns)
    found = {
        preset.value: [measured(each, FitOptions(LOBES, preset)) for each in turned]
        for preset in PRESETS
    }
    for count in options.afresh:
        fit = FitOptions(count, Preset.FAST)
        found[f"afresh, {count} lobes"] = [measured(each, fit, fresh=True) for each in turned]
    print(table(found))
    return 0


def ways(maps: list[Tensor], turns: int) -> list[list[Tensor]]:
    """Return a sequence forward, backward and mirrored, each as it is and turned.

    Args:
        maps: Of each frame.  [H, W, 3]
        turns: Orientations, evenly over all but the last step of a circle: 0 and 1/3 if two.
    """
    steps = [turn / (turns + 1) for turn in range(turns)]
    turned = [[each.roll(round(each.shape[1] * step), dims=1) for each in maps] for step in steps]
    mirrored = [[each.flip(1) for each in way] for way in turned]
    return [*turned, *(way[::-1] for way in turned), *mirrored]


def measured(maps: list[Tensor], options: FitOptions, *, fresh: bool = False) -> Shot:
    """Follow a sequence; `fast` and `best` refine it, as `asglight fit` does.

    Args:
        maps: Of each frame.  [H, W, 3]
        options: Settings.
        fresh: Fit every frame from nothing; lobes of neighbouring frames are matched.
    """
    found, seconds = follow(maps, options, fresh=fresh)
    if fresh:
        lobes = matched(found)
    else:
        if options.preset is not Preset.LIVE:
            found, seconds = refined(maps, found, seconds, options.preset)
        shot = as_tracks(stack(found))  # as it is written
        lobes = [shot[frame] for frame in range(len(maps))]
    truth = [measures.shown(each) for each in maps]
    errors = [measures.errors(*pair) for pair in zip(lobes, truth, strict=True)]
    return Shot(
        [each["irr"] for each in errors],
        [each["r0.5"] for each in errors],
        _flicker(lobes, truth),
        statistics.fmean(spent["wall_seconds"] for spent in seconds[1:]),
    )


def _flicker(lobes: list[Lobes], truth: list[measures.Shown]) -> float:
    last = list(measures.MEASURED).index("r0.5")
    sources = tuple(measures.MEASURED.values())
    wanted = torch.stack([each.views[last] for each in truth])
    rows = truth[0].rows
    even = measures.even_cells(rows, str(wanted.device))
    images = (lobe_images.images(each[None], even).radiance[0] for each in lobes)
    views = torch.stack(
        [split(probe(image, rows, sources), rows, sources)[last] for image in images]
    )
    missed = views - wanted
    return float(sum((b - a).abs().sum() for a, b in pairwise(missed)) / wanted.sum())


def table(found: dict[str, list[Shot]]) -> str:
    """Return a row a preset.

    Args:
        found: What was measured each way.
    """
    lines = [
        "| preset | irr | r0.5 | worst way | over the mean | worst frame | flicker | s a frame |",
        "|---|" + "--:|" * 7,
    ]
    for preset, shots in found.items():
        rough = [statistics.fmean(shot.rough) for shot in shots]
        mean = statistics.fmean(rough)
        worst = [max(shot.rough) for shot in shots]
        lines.append(
            f"| {preset} | {statistics.fmean(e for shot in shots for e in shot.irr):.4f} "
            f"| {mean:.4f} | {max(rough):.4f} | {max(rough) / mean:.2f} "
            f"| {min(worst):.3f} to {max(worst):.3f} "
            f"| {statistics.fmean(shot.flicker for shot in shots):.4f} "
            f"| {statistics.fmean(shot.seconds for shot in shots):.3f} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
