# SPDX-License-Identifier: Apache-2.0
"""What the figures of Clausen et al. 2024 show of a still, measured: lobes, losses, forms.

A figure is rows: each a fit of the same map, with its errors and its balls. The paper's recipe
(`fitting.paper`) takes as many Adam steps as it is given, on the map averaged down to so many rows;
ours takes the map as it is. All are judged on the map as it is.

Symbols: R roughnesses, S pixels across a ball.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper.losses import Loss
from asglight.fitting.sequence import fit_frame
from asglight.judging.clock import timed
from asglight.judging.compare.maps import Follow
from asglight.judging.metrics import maps_errors
from asglight.lobes import Form, Lobes, texels
from asglight.peers.approximation import LOBE_FLOATS
from asglight.shading.balls import render_balls
from asglight.sphere import latlong
from asglight.threads import one_thread

LOBE_COUNTS = (1, 2, 4, 8, 15, 30, 60)

STEPS, ROWS, STARTS = 1200, 64, 3
"""Of the paper's recipe, where nothing else is asked for: a twentieth of its steps, on a quarter of
its rows, and the starts of the ablation."""

ROUGHNESS = (0.05, 0.25, 0.5, 1.0)
"""Of the balls, from nearly a mirror to matte."""

BALL_SIZE = 96
"""Pixels; a picture shows them a fifth larger."""

OURS, PAPER = "fast", "paper"


@dataclass(frozen=True)
class Plan:
    """How much is fitted.

    Attributes:
        lobes: N, where one number is meant.
        counts: Numbers of lobes of the sweep.
        steps: Adam steps of the paper's recipe.
        rows: Of the map that the paper's recipe is given; fewer where the map has fewer.
        seeds: Starts of the ablation.
        ball_size: S.
    """

    lobes: int
    counts: tuple[int, ...] = LOBE_COUNTS
    steps: int = STEPS
    rows: int = ROWS
    seeds: int = STARTS
    ball_size: int = BALL_SIZE


@dataclass(frozen=True)
class Fit:
    """Lobes, and what they took.

    Attributes:
        method: `fast` or `paper`.
        label: What is different from the other fits of the figure.
        lobes: What came out.  [N, .]
        steps: Adam steps; 0 for `fast`.
        seconds: Processor seconds, one thread.
        seed: Of the start of the paper's recipe.
    """

    method: str
    label: str
    lobes: Lobes = field(repr=False)
    steps: int
    seconds: float
    seed: int = 0

    @property
    def floats(self) -> int:
        """Numbers that it takes to store the lobes."""
        return self.lobes.count * LOBE_FLOATS[self.lobes.form]


@dataclass(frozen=True)
class Row:
    """A fit, judged.

    Attributes:
        fit: The fit.
        errors: As of `metrics.map_errors`.
        radiance: Its map.  [H, W, 3]
        balls: The balls under it, None where they are not shown.  [R, S, S, 3]
        ball_errors: Sum of absolute differences over the sum of the reference, by ball.
    """

    fit: Fit
    errors: dict[str, float]
    radiance: Tensor = field(repr=False)
    balls: Tensor | None = field(repr=False, default=None)
    ball_errors: tuple[float, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the numbers."""
        fit = self.fit
        balls = {f"{r:g}": e for r, e in zip(ROUGHNESS, self.ball_errors, strict=False)}
        return {
            "method": fit.method,
            "label": fit.label,
            "form": fit.lobes.form.value,
            "lobes": fit.lobes.count,
            "floats": fit.floats,
            "steps": fit.steps,
            "seed": fit.seed,
            "cpu_seconds": fit.seconds,
            **self.errors,
            "balls": balls,
        }


@dataclass(frozen=True)
class Still:
    """A map and the fits of it.

    Attributes:
        reference: The map.  [H, W, 3]
        balls: The balls under it.  [R, S, S, 3]
        rows: The fits.
    """

    reference: Tensor = field(repr=False)
    balls: Tensor = field(repr=False)
    rows: tuple[Row, ...]


def lobe_sweep(reference: Tensor, plan: Plan, follow: Follow) -> Still:
    """Fit a map with growing numbers of lobes, by `fast` and by the paper's recipe.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        plan: How much.
        follow: Shows how far this is.
    """
    fits = []
    for count in follow(plan.counts, "fitting fast, more and more lobes", len(plan.counts)):
        fits.append(ours(reference, count, Form.ASG, f"{count}"))
    coarse = coarsened(reference, plan.rows)
    for count in plan.counts:
        begin = paper.start(coarse, count, Form.ASG, 0)
        fits.append(paper_fit(coarse, begin, f"{count}", plan.steps, follow))
    return judged(reference, fits, plan, follow, with_balls=lambda fit: fit.method == OURS)


def loss_ablation(reference: Tensor, plan: Plan, follow: Follow) -> Still:
    """Fit a map with the six losses of the paper, from the same starts, and with `fast`.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        plan: How much.
        follow: Shows how far this is.
    """
    coarse = coarsened(reference, plan.rows)
    fits = []
    for seed in range(plan.seeds):
        begin = paper.start(coarse, plan.lobes, Form.ASG, seed)
        for loss in Loss:
            fits.append(paper_fit(coarse, begin, loss.value, plan.steps, follow, loss, seed))
    fits.append(ours(reference, plan.lobes, Form.ASG, "fast, for comparison"))
    return judged(reference, fits, plan, follow, with_balls=lambda fit: fit.seed == 0)


