# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt steps on all lobes at once.

A step solves (H + damping diag H) delta = -gradient with the Gauss-Newton matrix H of J's quadratic
majoriser (objective.py) [Marquardt 1963]; a step that does not lower J is tried again with more
damping. 15 lobes are 120 unknowns: the cost is in the images of the lobes, not in the solve.

J and its gradient are taken over every texel. H only shapes the step, so it is summed over coarse
cells, but for the blocks of lobes that are narrow for a cell, among themselves: those are summed
over texels, or such a lobe would take its curvature for none and its steps too long.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting import lobe_images, objective, temporal
from asglight.fitting.coordinates import UNKNOWNS, Leash, advance
from asglight.fitting.grid import cell_sums, coarser, grid
from asglight.fitting.lobe_images import COLUMNS, Images
from asglight.fitting.probes import probe
from asglight.lobes import Lobes, asg

OnStep = Callable[[Lobes], None]
"""Called with the lobes after a step."""

CELL_ROWS = 32
"""Rows of the grid of cells on which H is summed, at most."""

DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-2, 1e-6, 1e6
DAMPING_UP, DAMPING_DOWN = 5.0, 0.3


@dataclass(frozen=True)
class Outcome:
    """Lobes after some steps, with the state that continues them.

    Attributes:
        lobes: The lobes.  [N, .]
        value: J.
        damping: The damping of the next step.
    """

    lobes: Lobes
    value: float
    damping: float


@dataclass(frozen=True)
class _State:
    """Lobes on the grid, and J with the temporal term."""

    shown: Images
    value: float


def minimise(
    lobes: Lobes,
    frame: objective.Target,
    steps: int,
    *,
    priors: Sequence[temporal.Prior] = (),
    damping: float = DAMPING_START,
    width_min: float = 0.0,
    leash: Leash | None = None,
    tolerance: float = 1e-4,
    on_step: OnStep | None = None,
) -> Outcome:
    """Take at most `steps` accepted or hopeless steps.

    Args:
        lobes: Where to start.  [N, .]
        frame: The map and its weights.
        steps: Upper bound on Gauss-Newton matrices built.
        priors: The temporal terms, added to J: one for each neighbouring frame.
        damping: First damping.
        width_min: Sigma of the narrowest lobe allowed, radians.
        leash: Bounds on the directions.
        tolerance: Stop when a step lowers J by less than this share of it.
        on_step: Called with the lobes after each step.
    """
    state = _judged(lobes, frame, priors)
    for _ in range(steps):
        before = state.value
        hessian, gradient = normal_equations(state.shown, frame)
        for prior in priors:
            temporal.add_curvature(hessian, gradient, state.shown.lobes, prior)
        while damping <= DAMPING_MAX:
            step = _solve(hessian, gradient, state.shown.lobes, damping)
            reached = _judged(advance(state.shown.lobes, step, width_min, leash), frame, priors)
            if reached.value < before:
                state = reached
                damping = max(damping * DAMPING_DOWN, DAMPING_MIN)
                break
            damping *= DAMPING_UP
        if on_step is not None:
            on_step(state.shown.lobes)
        if before - state.value <= tolerance * before:
            break
    return Outcome(state.shown.lobes, state.value, min(damping, DAMPING_MAX))


def _judged(lobes: Lobes, frame: objective.Target, priors: Sequence[temporal.Prior]) -> _State:
    shown = lobe_images.images(lobes, frame.grid)
    value = float(objective.value(shown.radiance, frame))
    value += sum(temporal.value(lobes, prior) for prior in priors)
    return _State(shown, value)


def normal_equations(shown: Images, frame: objective.Target) -> tuple[Tensor, Tensor]:
    """Return the Gauss-Newton matrix and the gradient of J.

    Args:
        shown: The lobes on the frame's grid.
        frame: The map and its weights.

    Returns:
        H [8 N, 8 N] and g [8 N] in float64, unknowns of a lobe together, shape before light.
    """
    lobes, fine = shown.lobes, frame.grid
    misfit = objective.misfit(shown.radiance, frame)
    cells = grid(coarser(frame.height, CELL_ROWS), str(lobes.axes.device))
    near = lobe_images.near_columns(lobes, fine, cells.height)
    gradient = lobe_images.slopes(shown, near, misfit.slope, fine).double().reshape(-1)
    columns = lobe_images.cell_columns(lobes, near, fine, cells)
    gram = (columns * cell_sums(misfit.env_weight, fine.height, cells.height)) @ columns.mT
    if len(near.lobe):
        rows = (near.lobe[:, None] * COLUMNS + torch.arange(COLUMNS).to(near.lobe)).flatten()
        sharp = near.columns.flatten(0, 1)
        gram[rows[:, None], rows] = (sharp * misfit.env_weight[near.texel]) @ sharp.mT
    for view, curvature in zip(probe(columns, cells.height), misfit.probe_weights, strict=True):
        gram += (view * curvature) @ view.mT
    return _chain(gram.double(), lobes.amplitude.double()), gradient


def _chain(gram: Tensor, amplitude: Tensor) -> Tensor:
    """Go from columns to unknowns: a shape unknown moves each channel by the lobe's amplitude."""
    count = amplitude.shape[0]
    blocks = gram.reshape(count, COLUMNS, count, COLUMNS)
    shape_light = torch.einsum("ikj,ic->ikjc", blocks[:, 1:, :, 0], amplitude)
    hessian = gram.new_zeros(count, UNKNOWNS, count, UNKNOWNS)
    hessian[:, :5, :, :5] = blocks[:, 1:, :, 1:] * (amplitude @ amplitude.mT)[:, None, :, None]
    hessian[:, :5, :, 5:] = shape_light
    hessian[:, 5:, :, :5] = shape_light.permute(2, 3, 0, 1)
    for channel in range(5, 8):
        hessian[:, channel, :, channel] = blocks[:, 0, :, 0]
    return hessian.reshape(count * UNKNOWNS, count * UNKNOWNS)


def _solve(hessian: Tensor, gradient: Tensor, lobes: Lobes, damping: float) -> Tensor:
    """Solve the damped system; unknowns at a bound that would cross it stay.  [N, 8]."""
    step_gradient = gradient.reshape(lobes.count, UNKNOWNS)
    held = torch.zeros_like(step_gradient, dtype=torch.bool)
    held[:, 2:4] = (lobes.sharpness <= asg.SHARPNESS_MIN) & (step_gradient[:, 2:4] > 0)
    held[:, 5:] = (lobes.amplitude <= 0) & (step_gradient[:, 5:] > 0)
    free = ~held.reshape(-1)
    diagonal = torch.diagonal(hessian)
    # unknowns that nothing in the map sees get unit curvature, far above their gradient of 0
    curvature = torch.where(
        diagonal > 1e-12 * diagonal.max(), diagonal, diagonal.max().clamp(min=1e-300)
    )
    matrix = torch.where(free[:, None] & free[None, :], hessian, 0.0)
    matrix = matrix + torch.diag(torch.where(free, damping * curvature, 1.0))
    # scaled to unit diagonal: sharpness and radiance differ by ten orders of magnitude
    scale = torch.diagonal(matrix).clamp(min=1e-300).rsqrt()
    scaled = matrix * scale[:, None] * scale[None, :]
    right = torch.where(free, -gradient, 0.0) * scale
    factor, failed = torch.linalg.cholesky_ex(scaled)
    if int(failed):
        return torch.zeros_like(step_gradient)
    return (torch.cholesky_solve(right[:, None], factor)[:, 0] * scale).reshape(-1, UNKNOWNS)
