# SPDX-License-Identifier: Apache-2.0
"""Free lobes go to where they are needed: dark ones, that nobody saw turn there.

A lamp that passes overhead moves further from frame to frame than a lit lobe may turn. Lobes that
are free take over from those that cannot keep up, which fade behind it and are free in their turn.
A few steps tell whether a place is worth a free lobe: one that is sent to a poor place goes dark
again, and is missed where it is needed a frame later.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, regroup, temporal
from asglight.fitting.coordinates import Leash, pulled_back
from asglight.fitting.leaves import to_cells
from asglight.fitting.probes import PROBES, directions, probe, split
from asglight.fitting.trials import THOROUGH, Effort, compete
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around

LACKING_SHARE = 5e-3
"""Filtered radiance lacking at a place, over the largest there is, that is worth a free lobe."""

SHARPNESS = 60.0
"""Of a lobe newly sent: sigma = 5 degrees, about the probe that found the place."""

ROUNDS = 2
"""Lobes lit in a frame, at most: with 4 the next frames have none left more often."""

SPLITS = 2
"""Splits that compete with the place that lacks most light: of the lobe that most of J lies on."""

GAIN = 0.05
"""Share of J that a trial must gain; with less, lobes go where they are worth little and are
missed later."""


@dataclass(frozen=True)
class Sending:
    """How much is spent on free lobes.

    Attributes:
        before: Steps of the lit lobes on few leaves before the first trial.
        trial: What each trial takes.
        loss: J of a frame's start from which it is spent.
    """

    before: int
    trial: Effort
    loss: float = 0.0


SENDING = Sending(4, THOROUGH)
"""After two steps before the first trial what lacks light is often only what has not been followed
yet."""


def is_free(before: Lobes, earlier: Lobes | None) -> Tensor:
    """Tell which lobes may be lit anywhere.

    Those that were dark, and so faint the frame before that they could turn while they faded.

    Args:
        before: The frame before.  [N, .]
        earlier: The frame before that, if there is one.  [N, .]
    """
    free = temporal.is_dark(before)
    return free if earlier is None else free & temporal.is_faint(earlier)


def lit_where_worth(
    start: newton.Outcome,
    free: Tensor,
    frame: objective.Target,
    leash: Leash,
    width_min: float,
    effort: Sending,
) -> Lobes:
    """Light free lobes one by one, each where a few steps gain most.

    One that the start lit where it was may have taken the light of a lobe beside it, which then is
    dark and held there while a lamp elsewhere waits. So the others come first, and its old place is
    one of those that compete.

    Args:
        start: The lobes with their light for this frame.  F = 1
        free: Which are free.  [N]
        frame: The map on few leaves.
        leash: How far each lobe may go.
        width_min: Sigma of the narrowest lobe allowed, radians.
        effort: How much is spent.

    Returns:
        The lobes after some steps.  [N, .]
    """
    as_started = start.lobes[0]
    in_place = free & ~temporal.is_dark(as_started)
    if bool(in_place.any()):
        start = _free_dark(start, free, frame)
    lit = ~free
    others = start.lobes.select(lit)
    stepped = newton.minimise(
        others,
        frame,
        effort.before,
        priors=[temporal.prior(others)],
        damping=start.damping,
        width_min=width_min,
        leash=Leash(leash.axis_z[lit], leash.cosine[lit]),
    )
    best = start.lobes[0].replaced(lit, stepped.lobes[0])
    for _ in range(ROUNDS):
        idle = free & temporal.is_dark(best)
        if not bool(idle.any()):
            break
        index = int((idle.int() + (idle & in_place).int()).argmax())
        trials = [best, *elsewhere(best, index, frame)]
        if bool(in_place[index]):
            own = torch.tensor([index])
            trials.append(best.replaced(own, as_started.select(own)))
        found, value = compete(
            pulled_back(stack(trials), leash),
            [index] * len(trials),
            frame,
            effort.trial,
            width_min=width_min,
            leash=leash,
            damping=start.damping,
        )
        if float(value[1:].min()) > (1 - GAIN) * float(value[0]):
            break
        best = found[int(value.argmin())]
    return best


def _free_dark(start: newton.Outcome, free: Tensor, frame: objective.Target) -> newton.Outcome:
    """Return the start with all free lobes dark, the light of the others solved for without them.

    Args:
        start: The lobes with their light.  F = 1
        free: Which are free.  [N]
        frame: The map on few leaves.
    """
    others = lobe_images.images(start.lobes[0].select(~free)[None], frame.places)
    lit = light.relight(others, frame).lobes[0]
    black = replace(start.lobes[0], amplitude=torch.zeros_like(start.lobes.amplitude[0]))
    return replace(start, lobes=black.replaced(~free, lit)[None], shown=None)


def elsewhere(lobes: Lobes, index: int, frame: objective.Target) -> list[Lobes]:
    """Return the lobes with a dark one in each place that it may be worth.

    Args:
        lobes: All lobes.  [N, .]
        index: The dark one.
        frame: The map on few leaves.
    """
    shown = lobe_images.images(lobes[None], frame.places)
    may_go = torch.full((lobes.count,), torch.inf)
    may_go[index] = 0.0
    splits = regroup.ordered(shown, frame, may_go)[:SPLITS]
    own = torch.zeros(lobes.count, dtype=torch.bool, device=lobes.axes.device)
    own[index] = True
    return [*(regroup.halved(lobes, *split) for split in splits), sent(lobes, own, frame)]


def sent(lobes: Lobes, free: Tensor, frame: objective.Target) -> Lobes:
    """Send each free lobe to the place where the sharpest probe lacks most light.

    Args:
        lobes: All lobes.  [N, .]
        free: Which are free.  [N]
        frame: The map and its weights.
    """
    sharpest = PROBES[-1]
    rows = frame.places.rows
    wanted = split(probe(to_cells(frame.radiance, frame.places), rows), rows)[-1][0]  # [3, D]
    brightest = float(wanted.sum(0).max())
    places = directions(sharpest, rows).to(wanted)
    axes, sharpness = lobes.axes.clone(), lobes.sharpness.clone()
    amplitude = lobes.amplitude.clone()
    for index in torch.nonzero(free).flatten().tolist():
        current = Lobes(axes, sharpness, amplitude, lobes.form)[None]
        shown = lobe_images.images(current, frame.places).radiance
        lacking = wanted - split(probe(to_cells(shown, frame.places), rows), rows)[-1][0]
        place = int(lacking.sum(0).argmax())
        if float(lacking[:, place].sum()) < LACKING_SHARE * brightest:
            break
        axes[index] = axes_around(places[place])
        sharpness[index] = SHARPNESS
        amplitude[index] = lacking[:, place].clamp(min=0)
    return Lobes(axes, sharpness, amplitude, lobes.form)
