# SPDX-License-Identifier: Apache-2.0
"""Split and merge: a lobe that is hardly needed goes where one lobe stands for two.

Steps go downhill, so a fit keeps the share of lobes that its start gave to each lamp. A trial takes
away a lobe whose loss would cost little and halves one that much of J lies on, in the spirit
of split-and-merge EM [Ueda et al. 2000]. Trials compete on few adaptive cells; the winner takes
some steps on all of them, and is kept if J is lower then.

What a lobe's absence costs, with all others free to make up for it, is read off the Gauss-Newton
matrix: for its amplitudes a, a^T [(H^-1)_aa]^-1 a / 2 [Hassibi and Stork 1993]. So is the step by
which they do: -(H^-1)_.a [(H^-1)_aa]^-1 a. A trial starts from there, and not with a hole that its
first steps must fill.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.coordinates import BROAD, UNKNOWNS, advance
from asglight.fitting.steps import equations, neighbours, newton
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import orthonormal

OFFSET = 0.6
"""Of a half's centre from the whole's, in sigmas: what they lack in width they have in distance."""

HALF_LIGHT = 0.5 / math.sqrt(1 - OFFSET**2)
"""Amplitude of a half, of the whole's: it is narrower, and the two keep the flux."""

SETTLING_STEPS = 4
"""Steps before the first round: under the same corners as before, but every step counts."""

TRIAL_STEPS = 6
"""Steps of a trial on few adaptive cells: with 4 J ends 1 % higher, with 8 no lower."""

STEPS = 8
"""Steps of a winner on all adaptive cells: four trials of 12 there end no better, for thrice the
time."""

TRIALS = 4
"""Splits that compete in a round."""

GONE_MAX = 4
"""Lobes that may go for each that is halved, the cheapest. That each costs less than the next does
not tell which is missed least in the end: with the cheapest alone, one fit of a room full of lamps
ended with a J of .215, with four of .180."""

GONE_STEP = 5
"""A lobe that costs more by one place comes as late as a whole on which J lies less by five: few
rounds then try the worst lobes, and many come to all."""

GAIN = 1e-3
"""Share of J that a trial must gain: less is what more steps would bring as well."""

RIDGE = 1e-3
"""Of the unit diagonal of H, which is near singular where lobes stand in for each other."""


class Split(NamedTuple):
    """A trial.

    Attributes:
        lobe: Index of the lobe that is halved.
        gone: Index of the lobe that goes, and becomes the second half.
        axis: 0 or 1, the axis along which the halves lie.
    """

    lobe: int
    gone: int
    axis: int


def split_and_merge(
    start: newton.Outcome,
    frame: objective.Target,
    coarse: objective.Target,
    rounds: int,
    width_min: float,
    on_step: newton.OnStep | None = None,
) -> newton.Outcome:
    """Try splits, the worst lobes first, until all fail or the rounds are over.

    Args:
        start: A fit of one frame.
        frame: The map and its weights.
        coarse: The same on few adaptive cells.
        rounds: At most; `TRIALS` splits compete in each.
        width_min: Sigma of the narrowest lobe allowed, radians.
        on_step: Called with the lobes after each step before the first round, and after each round
            that is kept.
    """
    if start.lobes.count < 2:
        return start
    stepped = partial(newton.minimise, width_min=width_min)
    best = stepped(start.lobes, frame, SETTLING_STEPS, on_step=on_step)
    splits, filled = _to_try(best, frame)
    for _ in range(rounds):
        competing = list(islice(splits, TRIALS))
        if not competing:
            break
        halves = [carried_out(each, best.lobes[0], filled, width_min) for each in competing]
        moving = _moving(best.lobes, coarse, competing)
        several = coarse.repeated(len(competing))
        trials = stepped(stack(halves), several, TRIAL_STEPS, moving=moving)
        winner = trials.value.argmin(keepdim=True)
        moving = None if moving is None else moving[winner]
        found = stepped(trials.best().lobes, frame, STEPS, moving=moving)
        if float(found.value) < (1 - GAIN) * float(best.value):
            best = found
            splits, filled = _to_try(best, frame)
            if on_step is not None:
                on_step(best.lobes)
    return best


def _moving(lobes: Lobes, frame: objective.Target, splits: list[Split]) -> Tensor | None:
    """Return which lobes take steps in each trial: of many, those around the two of the split.

    None for all.  [T, K]
    """
    if lobes.count <= newton.TOGETHER:
        return None
    shown = lobe_images.images(lobes, frame.places)
    places = torch.tensor([[split.lobe, split.gone] for split in splits]).to(lobes.axes.device)
    return neighbours.around(shown, frame.places.share, places, newton.PART)


