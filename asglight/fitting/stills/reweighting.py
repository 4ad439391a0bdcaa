# SPDX-License-Identifier: Apache-2.0
"""No error of any map lags behind the others: the rounds of first_frame, each with its own."""

from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.reweighting import (
    FACTOR,
    FACTOR_LEAST,
    ROUNDS,
    STEPS,
    lags_of_each,
    own_value,
)
from asglight.fitting.loss import objective
from asglight.fitting.steps import newton
from asglight.fitting.stills.frames import picked, put, with_weights


def balanced_each(
    found: newton.Outcome, frames: objective.Target, aims: Tensor, width_min: float
) -> newton.Outcome:
    """Take the steps of `reweighting.reweighted` in each map in which an error lags behind.

    Args:
        found: Lobes that took steps.
        frames: The maps, with J's own weights.
        aims: What the errors of each are to come to.  [F, 5]
        width_min: Sigma of the narrowest lobe allowed, radians.

    Returns:
        The lobes, with the value of J by its own weights.
    """
    lag, value = lags_of_each(found, frames, aims), own_value(found, frames)
    weights, factor = torch.ones_like(lag), torch.full_like(lag[:, 0], FACTOR)
    for _ in range(ROUNDS):
        index = torch.nonzero((lag.amax(-1) > 1) & (factor >= FACTOR_LEAST))[:, 0]
        if not len(index):
            break
        some, before = picked(frames, index), lag[index]
        heavier = weights[index] * torch.where(before > 1, factor[index, None], 1.0)
        lobes = found.lobes[index]
        ahead = newton.minimise(lobes, with_weights(some, heavier), STEPS, width_min=width_min)
        after = lags_of_each(ahead, some, aims[index])
        lit, value_ahead = before[:, 1:].amax(-1), own_value(ahead, some)
        fall = before.amax(-1) / after.amax(-1)
        costs_more = (lit <= 1) & (value_ahead > fall * value[index])
        worse = (after[:, 1:].amax(-1) > lit.clamp(min=1.0)) | (fall <= 1) | costs_more
        factor[index[worse]] = factor[index[worse]].sqrt()
        taken = index[~worse]
        lag[taken], weights[taken] = after[~worse], heavier[~worse]
        value[taken] = value_ahead[~worse]
        found = put(found, taken, ahead[~worse])
    return replace(found, value=own_value(found, frames))
