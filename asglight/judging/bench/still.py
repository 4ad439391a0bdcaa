# SPDX-License-Identifier: Apache-2.0
"""One map, every method: what a fit has come to after which time.

Fits run first, on one thread, each with a record of the lobes that it had on its way; they are
judged afterwards, all together, so that no second of judging is in a second of fitting. A result is
a plain dictionary, as bench.json holds it.

Checkpoints of `fast` and `best` are what the fit held after a step of its first start, and its end,
the best of all starts. Those of the paper are ends of runs with fewer steps, each with the whole
fall of its learning rate: a run that is stopped early would be worse.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.judging.bench.memory import peak_memory
from asglight.judging.bench.plan import CROWDED, Effort, Plan
from asglight.judging.clock import Clock, Point, timed
from asglight.judging.compare import methods
from asglight.judging.compare.maps import Follow
from asglight.judging.compare.methods import METHODS, Task
from asglight.judging.metrics import maps_errors
from asglight.lobes import Form, Lobes
from asglight.peers.approximation import LOBE_FLOATS, Approximation, LobeSum, free_lobes
from asglight.sphere import latlong
from asglight.threads import one_thread

EFFORTS = {"fast": first_frame.FAST, "best": first_frame.BEST}

BATCH = 16
"""Maps judged together: 16 of 256 x 512 are 25 MB, and the kernels are then a small part."""


@dataclass(frozen=True)
class Checkpoint:
    """What a fit has come to.

    Attributes:
        steps: Steps taken; 0 where a method counts none.
        seconds: Wall and CPU seconds.
        found: What it holds.
    """

    steps: int
    seconds: Point
    found: Approximation


@dataclass(frozen=True)
class Run:
    """A fit with its checkpoints.

    Attributes:
        method: Key of `METHODS`.
        count: Lobes that were asked for; a peer gets the floats of as many anisotropic lobes.
        checkpoints: In the order of time; the last is the end.
        peak_bytes: Memory that it took; None where the system does not tell.
    """

    method: str
    count: int
    checkpoints: tuple[Checkpoint, ...]
    peak_bytes: int | None


def runs(reference: Tensor, plan: Plan, follow: Follow) -> list[Run]:
    """Fit a map with every method of a plan.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        plan: What is measured.
        follow: Shows how far this is.
    """
    methods.warm_up(reference, plan.lobes)
    done: list[Run] = []
    for name in EFFORTS:
        counts = plan.counts[name]
        for count in follow(counts, f"fitting {name}, lobes {_listed(counts)}", len(counts)):
            done.append(preset_run(reference, name, count, plan.checkpoints))
    for count in plan.counts["paper"]:
        done.append(paper_run(reference, count, plan.paper_ladder(count), follow))
    counts = plan.counts["em"]
    for count in follow(counts, f"fitting em, lobes {_listed(counts)}", len(counts)):
        done.append(peer_run(reference, "em", count, plan, follow))
    for name in follow(plan.peers, "fitting the other methods", len(plan.peers)):
        done.append(peer_run(reference, name, plan.lobes, plan, follow))
    return done


def preset_run(reference: Tensor, name: str, count: int, kept: int) -> Run:
    """Fit with a preset of ours.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        name: Key of `EFFORTS`.
        count: Lobes.
        kept: Checkpoints at most, evenly in the logarithm of the step, the end not counted.
    """
    stages: list[tuple[Point, Lobes]] = []
    exposure = first_frame.mean_radiance(reference)
    with peak_memory() as peak, one_thread(), torch.inference_mode():
        clock = Clock()

        def on_step(current: Lobes) -> None:
            with clock.paused() as seconds:
                stages.append((seconds, current[0]))

        fit = first_frame.fit_first_frame(reference, count, Form.ASG, EFFORTS[name], on_step)
        end = Checkpoint(len(stages), clock.seconds(), free_lobes(fit.lobes))
    on_the_way = [
        Checkpoint(
            step,
            stages[step - 1][0],
            free_lobes(_scaled(stages[step - 1][1], exposure)),
        )
        for step in spread_steps(len(stages), kept)
    ]
    return Run(name, count, (*on_the_way, end), peak.grown)


def spread_steps(steps: int, kept: int) -> list[int]:
    """Return at most so many of the steps 1 to `steps`, even in their logarithm."""
    if steps < 1:
        return []
    return sorted(set(np.geomspace(1, steps, kept).round().astype(int).tolist()))


def paper_run(reference: Tensor, count: int, ladder: Sequence[int], follow: Follow) -> Run:
    """Fit with the paper's recipe, once for each number of steps.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        count: Lobes.
        ladder: Numbers of steps, ascending.
        follow: Shows how far this is.
    """
    total = sum(ladder)
    ticks = follow(range(total), f"fitting paper, {count} lobes, {total} steps in all", total)
    next(ticks)
    checkpoints: list[Checkpoint] = []
    peak_bytes = None
    for steps in ladder:
        options = FitOptions(count, Preset.PAPER, paper_steps=(steps, steps))
        with peak_memory() as peak, one_thread():
            clock = Clock()
            fit = fit_frame(reference, options, None, on_step=_paused_tick(clock, ticks))
            checkpoints.append(Checkpoint(steps, clock.seconds(), free_lobes(fit.lobes)))
        peak_bytes = peak.grown
    return Run("paper", count, tuple(checkpoints), peak_bytes)


def peer_run(reference: Tensor, name: str, count: int, plan: Plan, follow: Follow) -> Run:
    """Fit with another method, with the floats of so many anisotropic lobes."""
    method = METHODS[name]
    full, quick = plan.effort is Effort.FULL, plan.effort is Effort.QUICK
    steps = methods.steps_of(method, full=full, quick=quick)
    ticks = follow(range(steps), f"fitting {name}", steps) if steps else iter(())
    next(ticks, None)

    def on_step() -> None:
        next(ticks, None)

    floats = count * LOBE_FLOATS[Form.ASG]
    with peak_memory() as peak:
        found, seconds = timed(methods.run, method, Task(reference, floats, steps, on_step))
    return Run(name, count, (Checkpoint(steps, seconds, found),), peak.grown)


def _paused_tick(clock: Clock, ticks: Iterator[int]) -> Callable[[int, int, float], None]:
    """Return a callback that moves a bar while a clock stands still."""

    def on_step(step: int, steps: int, loss: float) -> None:
        with clock.paused():
            next(ticks, None)

    return on_step


def races(reference: Tensor, plan: Plan, follow: Follow) -> dict[str, list[float]]:
    """Return CPU seconds of fits that take turns, as often as the plan says.

    What slows the machine down slows all: their ratios can be held against another run's.

    Returns:
        Of `fast` and of EM with the plan's lobes, and under `CROWDED` of `fast` with its crowd.
    """
    per_lobe = LOBE_FLOATS[Form.ASG]
    runners = {
        "fast": ("fast", plan.floats),
        "em": ("em", plan.floats),
        CROWDED: ("fast", per_lobe * plan.crowd),
    }
    seconds: dict[str, list[float]] = {name: [] for name in runners}
    label = f"timing fast, em, and fast with {plan.crowd} lobes in turn"
    for _ in follow(range(plan.races), label, plan.races):
        for name, (method, floats) in runners.items():
            task = Task(reference, floats, 0, lambda: None)
            seconds[name].append(timed(methods.run, METHODS[method], task)[1]["cpu_seconds"])
    return seconds


def judged(done: Sequence[Run], reference: Tensor, follow: Follow) -> list[dict[str, Any]]:
    """Return every run with its numbers.

    Args:
        done: Runs on one map.
        reference: The map.  [H, W, 3]
        follow: Shows how far this is.
    """
    every = [checkpoint for run in done for checkpoint in run.checkpoints]
    batches = [every[at : at + BATCH] for at in range(0, len(every), BATCH)]
    errors: list[Point] = []
    for batch in follow(batches, f"judging {len(every)} fits", len(batches)):
        errors.extend(_errors([checkpoint.found for checkpoint in batch], reference))
    passed = iter(errors)
    return [
        {
            "method": run.method,
            "title": METHODS[run.method].title,
            "lobes": run.count,
            "floats": run.checkpoints[-1].found.floats,
            "published_steps": METHODS[run.method].steps,
            "peak_bytes": run.peak_bytes,
            "points": [
                {"steps": checkpoint.steps} | checkpoint.seconds | next(passed)
                for checkpoint in run.checkpoints
            ],
        }
        for run in done
    ]


def lobes_of(done: Sequence[Run], method: str, count: int) -> Lobes:
    """Return the lobes that a method ended with.  [N, .]."""
    run = next(run for run in done if (run.method, run.count) == (method, count))
    found = run.checkpoints[-1].found
    assert isinstance(found, LobeSum), method
    return found.lobes


def _errors(found: Sequence[Approximation], reference: Tensor) -> list[Point]:
    """Return energy and errors; energy is the flux over that of the map, 1 where none is lost."""
    height, width, _ = reference.shape
    maps = torch.stack([each.texel_means(height, width).float() for each in found])
    weight = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    flux = (weight * maps).sum((1, 2, 3)) / (weight * reference).sum()
    judged = maps_errors(maps, reference)
    pairs = zip(flux.tolist(), judged, strict=True)
    return [{"energy": energy} | errors.values for energy, errors in pairs]


def _scaled(lobes: Lobes, factor: float) -> Lobes:
    return replace(lobes, amplitude=lobes.amplitude * factor)


def _listed(counts: Sequence[int]) -> str:
    return ", ".join(map(str, counts))