def _to_try(best: newton.Outcome, frame: objective.Target) -> tuple[Iterator[Split], Tensor]:
    """Return the splits of a fit in the order of their trials, and the steps that fill each gap."""
    assert best.shown is not None  # of lobes that took steps
    costs, filled = leave_one_out_costs(best.shown, frame)
    return iter(ordered(best.shown, frame, costs)), filled


def ordered(shown: lobe_images.Images, frame: objective.Target, costs: Tensor) -> list[Split]:
    """Return the splits to try: of the lobes that most of J lies on first, the cheapest for each.

    Args:
        shown: The lobes on the adaptive cells of one frame.
        frame: The map and its weights.
        costs: What the absence of each lobe costs; infinity for one that may not go.  [N]
    """
    return ranked(lying_on(shown, frame)[0], costs, shown.lobes.form)


def lying_on(shown: lobe_images.Images, frame: objective.Target) -> Tensor:
    """Return how much of J lies on each lobe: its share of the light where J lies.  [F, N].

    Args:
        shown: The lobes on the adaptive cells.
        frame: The maps and their weights.
    """
    error = objective.per_cell_loss(shown.radiance, frame)
    sent = shown.values * shown.lobes.amplitude.sum(-1, keepdim=True)
    taken = sent / sent.sum(1, keepdim=True).clamp(min=torch.finfo(torch.float32).tiny)
    return (taken @ error[..., None])[..., 0]


def ranked(own: Tensor, costs: Tensor, form: Form) -> list[Split]:
    """Return the splits to try, by what lies on lobes and what their absence costs.

    Args:
        own: How much of J lies on each lobe.  [N]
        costs: What the absence of each costs; infinity for one that may not go.  [N]
        form: Lobe function.
    """
    axes = 1 if form is Form.SG else 2
    cheapest = [index for index in costs.argsort().tolist() if math.isfinite(costs[index])]
    ranked: list[tuple[int, Split]] = []
    for place, lobe in enumerate(own.argsort(descending=True).tolist()):
        going = [index for index in cheapest if index != lobe][:GONE_MAX]
        for step, gone in enumerate(going):
            rank = place + GONE_STEP * step
            ranked += [(rank, Split(lobe, gone, axis)) for axis in range(axes)]
    return [split for _, split in sorted(ranked, key=lambda each: each[0])]


def carried_out(split: Split, lobes: Lobes, filled: Tensor, width_min: float) -> Lobes:
    """Return the lobes after a split.

    Args:
        split: Which.
        lobes: The lobes.  [N, .]
        filled: The steps of `leave_one_out_costs`.  [N, N, 8]
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    return halved(without(split.gone, lobes, filled, width_min), *split)


def carried_out_each(
    splits: Sequence[Split], lobes: Lobes, filled: Tensor, width_min: float
) -> Lobes:
    """Return the lobes of each trial after its split.

    Args:
        splits: One a trial.  K
        lobes: The lobes of each.  [K, N, .]
        filled: The step of `leave_one_out_costs` for the lobe that goes.  [K, N, 8]
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    gone = torch.tensor([split.gone for split in splits]).to(filled.device)
    ahead = advance(lobes, filled, width_min)
    lit = torch.arange(lobes.count, device=filled.device) != gone[:, None]
    return halved_each(replace(ahead, amplitude=ahead.amplitude * lit[..., None]), splits)


