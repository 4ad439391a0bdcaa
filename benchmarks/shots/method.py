# SPDX-License-Identifier: Apache-2.0
"""How much of an error is chance, which loss and lobes are best (docs/results/measures.md).

    python -m benchmarks.shots.method --maps ../shared/hdri -o method.json

Three parts. `spread`: `fast` and EM draw no random numbers. Their chance is where the map lies on
grids and spirals that they are built on: each map is therefore turned about the vertical by several
numbers of columns, which changes nothing else, and the fit is turned back. `losses`: the paper's
recipe with each of its six losses, from one seed. `forms`: `fast` with every lobe function.
"""

import argparse
import json
import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from asglight.cli.folders import write_text
from asglight.cli.progress import Reporter, reporter
from asglight.fitting.options import LOBES, FitOptions
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper.losses import Loss
from asglight.fitting.sequence import fit_frame
from asglight.judging.compare import methods
from asglight.judging.compare.maps import FLOATS
from asglight.judging.compare.methods import METHODS, Task
from asglight.judging.metrics import METRIC_NAMES, maps_errors
from asglight.judging.paper_figures.data import ROWS, STEPS, coarsened
from asglight.lobes import Form, Lobes, texels
from asglight.threads import one_thread
from benchmarks.given import map_paths, read_map, refused_in_a_line

FORMS = {
    (Form.SG, 15): "sg, 15 lobes, 90 floats",
    (Form.SG, 20): "sg, 20 lobes, 120 floats",
    (Form.ASG, 15): "asg, 15 lobes, 120 floats",
    (Form.BINGHAM, 15): "bingham, 15 lobes, 120 floats",
    (Form.FLAT, 15): "flat, 15 lobes, 120 floats",
}

REPEATS = 5
STEP = 103
"""Columns between two turns of a map of 512: no multiple of a coarse cell, 4 columns wide."""

SPREAD = ("env", "irr", "r0.5", "r0.25")
FLOOR = 1e-4
"""Errors below it count as it in a mean of logarithms: nobody sees them."""

Errors = dict[str, float]


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map of a folder, judge, print tables, write every number."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.shots.method", description=__doc__)
    add = parser.add_argument
    add("--maps", type=Path, required=True, metavar="DIR", help="latlong OpenEXR files")
    add("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="what (default: all)")
    add("-o", "--output", type=Path, default=Path("method.json"), metavar="FILE")
    options = parser.parse_args(argv)
    paths = map_paths(parser, options.maps)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    found: dict[str, dict[str, Any]] = {part: {} for part in options.parts}
    with refused_in_a_line(parser), reporter() as report:
        for path in paths:
            reference = read_map(path)
            for part in options.parts:
                fits = PARTS[part](reference, report, f"{path.stem}: {part}")
                found[part][path.stem] = judged(list(fits), reference)
            write_text(options.output, json.dumps(found, indent=1) + "\n")
    print("\n\n".join(table for part in options.parts for table in tables(part, found[part])))
    return 0


def judged(fits: Sequence[tuple[str, Tensor]], reference: Tensor) -> dict[str, list[Errors]]:
    """Return the errors of maps by what they are of, in their order.

    Args:
        fits: Names and maps.  [H, W, 3]
        reference: The map.  [H, W, 3]
    """
    found: dict[str, list[Errors]] = {}
    errors = maps_errors(torch.stack([radiance for _, radiance in fits]), reference)
    for (name, _), each in zip(fits, errors, strict=True):
        found.setdefault(name, []).append(each.values)
    return found


def spread(reference: Tensor, report: Reporter, label: str) -> Iterator[tuple[str, Tensor]]:
    """Fit a map turned several ways; return what each fit shows, turned back.  [H, W, 3]."""
    for repeat in report.follow(range(REPEATS), label, REPEATS):
        columns = repeat * STEP
        turned = reference.roll(columns, dims=1)
        yield "fast", _map(fit_frame(turned, FitOptions(LOBES), None).lobes, turned, columns)
        em = methods.run(METHODS["em"], Task(turned, FLOATS, 0, lambda: None))
        yield "em", em.texel_means(*turned.shape[:2]).roll(-columns, dims=1)


def losses(reference: Tensor, report: Reporter, label: str) -> Iterator[tuple[str, Tensor]]:
    """Run the recipe with each loss; return what each fit shows.  [H, W, 3]."""
    for loss in report.follow(Loss, label, len(Loss)):
        yield loss.value, _recipe(reference, loss)


def forms(reference: Tensor, report: Reporter, label: str) -> Iterator[tuple[str, Tensor]]:
    """Fit with each lobe function; return what each fit shows.  [H, W, 3]."""
    for (form, count), name in report.follow(FORMS.items(), label, len(FORMS)):
        yield name, _map(fit_frame(reference, FitOptions(count, form=form), None).lobes, reference)


PARTS: dict[str, Callable[[Tensor, Reporter, str], Iterator[tuple[str, Tensor]]]] = {
    "spread": spread,
    "losses": losses,
    "forms": forms,
}


def _recipe(reference: Tensor, loss: Loss) -> Tensor:
    """Return what the paper's recipe comes to.  [H, W, 3]."""
    coarse = coarsened(reference, ROWS)
    begin = paper.start(coarse, LOBES, Form.ASG, seed=0)
    with one_thread():
        return _map(paper.fit_frame(coarse, begin, steps=STEPS, loss=loss), reference)


def _map(lobes: Lobes, reference: Tensor, columns: int = 0) -> Tensor:
    """Return what lobes show, turned back by so many columns.

    Args:
        lobes: N lobes.  [N, .]
        reference: Of the size wanted.  [H, W, 3]
        columns: By which the map that they were fitted to was turned.

    Returns:
        Means over the texels.  [H, W, 3]
    """
    means = texels.texel_means(lobes.to(torch.float32), *reference.shape[:2])
    return means.roll(-columns, dims=1)


def tables(part: str, found: dict[str, dict[str, list[Errors]]]) -> list[str]:
    """Return the tables of a part, by map and name."""
    if part == "spread":
        return [spread_table(found, name) for name in ("fast", "em")]
    return [means_table(found, part)]


def spread_table(found: dict[str, dict[str, list[Errors]]], method: str) -> str:
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


def means_table(found: dict[str, dict[str, list[Errors]]], head: str) -> str:
    """Return geometric means over the maps, and on how many each is the best."""
    names = list(next(iter(found.values())))
    lines = [f"| {head} | {' | '.join(METRIC_NAMES)} |", f"|---|{'--:|' * len(METRIC_NAMES)}"]
    best = {
        metric: Counter(_best(each, metric) for each in found.values()) for metric in METRIC_NAMES
    }
    for name in names:
        cells = []
        for metric in METRIC_NAMES:
            errors = [each[name][0][metric] for each in found.values()]
            logs = [math.log(max(error, FLOOR)) for error in errors]
            cells.append(f"{math.exp(statistics.fmean(logs)):.4f} ({best[metric][name]})")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _best(errors: dict[str, list[Errors]], metric: str) -> str:
    return min(errors, key=lambda name: errors[name][0][metric])


if __name__ == "__main__":
    raise SystemExit(main())
