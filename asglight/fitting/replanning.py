# SPDX-License-Identifier: Apache-2.0
"""Lobes that some frames of a shot can spare are lit elsewhere in them, planned ahead and back.

Frame by frame a lobe is sent where light is lacking then; nobody knows yet for how long, nor what
it will be missed for. Where lamps rush past, a third of the lobes is dark at any time, and as many
light what nobody misses. Here all frames are known: in each, trials of one lobe more tell where it
would gain, and the Gauss-Newton matrix what each lobe is missed there. The plan that is worth most
(plans.py) is carried out, then the next on other frames. Their frames take steps, and a plan stays
where materials show less wrong in its frames together.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.fitting import lobe_images, newton, objective, regroup, temporal
from asglight.fitting.between import CORNERS, Chunk, bounds, in_units, on, put, sweep
from asglight.fitting.coordinates import Between, Leash, pulled_back
from asglight.fitting.first_frame import narrowest
from asglight.fitting.following import DAMPING_START, LEASH_DEG
from asglight.fitting.plans import Places, Plan, best_plan
from asglight.fitting.sending import SPLITS, elsewhere
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.matching import flux_shares

STEPS = 4
"""Of a trial, on few leaves: it only has to tell where J will be lower. With eight, errors in a
tunnel are 2 % smaller, for twice the trials' time."""

GAIN = 0.05
"""Share of a frame's J that one lobe more must gain there, as where a free lobe is sent."""

WORTH = 4e-3
"""J that a plan must be worth, a tenth of that of one frame where few lamps are near."""

WORSE = 0.1
"""Share by which materials may show more wrong in a single frame of a plan, one where the lobe is
dark: without, irr of single frames of a tunnel came to three times what it was."""

SPARE_COST = 0.1
"""Trials are made where J grows by less than this share without the cheapest lobe: in rooms with
many lamps it grows by more, and nothing is planned."""

FADED_SHARE = 0.8 * temporal.FAINT_SHARE
"""Of the flux, for a lobe that is about to turn: its frame's flux changes a little still."""

COSINE = math.cos(math.radians(LEASH_DEG))
REACHED = COSINE - 1e-6
"""A direction that a plan has within the leash is within it however its cosine is rounded."""


class Survey(NamedTuple):
    """What plans are made of.

    Attributes:
        places: Where one lobe more would gain, and what each lobe is missed.
        lobes: The lobe in each of the places, in units of the fit.  [F', K, .]
    """

    places: Places
    lobes: Lobes


def replan(shot: Lobes, chunk: Chunk, allowed: Tensor, later: int) -> None:
    """Carry out the plans that are worth most in a chunk, in place, and keep those that gain.

    Args:
        shot: Every frame, in the units of its map.  [F, N, .]
        chunk: Frames that all have taken steps.
        allowed: Which lobes may be lit anew in which of its frames: not those of plans that failed,
            which are noted here.  [F', N]
        later: Rounds of plans before this one.
    """
    survey = _surveyed(shot, chunk, later)
    before, losses, materials = shot.clone(), list(chunk.losses), list(chunk.materials)
    carried = []
    while (plan := best_plan(survey.places, COSINE, allowed)) is not None and plan.worth > WORTH:
        touched = _carry_out(shot, chunk, plan, survey)
        carried.append((plan, touched))
        survey.places.open[max(touched[0] - 1, 0) : touched[-1] + 2] = False  # none is beside it
    sweep(shot, chunk, [place for _, touched in carried for place in touched])
    for plan, touched in carried:
        if _gains([(materials[place], chunk.materials[place]) for place in touched]):
            continue
        index = torch.tensor(touched) + chunk.first
        put(shot, index, before[index])
        for place in touched:
            chunk.losses[place], chunk.materials[place] = losses[place], materials[place]
        allowed[plan.first : plan.last + 1, plan.lobe] = False


def _gains(materials: list[tuple[float, float]]) -> bool:
    """Tell whether materials show less wrong in all frames of a plan together, in none much more.

    Args:
        materials: J's part of what they show in each frame, before and after.
    """
    before, after = (sum(each) for each in zip(*materials, strict=True))
    return after < before and all(new < (1 + WORSE) * old for old, new in materials)


