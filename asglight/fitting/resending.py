# SPDX-License-Identifier: Apache-2.0
"""Lobes that a frame can spare go to where one lobe stands for two, unseen.

A lamp that comes near takes many lobes, and the faint light that it drowns holds them back. A lobe
that is seen may not jump, so one that is not goes dark for a frame, pointing to where the next one
will light it. Whether that is worth while, and where it goes, a trial split tells (regroup.py).
"""

from dataclasses import dataclass, replace

import torch

from asglight.fitting import lobe_images, objective, regroup, temporal
from asglight.fitting.trials import Effort, compete
from asglight.lobes import Lobes
from asglight.lobes.data import stack

WORTH = 0.06
"""J from which it is worth while to look for one: ten real maps and slow skies stay below."""

SPARE_COST = 5e-3
"""A lobe is spare if J grows by less than this share without it. In a tunnel, whose lamps come and
go, there nearly always is one; under a sky that changes slowly, seldom; in a room, never."""

TRIALS = 2
"""Splits that compete: of the lobe that most of J lies on, along its axes."""

GAIN = 0.1
"""Share of J that a trial must gain: far more than the frame in which the lobe is dark loses."""


@dataclass(frozen=True)
class Resent:
    """A lobe that goes dark.

    Attributes:
        index: Which.
        lobe: What it is when the next frame lights it, black.  [1, .]
    """

    index: int
    lobe: Lobes


def resent(
    lobes: Lobes,
    before: Lobes,
    frame: objective.Target,
    loss: float,
    width_min: float,
    effort: Effort,
) -> Resent | None:
    """Choose a lobe to send, if that gains enough.

    Args:
        lobes: The fit of a frame.  [N, .]
        before: The same lobes one frame before.  [N, .]
        frame: The map, on a coarse grid.
        loss: J of the fit.
        width_min: Sigma of the narrowest lobe allowed, radians.
        effort: How much is spent on a trial.
    """
    if loss < WORTH:
        return None
    may_go = temporal.is_faint(lobes) & temporal.is_faint(before) & (lobes.amplitude.amax(-1) > 0)
    if not bool(may_go.any()):
        return None
    shown = lobe_images.images(lobes[None], frame.places)
    costs, filled = regroup.absences(shown, frame)
    may_go &= (costs < SPARE_COST * loss).to(may_go.device)
    if not bool(may_go.any()):
        return None
    splits = regroup.ordered(shown, frame, torch.where(may_go, costs, torch.inf))[:TRIALS]
    trials = [regroup.carried_out(each, lobes, filled, width_min) for each in splits]
    gone = [splits[0].gone, *(each.gone for each in splits)]
    found, value = compete(stack([lobes, *trials]), gone, frame, effort, width_min=width_min)
    best = 1 + int(value[1:].argmin())
    if float(value[best]) > (1 - GAIN) * float(value[0]):
        return None
    sent = found[best].select(torch.tensor([gone[best]]))
    return Resent(gone[best], replace(sent, amplitude=torch.zeros_like(sent.amplitude)))
