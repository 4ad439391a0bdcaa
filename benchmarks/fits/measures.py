# SPDX-License-Identifier: Apache-2.0
"""Two measurements of `fit.py`: accuracy on maps and error against time.

No time includes decoding, recording or judging. Results are plain dictionaries, as fit.json holds
them. Seconds are wall seconds, and CPU seconds of the whole process, all threads together.
"""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from asglight.cli.progress import Reporter
from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper import losses as paper_losses
from asglight.fitting.sequence import fit_frame
from asglight.judging.clock import Clock, Point, timed
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes
from asglight.peers import vmf_em
from asglight.threads import one_thread
from benchmarks.given import read_map

STILL_PRESETS = (Preset.FAST, Preset.BEST)

RATIOS_MAX = {
    "fast": {"env": 0.95, "irr": 0.5, "irrMax": 0.5, "r0.5": 0.6, "r0.25": 0.85},
    "best": {"env": 0.85, "irr": 0.33, "irrMax": 0.33, "r0.5": 0.4, "r0.25": 0.7},
}
"""Targets: error over that of EM, on every map."""

MEDIANS_MAX = {"env": 0.8, "irr": 0.15, "r0.5": 0.4, "r0.25": 0.7}
"""Targets: the median of those ratios."""

FLUX_MAX, IRR_ENOUGH = 0.002, 0.001
"""Targets: the error of the flux; the irr that is enough whatever EM reaches: nobody sees it."""

ERROR_MIN = 1e-9
"""Least error that a ratio divides by: rounding of float32 sums lies above it."""

RACED = ("loss", "irr", "r0.25")
"""What a preset has to bring down to where the paper ends."""

CURVE_POINTS = 60
"""Points of the paper's curve, even in the logarithm of the step."""


def accuracy(paths: Sequence[Path], lobes: int, report: Reporter) -> dict[str, Any]:
    """Fit every map with EM and the presets; return errors, seconds, and the ratios to EM."""
    for preset in STILL_PRESETS:  # unmeasured: a first fit also prepares its grids
        fit_frame(read_map(paths[0]), FitOptions(lobes, preset), None)
    maps: dict[str, dict[str, Point]] = {}
    for path in report.follow(paths, "accuracy: maps", len(paths)):
        reference = read_map(path)
        peer, seconds = timed(vmf_em.fit, reference, lobes)
        maps[path.stem] = {"em": frame_errors(peer, reference).values | seconds}
        for preset in STILL_PRESETS:
            fit, seconds = timed(fit_frame, reference, FitOptions(lobes, preset), None)
            maps[path.stem][preset.value] = frame_errors(fit.lobes, reference).values | seconds
    return {"maps": maps, "presets": {name.value: compare(maps, name) for name in STILL_PRESETS}}


def compare(maps: dict[str, dict[str, Point]], preset: str) -> dict[str, Any]:
    """Return a preset's ratios to EM, their median and worst, its targets and what misses them.

    Args:
        maps: Errors by map and method.
        preset: One of the methods.
    """
    limits = RATIOS_MAX[preset]
    ratios = {
        name: {key: errors[preset][key] / max(errors["em"][key], ERROR_MIN) for key in limits}
        for name, errors in maps.items()
    }
    columns = {key: [row[key] for row in ratios.values()] for key in limits}
    median = {key: statistics.median(column) for key, column in columns.items()}
    return {
        "ratios": ratios,
        "median": median,
        "worst": {key: max(column) for key, column in columns.items()},
        "targets": {"every": limits | {"flux": FLUX_MAX}, "median": MEDIANS_MAX},
        "missed": {name: missed(ratios[name], maps[name][preset], limits) for name in maps},
        "missed_median": [key for key, limit in MEDIANS_MAX.items() if median[key] > limit],
    }


def missed(ratios: Point, errors: Point, limits: Point) -> list[str]:
    """Return the metrics of a map that miss their target."""
    enough = ("irr", "irrMax") if errors["irr"] <= IRR_ENOUGH else ()
    names = [name for name, limit in limits.items() if ratios[name] > limit and name not in enough]
    return names + ["flux"] * (errors["flux"] > FLUX_MAX)


def curves(path: Path, lobes: int, paper_steps: int, report: Reporter) -> dict[str, Any]:
    """Return error against time on a map, and when each preset comes down to the paper's errors."""
    reference = read_map(path)
    frame = paper_losses.target(reference)
    found: dict[str, list[Point]] = {}
    for preset in STILL_PRESETS:
        stages = preset_curve(reference, preset, lobes)
        label = f"curves: {path.stem}, judging {preset}"
        found[preset.value] = [
            seconds | _judged(stage, reference, frame)
            for seconds, stage in report.follow(stages, label, len(stages))
        ]
    label = f"curves: {path.stem}, the paper's steps"
    ticks = iter(report.follow(range(paper_steps), label, paper_steps))
    points, last = paper_curve(reference, lobes, paper_steps, ticks)
    points[-1] |= _judged(last, reference, frame)
    return {
        "paper_steps": paper_steps,
        "points": {"paper": points} | found,
        "races": {name: races(points, curve) for name, curve in found.items()},
    }