def without(gone: int, lobes: Lobes, filled: Tensor, width_min: float) -> Lobes:
    """Return the lobes with one black, the others making up for it.

    Args:
        gone: Index of the one that goes.
        lobes: The lobes.  [N, .]
        filled: The steps of `leave_one_out_costs`.  [N, N, 8]
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    ahead = advance(lobes, filled[gone], width_min)
    lit = torch.arange(lobes.count, device=lobes.axes.device) != gone
    return replace(ahead, amplitude=ahead.amplitude * lit[:, None])


def leave_one_out_costs(
    shown: lobe_images.Images, frame: objective.Target
) -> tuple[Tensor, Tensor]:
    """Return `leave_one_out_costs_of_each` of one frame.  [N] and [N, N, 8].

    Of more than `newton.TOGETHER` lobes, neighbours alone make up for each other.
    """
    found, count = objective.loss_gradient(shown.radiance, frame), shown.lobes.count
    if count <= newton.TOGETHER:
        costs, steps = leave_one_out_costs_of_each(shown, found, frame)
        return costs[0], steps[0]
    costs = torch.zeros(count, dtype=torch.float64, device=shown.scale.device)
    steps = costs.new_zeros(count, count, UNKNOWNS)
    for index in neighbours.parts(shown.lobes.axis_z, newton.PART, 0):
        own = lobe_images.images(neighbours.some(shown.lobes, index), frame.places)
        part = index[0]
        growth, undone = leave_one_out_costs_of_each(own, found, frame)
        costs[part], steps[part[:, None], part] = growth[0], undone[0]
    return costs, steps


def leave_one_out_costs_of_each(
    shown: lobe_images.Images, found: objective.LossGradient, frame: objective.Target
) -> tuple[Tensor, Tensor]:
    """Return how much J of each frame grows, to second order, when a lobe is taken away.

    Args:
        shown: The lobes on the adaptive cells.
        found: J of what they show.
        frame: The maps and their weights.

    Returns:
        The growth for each lobe [F, N], and the step of all lobes that takes its light away and
        makes up for it, in local coordinates [F, N, N, 8].
    """
    hessian = equations.normal_equations(shown, found, frame)[0]
    diagonal = torch.diagonal(hessian, dim1=-2, dim2=-1)
    least = 1e-12 * diagonal.amax(-1, keepdim=True)
    scale = torch.maximum(diagonal, least).rsqrt()
    scaled = hessian * scale[:, :, None] * scale[:, None]
    torch.diagonal(scaled, dim1=-2, dim2=-1).add_(RIDGE)
    inverse = torch.linalg.inv(scaled) * scale[:, :, None] * scale[:, None]
    blocks = inverse.unflatten(-1, (-1, UNKNOWNS))[..., 5:].transpose(1, 2)  # [F, N, 8 N, 3]
    own = torch.diagonal(blocks.unflatten(2, (-1, UNKNOWNS)), dim1=1, dim2=2).movedim(-1, 1)
    amplitude = shown.lobes.amplitude.double()[..., None]
    force = torch.linalg.solve(own[..., 5:, :], amplitude)  # [F, N, 3, 1]
    costs = 0.5 * (amplitude.mT @ force).flatten(1)
    steps = -(blocks @ force)[..., 0]
    return costs, steps.unflatten(-1, (-1, UNKNOWNS))


def halved(lobes: Lobes, lobe: int, gone: int, axis: int) -> Lobes:
    """Replace one lobe by two halves side by side, the second in the place of another lobe.

    Args:
        lobes: The lobes.  [N, .]
        lobe: Index of the lobe that is halved.
        gone: Index of the lobe that goes.
        axis: 0 or 1, the axis along which the halves lie.
    """
    return halved_each(lobes[None], [Split(lobe, gone, axis)])[0]


def halved_each(lobes: Lobes, splits: Sequence[Split]) -> Lobes:
    """Return the lobes of each trial, one of them halved as `halved` does it.

    Args:
        lobes: The lobes.  [K, N, .]
        splits: One a trial.  K
    """
    trial = torch.arange(len(splits), device=lobes.axes.device)
    lobe, gone, axis = torch.tensor(splits).T.to(trial.device)
    axes, sharpness = lobes.axes.clone(), lobes.sharpness.clone()
    amplitude = lobes.amplitude.clone()
    along = lobes.sharpness[trial, lobe, axis]
    sigma = (1 / (asg.per_variance(lobes.form) * along.double()).sqrt()).clamp(max=1.0)
    offset = (OFFSET * sigma).to(along)[:, None] * lobes.axes[trial, lobe, axis]
    narrower = (along + BROAD) / (1 - OFFSET**2) - BROAD
    widths = lobes.sharpness[trial, lobe]
    widths[trial, axis] = narrower
    if lobes.form is Form.SG:
        widths[:] = narrower[:, None]
    for index, side in ((lobe, 1.0), (gone, -1.0)):
        frame = lobes.axes[trial, lobe]
        frame[:, 2] += side * offset
        axes[trial, index] = orthonormal(frame)
        sharpness[trial, index] = widths
        amplitude[trial, index] = HALF_LIGHT * lobes.amplitude[trial, lobe]
    return Lobes(axes, sharpness, amplitude, lobes.form)
