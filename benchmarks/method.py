# SPDX-License-Identifier: Apache-2.0
"""How much of an error is chance, and which loss is best: the tables of docs/method.md.

    python benchmarks/method.py --maps ../shared/hdri -o method.json

`fast` and EM draw no random numbers. Their chance is where the map lies on grids and spirals that
they are built on: each map is therefore turned about the vertical by several numbers of columns,
which changes nothing else, and the fit is turned back. The paper's recipe starts from a seed, so it
has several seeds. On every map it is run with each of its six losses from the first seed too.
"""

import argparse
import json
import math
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from asglight.cli.progress import Reporter, reporter
from asglight.fitting import paper
from asglight.fitting.options import FIT_HEIGHT, LOBES, FitOptions
from asglight.fitting.paper_losses import Loss
from asglight.fitting.sequence import fit_frame, one_thread
from asglight.images import read_latlong
from asglight.judging import methods
from asglight.judging.compare import FLOATS
from asglight.judging.methods import METHODS, Task
from asglight.judging.metrics import METRIC_NAMES, maps_errors
from asglight.judging.paper_figures import coarsened
from asglight.lobes import Form, Lobes, texels

REPEATS = 5
STEP = 103
"""Columns between two turns of a map of 512: no multiple of a coarse cell, 4 columns wide."""

SPREAD = ("env", "irr", "r0.5", "r0.25")
FLOOR = 1e-4
"""Errors below it count as it in a mean of logarithms: nobody sees them."""

Errors = dict[str, float]


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map of a folder, judge, print tables, write every number."""
    parser = argparse.ArgumentParser(prog="method", description=__doc__)
    add = parser.add_argument
    add("--maps", type=Path, required=True, metavar="DIR", help="latlong OpenEXR files")
    add("--steps", type=int, default=1200, metavar="N", help="Adam steps of the recipe (1200)")
    add("--rows", type=int, default=64, metavar="N", help="rows of its map (64)")
    add("-o", "--output", type=Path, default=Path("method.json"), metavar="FILE")
    options = parser.parse_args(argv)
    paths = sorted(options.maps.glob("*.exr"))
    found: dict[str, Any] = {}
    with reporter() as report:
        for path in paths:
            reference = read_latlong(path, height=FIT_HEIGHT).radiance
            found[path.stem] = measured(reference, path.stem, options.steps, options.rows, report)
            options.output.write_text(json.dumps(found, indent=1) + "\n")
    print("\n\n".join(spread_table(found, name) for name in ("fast", "em", "paper")))
    print(f"\n{losses_table({name: each['losses'] for name, each in found.items()})}")
    return 0


def measured(
    reference: Tensor, name: str, steps: int, rows: int, report: Reporter
) -> dict[str, Any]:
    """Return the errors of repeated fits by method, and those of the six losses.

    Args:
        reference: The map.  [H, W, 3]
        name: Of the map.
        steps: Of the paper's recipe.
        rows: Of the map that it is given.
        report: Shows progress.
    """
    every = list(_fits(reference, steps, rows, report, name))
    judged = maps_errors(torch.stack([radiance for _, radiance in every]), reference)
    repeats: dict[str, list[Errors]] = {"fast": [], "em": [], "paper": []}
    losses: dict[str, Errors] = {}
    for (kind, _), errors in zip(every, judged, strict=True):
        if kind in repeats:
            repeats[kind].append(errors.values)
        else:
            losses[kind] = errors.values
    losses[Loss.L1_LD.value] = repeats["paper"][0]
    return {**repeats, "losses": losses}


def _fits(
    reference: Tensor, steps: int, rows: int, report: Reporter, name: str
) -> Iterator[tuple[str, Tensor]]:
    """Return what each fit shows, on the map as it is.  [H, W, 3]."""
    for repeat in report.follow(range(REPEATS), f"{name}: fast and EM, turned", REPEATS):
        columns = repeat * STEP
        turned = reference.roll(columns, dims=1)
        yield "fast", _map(fit_frame(turned, FitOptions(LOBES), None).lobes, turned, columns)
        em = methods.run(METHODS["em"], Task(turned, FLOATS, 0, lambda: None))
        yield "em", em.texel_means(*turned.shape[:2]).roll(-columns, dims=1)
    coarse = coarsened(reference, rows)
    runs = [("paper", Loss.L1_LD, seed) for seed in range(REPEATS)]
    runs += [(loss.value, loss, 0) for loss in Loss if loss != Loss.L1_LD]
    for kind, loss, seed in report.follow(runs, f"{name}: the paper's recipe", len(runs)):
        begin = paper.start(coarse, LOBES, Form.ASG, seed)
        with one_thread():
            lobes = paper.fit_frame(coarse, begin, steps=steps, loss=loss)
        yield kind, _map(lobes, reference, 0)


def _map(lobes: Lobes, reference: Tensor, columns: int) -> Tensor:
    means = texels.texel_means(lobes.to(torch.float32), *reference.shape[:2])
    return means.roll(-columns, dims=1)


def spread_table(found: dict[str, Any], method: str) -> str:
    """Return least and largest error of repeated fits by map, and how far they are apart."""
    lines = [f"| {method} | {' | '.join(SPREAD)} |", f"|---|{'--:|' * len(SPREAD)}"]
    factors: dict[str, list[float]] = {name: [] for name in SPREAD}
    for stem, each in found.items():
        cells = []
        for name in SPREAD:
            values = [errors[name] for errors in each[method]]
            factors[name].append(max(values) / min(values))
            cells.append(f"{min(values):.4f} to {max(values):.4f}")
        lines.append(f"| {stem} | {' | '.join(cells)} |")
    for word, pick in (("median", statistics.median), ("largest", max)):
        shown = " | ".join(f"x {pick(factors[name]):.2f}" for name in SPREAD)
        lines.append(f"| {word} factor | {shown} |")
    return "\n".join(lines)


def losses_table(found: dict[str, dict[str, Errors]]) -> str:
    """Return each loss's geometric mean over the maps, and on how many it is the best of six."""
    lines = [f"| loss | {' | '.join(METRIC_NAMES)} |", f"|---|{'--:|' * len(METRIC_NAMES)}"]
    best = {name: Counter(_best(each, name) for each in found.values()) for name in METRIC_NAMES}
    for loss in Loss:
        cells = []
        for name in METRIC_NAMES:
            logs = [math.log(max(each[loss.value][name], FLOOR)) for each in found.values()]
            cells.append(f"{math.exp(statistics.fmean(logs)):.4f} ({best[name][loss]})")
        lines.append(f"| {loss.value} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _best(errors: dict[str, Errors], name: str) -> Loss:
    return min(Loss, key=lambda loss: errors[loss.value][name])


if __name__ == "__main__":
    raise SystemExit(main())
