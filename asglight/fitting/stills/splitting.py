# SPDX-License-Identifier: Apache-2.0
"""Splits and merges of many maps at once: in a round each tries its own, as split_merge.py does."""

from collections.abc import Iterator
from functools import partial
from itertools import islice

import torch
from torch import Tensor

from asglight.fitting.first_frame.split_merge import (
    GAIN,
    SETTLING_STEPS,
    STEPS,
    TRIAL_STEPS,
    TRIALS,
    Split,
    carried_out_each,
    leave_one_out_costs_of_each,
    lying_on,
    ranked,
)
from asglight.fitting.loss import objective
from asglight.fitting.steps import newton
from asglight.fitting.stills.frames import chosen, picked


def split_and_merge_each(
    start: newton.Outcome,
    frame: objective.Target,
    coarse: objective.Target,
    rounds: int,
    width_min: float,
    on_step: newton.OnStep | None = None,
) -> newton.Outcome:
    """Try splits, the worst lobes of each map first, until all fail or the rounds are over.

    Args:
        start: A fit of each map.
        frame: The maps and their weights.
        coarse: The same on few adaptive cells.
        rounds: At most; `TRIALS` splits of each map compete in each.
        width_min: Sigma of the narrowest lobe allowed, radians.
        on_step: Called with the lobes after each step before the first round, and each round.
    """
    if start.lobes.count < 2:
        return start
    held = partial(newton.minimise, width_min=width_min)
    best = held(start.lobes, frame, SETTLING_STEPS, on_step=on_step)
    splits, filled = _to_try(best, frame)
    of_trial = torch.arange(len(filled), device=filled.device).repeat_interleave(TRIALS)
    fewer = picked(coarse, of_trial)
    for _ in range(rounds):
        competing = [list(islice(each, TRIALS)) for each in splits]
        if not any(competing):
            break
        trying = torch.tensor([bool(each) for each in competing], device=filled.device)
        every = [split for each in competing for split in _filled_up(each)]
        gone = torch.tensor([split.gone for split in every]).to(filled.device)
        begun = carried_out_each(every, best.lobes[of_trial], filled[of_trial, gone], width_min)
        trials = held(begun, fewer, TRIAL_STEPS)
        least = trials.value.unflatten(0, (-1, TRIALS)).argmin(-1)
        winners = torch.arange(len(least), device=filled.device) * TRIALS + least
        found = held(trials.lobes[winners], frame, STEPS)
        better = trying & (found.value < (1 - GAIN) * best.value)
        best = chosen(better, found, best)
        fresh, ahead = _to_try(best, frame)
        filled = torch.where(better[:, None, None, None], ahead, filled)
        kept = better.tolist()
        splits = [
            new if keeps else old for keeps, new, old in zip(kept, fresh, splits, strict=True)
        ]
        if on_step is not None:
            on_step(best.lobes)
    return best


def _filled_up(splits: list[Split]) -> list[Split]:
    """Return `TRIALS` splits; a map that has none left takes any, which do not count."""
    last = splits[-1] if splits else Split(0, 1, 0)
    return [*splits, *[last] * (TRIALS - len(splits))]


def _to_try(best: newton.Outcome, frames: objective.Target) -> tuple[list[Iterator[Split]], Tensor]:
    """Return the splits of each fit in the order of their trials, and the steps that fill gaps."""
    assert best.shown is not None  # of lobes that took steps
    loss_gradient = objective.loss_gradient(best.shown.radiance, frames)
    costs, filled = leave_one_out_costs_of_each(best.shown, loss_gradient, frames)
    own = lying_on(best.shown, frames)
    form = best.lobes.form
    pairs = zip(own.cpu(), costs.cpu(), strict=True)
    return [iter(ranked(*each, form)) for each in pairs], filled
