# SPDX-License-Identifier: Apache-2.0
"""Lobes that a frame misses least go at once to where light is lacking, lit.

Where a lamp is switched on, or turns by tens of degrees from frame to frame, no lobe on a leash
comes to where the light is. Then those that are missed least go there, as in a first frame
(regroup.py), and the others stay: they are still the same lamps. Right light comes before a lobe
that does not jump.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from asglight.fitting import newton, objective, regroup, sending
from asglight.fitting.coordinates import Leash
from asglight.lobes import Lobes
from asglight.lobes.data import stack

ROUNDS = 3
"""Lobes that go, at most. With 6, or with one of the two cheapest in each round, a lamp that turns
by 20 degrees a frame is lit no better, for up to twice the time."""

STEPS = 4
"""Steps of a trial. It is on few leaves, and only has to tell that J will be lower."""

GAIN = 0.1
"""Share of J that a trial must gain."""


class Rearranged(NamedTuple):
    """Lobes of which some have gone elsewhere.

    Attributes:
        lobes: All of them.  [1, N, .]
        leash: Without hold on those that went.
    """

    lobes: Lobes
    leash: Leash


def rearranged(
    lobes: Lobes, frame: objective.Target, leash: Leash, width_min: float
) -> Rearranged | None:
    """Send lobes, one in each round, while that gains enough.

    Args:
        lobes: The fit of a frame.  [N, .]
        frame: The map on few leaves.
        leash: How far each lobe may go that stays.
        width_min: Sigma of the narrowest lobe allowed, radians.

    Returns:
        The lobes after some steps, or None where none went.
    """
    best = newton.minimise(lobes[None], frame, STEPS, width_min=width_min, leash=leash)
    released = torch.zeros(lobes.count, dtype=torch.bool, device=lobes.axes.device)
    for _ in range(ROUNDS):
        gone, trials = _trials(best, frame, width_min)
        going = released.clone()
        going[gone] = True
        found = newton.minimise(
            stack(trials),
            frame.repeated(len(trials)),
            STEPS,
            width_min=width_min,
            leash=_let_go(leash, going),
        )
        if float(found.value.min()) > (1 - GAIN) * float(best.value):
            break
        released, best = going, found.best()
    if not bool(released.any()):
        return None
    return Rearranged(best.lobes, _let_go(leash, released))


def _let_go(leash: Leash, released: Tensor) -> Leash:
    return Leash(leash.axis_z, torch.where(released, -1.0, leash.cosine))


def _trials(
    best: newton.Outcome, frame: objective.Target, width_min: float
) -> tuple[int, list[Lobes]]:
    """Return which lobe is missed least, and the lobes with it where it may go.

    It goes to where the sharpest material lacks most light, or is half of the lobe that most of J
    lies on, if there is another.
    """
    shown = best.shown
    assert shown is not None  # of lobes that took steps
    costs, filled = regroup.absences(shown, frame)
    gone = int(costs.argmin())
    own = torch.arange(len(costs)) == gone
    splits = regroup.ordered(shown, frame, torch.where(own, costs.cpu(), torch.inf))[:1]
    rest = regroup.without(gone, best.lobes[0], filled, width_min)
    trials = [sending.sent(rest, own.to(rest.axes.device), frame)]
    return gone, trials + [regroup.halved(rest, *split) for split in splits]