def _surveyed(shot: Lobes, chunk: Chunk, later: int) -> Survey:
    """Return where one lobe more would gain in a chunk, and what each lobe is missed."""
    count = len(chunk.frames)
    tried = [_unlit(shot)] * count
    gain = torch.full((count, tried[0].count), -math.inf)
    cost = torch.full((count, shot.count), math.inf)
    for place in chunk.places:
        frame, index = chunk.frames[place], torch.tensor([chunk.first + place])
        coarse = objective.trial_target(frame.radiance, CORNERS)
        own = in_units(shot, index, [frame])
        shown = lobe_images.images(own, coarse.places)
        cost[place] = regroup.absences(shown, coarse)[0].clamp(min=0).to(cost)
        loss = chunk.losses[place]
        if float(cost[place].min()) < SPARE_COST * loss:
            leash = on(bounds(shot, index).leash, own.axes.device)
            found, gained = _trials(own, coarse, leash, narrowest(frame.height), later)
            tried[place] = found.to(shot.axes)
            gain[place] = torch.where(gained > GAIN * loss, gained, -math.inf).to(gain)
    lobes, beyond = stack(tried), torch.zeros_like(shot.axis_z[:1])
    around = torch.cat([beyond, shot.axis_z, beyond])[chunk.first : chunk.first + count + 2]
    places = Places(
        lobes.axis_z,
        gain,
        cost,
        around[:-2],
        around[2:],
        cost.isfinite().all(-1),
        starts=chunk.first == 0,
        ends=chunk.first + count == len(shot.axes),
    )
    return Survey(places, lobes)


def _unlit(shot: Lobes) -> Lobes:
    """Return what stands for the trials of a frame without any.  [K, .]."""
    return shot[0].select(torch.zeros(SPLITS + 1, dtype=torch.long))


def _trials(
    own: Lobes, frame: objective.Target, leash: Between, width_min: float, later: int
) -> tuple[Lobes, Tensor]:
    """Try one lobe more: as half of the lobe that most of J lies on, and where light is lacking.

    Args:
        own: The lobes of a frame.  [1, N, .]
        frame: The map on few leaves.
        leash: How far they may go.
        width_min: Sigma of the narrowest lobe allowed, radians.
        later: Rounds of plans before this one, whose splits are not tried again.

    Returns:
        The lobe after some steps of all [K, .], and by how much lower J is with it than after the
        same steps without it [K].
    """
    index = own.count
    more = own.select(torch.tensor([*range(index), 0]))[0]
    more.amplitude[index] = 0.0
    held = Between(_and_a_free_one(leash.before), _and_a_free_one(leash.after), more.axis_z[None])
    found = newton.minimise(
        pulled_back(stack([more, *elsewhere(more, index, frame, later)]), held),
        frame.repeated(SPLITS + 2),
        STEPS,
        damping=DAMPING_START,
        width_min=width_min,
        leash=held,
    )
    return found.lobes[1:, index], found.value[0] - found.value[1:]


def _and_a_free_one(leash: Leash) -> Leash:
    """Return a leash for one lobe more, which may go anywhere.  [1, N] -> [1, N + 1]."""
    free = torch.full_like(leash.cosine[:, :1], -1.0)
    axis_z = torch.cat([leash.axis_z, leash.axis_z[:, :1]], dim=1)
    return Leash(axis_z, torch.cat([leash.cosine, free], dim=1))


def _carry_out(shot: Lobes, chunk: Chunk, plan: Plan, survey: Survey) -> list[int]:
    """Light a lobe where a plan says, dark before and after where it has to turn, in place.

    Returns:
        The frames that changed, of the chunk.
    """
    touched = list(range(plan.first, plan.last + 1))
    for place, choice in zip(touched.copy(), plan.places, strict=True):
        frame, lobe = chunk.first + place, survey.lobes[place, choice]
        shot.axes[frame, plan.lobe] = lobe.axes
        shot.sharpness[frame, plan.lobe] = lobe.sharpness
        shot.amplitude[frame, plan.lobe] = lobe.amplitude * chunk.frames[place].exposure
    for place, step in ((plan.first, -1), (plan.last, 1)):
        for beside in _darkened(shot, chunk.first + place, plan.lobe, step):
            touched.append(beside - chunk.first)
    return sorted(touched)


def _darkened(shot: Lobes, frame: int, lobe: int, step: int) -> list[int]:
    """Let a lobe be dark beside a frame where it would have to turn; return the frames changed.

    In the next frame it waits, dark, and in the one after it has its old place, and is faint.

    Args:
        shot: Every frame.  [F, N, .]
        frame: Where it is lit.
        lobe: Which.
        step: 1 for the frames after, -1 for those before.
    """
    waits, turned = frame + step, frame + 2 * step
    own = shot.axis_z[:, lobe]
    if not 0 <= waits < len(own) or float(own[waits] @ own[frame]) > REACHED:
        return []
    for part in (shot.axes, shot.sharpness):
        part[waits, lobe] = part[frame, lobe]
    shot.amplitude[waits, lobe] = 0.0
    if not 0 <= turned < len(own) or float(own[turned] @ own[waits]) > REACHED:
        return [waits]
    share = float(flux_shares(shot[turned])[lobe])
    shot.amplitude[turned, lobe] *= FADED_SHARE / max(share, FADED_SHARE)
    return [waits, turned]
