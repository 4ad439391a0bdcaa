# SPDX-License-Identifier: Apache-2.0
"""Error against time on one map: `fast`, and the paper's recipe on the same device.

The recipe's points are ends of whole runs with so many steps, each with the whole fall of its
learning rate: one that is stopped early would be worse (docs/results/bench.md).
"""

import time
from collections.abc import Iterator

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper import losses as paper_losses
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes
from asglight.threads import one_thread
from benchmarks.gpu.data import maps
from benchmarks.gpu.rows import Given, Row
from benchmarks.gpu.timing import finish, seconds_of

LOBES, SHORT_LOBES = 15, 2

KEPT = 6
"""Points of `fast` on its way, even in their logarithm."""

LADDER = (375, 1500, 6000, 24000)
"""Steps of the recipe, up to all of them; runs for which there is no time are left out and told."""

SHARE = 0.85
"""Of the measure's seconds that runs may take: judging and loading need the rest."""

TRIED = 20
"""Steps that tell how long one takes; the first ones load what torch needs."""


def measure(given: Given) -> Iterator[Row]:
    """Fit the first map of all."""
    begin = time.perf_counter()
    count = SHORT_LOBES if given.short else LOBES
    name, reference = next(iter(maps(given).items()))
    there = reference.to(given.device)
    first_frame.fit_first_frame(there, count, Form.ASG)  # records what it does, unmeasured
    for point, seconds, lobes in _fast(there, count, given.device):
        yield _row(f"{name}, fast, {point}", seconds, lobes, reference)
    start = paper.start(there, count, Form.ASG, 0)

    def recipe(steps: int) -> Lobes:
        with one_thread():
            return paper.fit_frame(there, start, steps=steps)

    recipe(TRIED)
    _, tried = seconds_of(lambda: recipe(TRIED), given.device)
    for steps in (TRIED,) if given.short else LADDER:
        left = SHARE * given.seconds - (time.perf_counter() - begin)
        needed = steps * tried / TRIED
        if needed > left and not given.short:
            yield Row(f"{name}, paper, {steps} steps", {"left out; it would take s": needed})
            continue
        lobes, seconds = seconds_of(lambda steps=steps: recipe(steps), given.device)
        yield _row(f"{name}, paper, {steps} steps", seconds, lobes, reference)


def _fast(reference: Tensor, count: int, device: str) -> Iterator[tuple[str, float, Lobes]]:
    """Yield the point, seconds and lobes of `fast` on its way and at its end."""
    stages: list[tuple[float, Lobes]] = []
    exposure = first_frame.mean_radiance(reference)
    finish(device)
    begin = time.perf_counter()

    def on_step(current: Lobes) -> None:
        finish(device)
        stages.append((time.perf_counter() - begin, current[0].clone()))

    with one_thread(), torch.inference_mode():
        fit = first_frame.fit_first_frame(reference, count, Form.ASG, on_step=on_step)
        finish(device)
    end = time.perf_counter() - begin
    spread = torch.logspace(0, torch.log10(torch.tensor(float(len(stages)))), KEPT)
    for step in sorted({min(round(each), len(stages)) for each in spread.tolist()}):
        seconds, lobes = stages[step - 1]
        light = lobes.amplitude * exposure
        yield f"{step} steps", seconds, Lobes(lobes.axes, lobes.sharpness, light, lobes.form)
    yield "its end", end, fit.lobes


def _row(what: str, seconds: float, lobes: Lobes, reference: Tensor) -> Row:
    """Judge lobes on the host."""
    own = lobes.to("cpu").clone()
    errors = frame_errors(own, reference).values
    loss = float(paper_losses.frame_loss(own, paper_losses.target(reference)))
    judged = {name: errors[name] for name in ("env", "irr", "r0.5", "r0.25")}
    return Row(what, {"s": seconds, "the paper's loss": loss, **judged})