def paper_curve(
    reference: Tensor, lobes: int, steps: int, ticks: Iterator[int]
) -> tuple[list[Point], Lobes]:
    """Run the paper's recipe; return its loss against time (at the end, time alone), and its lobes.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        lobes: N.
        steps: Adam steps.
        ticks: Advanced with every step.
    """
    recorded = set(np.geomspace(1, steps, CURVE_POINTS).round().astype(int).tolist()) - {steps}
    points: list[Point] = []
    unmeasured = paper.start(reference, lobes, Form.ASG, seed=0)
    paper.fit_frame(reference, unmeasured, steps=1)  # torch loads parts of itself at the first step
    clock = Clock()

    def on_step(step: int, loss: float) -> None:
        with clock.paused() as seconds:
            next(ticks, None)
            if step in recorded:
                points.append({"step": step, "loss": loss} | seconds)

    start = paper.start(reference, lobes, Form.ASG, seed=0)
    last = paper.fit_frame(reference, start, steps=steps, on_step=on_step)
    return [*points, {"step": steps} | clock.seconds()], last


def preset_curve(reference: Tensor, preset: Preset, lobes: int) -> list[tuple[Point, Lobes]]:
    """Return seconds and lobes of `fast` after each step, and of any preset at its end."""
    stages: list[tuple[Point, Lobes]] = []
    exposure = first_frame.mean_radiance(reference)
    clock = Clock()

    def on_step(current: Lobes) -> None:
        with clock.paused() as seconds:
            stages.append((seconds, replace(current, amplitude=current.amplitude * exposure)[0]))

    if preset is Preset.FAST:
        with one_thread():
            fit = first_frame.fit_first_frame(reference, lobes, Form.ASG, on_step=on_step)
    else:
        fit = fit_frame(reference, FitOptions(lobes, preset), None)
    return [*stages, (clock.seconds(), fit.lobes)]


def _judged(lobes: Lobes, reference: Tensor, frame: paper_losses.Target) -> Point:
    loss = float(paper_losses.frame_loss(lobes, frame))
    return {"loss": loss} | frame_errors(lobes, reference).values


def races(points: Sequence[Point], curve: Sequence[Point]) -> dict[str, dict[str, float | None]]:
    """Return seconds of the paper and of a preset to the same error, and how many times faster.

    Down to the paper's last loss, irr and r0.25, for which the paper needs its whole run; to its
    last loss and 1 %, where it stands much earlier; and, as `back`, to the preset's own last loss.
    A preset is there when a state of it is, the paper where the line between two of its steps is.
    """
    result: dict[str, dict[str, float | None]] = {}
    for name in RACED:
        level, slow = points[-1][name], points[-1]["wall_seconds"]
        result[name] = _race(level, slow, first_at(curve, name, level))
    near, last = 1.01 * points[-1]["loss"], curve[-1]["loss"]
    result["near"] = _race(near, time_to_reach(points, "loss", near), first_at(curve, "loss", near))
    result["back"] = _race(last, time_to_reach(points, "loss", last), curve[-1]["wall_seconds"])
    return result


def _race(level: float, slow: float | None, quick: float | None) -> dict[str, float | None]:
    ratio = slow / quick if slow is not None and quick is not None else None
    return {"level": level, "paper_seconds": slow, "seconds": quick, "times_faster": ratio}


def first_at(curve: Sequence[Point], name: str, level: float) -> float | None:
    """Return the wall seconds of the first state with an error at or below a level; None for never.

    Between two states a preset may be trying others, which it does not report.
    """
    return next((point["wall_seconds"] for point in curve if point[name] <= level), None)


def time_to_reach(curve: Sequence[Point], name: str, level: float) -> float | None:
    """Return the wall seconds at which an error first comes down to a level; None for never.

    The error is taken as linear between two points, which are some of many steps.
    """
    seconds = [point["wall_seconds"] for point in curve]
    errors = [point[name] for point in curve]
    for index, error in enumerate(errors):
        if error > level:
            continue
        if index == 0:
            return seconds[0]
        part = (errors[index - 1] - level) / (errors[index - 1] - error)
        return seconds[index - 1] + part * (seconds[index] - seconds[index - 1])
    return None