def form_comparison(reference: Tensor, plan: Plan, follow: Follow) -> Still:
    """Fit a map with every lobe function, at the same number of lobes and of floats.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        plan: How much.
        follow: Shows how far this is.
    """
    as_many_floats = plan.lobes * LOBE_FLOATS[Form.ASG] // LOBE_FLOATS[Form.SG]
    wanted = [
        (Form.SG, plan.lobes, "isotropic (sg), as many lobes"),
        (Form.SG, as_many_floats, "isotropic (sg), as many floats"),
        (Form.ASG, plan.lobes, "anisotropic (asg)"),
        (Form.BINGHAM, plan.lobes, "anisotropic, antipodal (bingham)"),
    ]
    fits = [
        ours(reference, count, form, label)
        for form, count, label in follow(wanted, "fitting each lobe function", len(wanted))
    ]
    return judged(reference, fits, plan, follow, with_balls=lambda fit: True)


def ours(reference: Tensor, count: int, form: Form, label: str) -> Fit:
    """Fit with `fast`.  reference: [H, W, 3]."""
    found, spent = timed(fit_frame, reference, FitOptions(count, form=form), None)
    return Fit(OURS, label, found.lobes, 0, spent["cpu_seconds"])


def paper_fit(
    reference: Tensor,
    begin: Lobes,
    label: str,
    steps: int,
    follow: Follow,
    loss: Loss = Loss.L1_LD,
    seed: int = 0,
) -> Fit:
    """Fit with the paper's recipe.

    Args:
        reference: Radiance on the rows that it is given.  [H, W, 3]
        begin: Where it starts.  [N, .]
        label: Of the fit.
        steps: Adam steps.
        follow: Shows how far this is.
        loss: What is minimised.
        seed: Of the start.
    """
    name = f"{label} lobes" if label.isdecimal() else f"{label}, start {seed}"
    ticks = follow(range(steps), f"paper's recipe, {name}, steps", steps)
    next(ticks)

    def on_step(step: int, value: float) -> None:
        next(ticks, None)

    with one_thread():
        lobes, spent = timed(_fit_paper, reference, begin, steps, loss, on_step)
    return Fit(PAPER, label, lobes, steps, spent["cpu_seconds"], seed)


def _fit_paper(reference: Tensor, begin: Lobes, steps: int, loss: Loss, on_step: Any) -> Lobes:
    return paper.fit_frame(reference, begin, steps=steps, loss=loss, on_step=on_step)


def coarsened(reference: Tensor, rows: int) -> Tensor:
    """Average a map down; a smaller one stays.  [H, W, 3]."""
    rows = min(rows, len(reference))
    return latlong.reduce(reference, rows, 2 * rows)


def judged(
    reference: Tensor, fits: Sequence[Fit], plan: Plan, follow: Follow, *, with_balls: Any
) -> Still:
    """Judge fits on a map, and render balls under it and under some of them.

    Args:
        reference: The map.  [H, W, 3]
        fits: The fits.
        plan: How large balls are.
        follow: Shows how far this is.
        with_balls: Tells whether a fit has balls.
    """
    height, width, _ = reference.shape
    maps = torch.stack([texels.texel_means(fit.lobes, height, width).float() for fit in fits])
    errors = maps_errors(maps, reference)
    shown = [index for index, fit in enumerate(fits) if with_balls(fit)]
    balls = _balls(torch.cat([reference[None], maps[shown]]), plan.ball_size, follow)
    found = dict(zip(shown, balls[1:], strict=True))
    rows = []
    for index, fit in enumerate(fits):
        own = found.get(index)
        of_balls = () if own is None else ball_errors(own, balls[0])
        rows.append(Row(fit, errors[index].values, maps[index], own, of_balls))
    return Still(reference, balls[0], tuple(rows))


def _balls(maps: Tensor, size: int, follow: Follow) -> Tensor:
    """Render each roughness by itself, so that progress can be shown.  [K, R, S, S, 3]."""
    each = follow(ROUGHNESS, "rendering balls", len(ROUGHNESS))
    return torch.cat([render_balls(maps, (roughness,), size=size) for roughness in each], dim=1)


def ball_errors(balls: Tensor, reference: Tensor) -> tuple[float, ...]:
    """Return the sum of absolute differences over the sum, by ball.  [R, S, S, 3] each."""
    difference = (balls - reference).abs().sum((1, 2, 3))
    return tuple((difference / reference.sum((1, 2, 3)).clamp(min=1e-30)).tolist())


def by_label(rows: Sequence[Row], method: str) -> Iterator[tuple[str, list[Row]]]:
    """Return the fits of a method, gathered by label: of an ablation one a start."""
    labels = dict.fromkeys(row.fit.label for row in rows if row.fit.method == method)
    for label in labels:
        yield (
            label,
            [row for row in rows if (row.fit.method, row.fit.label) == (method, label)],
        )
