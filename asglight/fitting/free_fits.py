# SPDX-License-Identifier: Apache-2.0
"""Frames of a shot fitted one after the other with lobes that are free to jump.

Where lamps rush past, lobes on a leash show half of what as many lobes can. Here the narrow ones go
where the frame asks for them, and one round of splits sends the lobe that is missed least where one
stands for two. Broad ones keep their leash: many places serve them alike, and they would turn for
nothing. linking.py makes tracks of such fits in which no lit lobe jumps.
"""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, regroup, temporal
from asglight.fitting.coordinates import Leash
from asglight.fitting.first_frame import Exposed, Level, narrowest, with_flux_of
from asglight.fitting.following import DAMPING_START, LEASH_DEG, start_of, stepped
from asglight.fitting.objective import Corners
from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import align

BROAD_DEG = 10.0
"""Sigma along a lobe's longer axis from which it is broad: as far as a lit lobe may turn."""

REACH_DEG = LEASH_DEG - 0.1
"""How far a linked lobe turns in a frame: the steps that come after find it within its leash."""

SOFT = Level(4, Corners(0.3, 0.02))
SHARP = Level(8, Corners(0.1, 0.005))
"""Steps before the round of splits, and after it: twice as many end no better once linked, and with
two or four rounds lobes are harder to link."""

ALONE_MAX = 0.003
"""Of what others' light alone would miss of a lobe: without, some frames of a tunnel lost a lamp or
a broad light, and had ten times their irr; with 0.001 or 0.01 irr is 3 to 10 % larger."""


@dataclass(frozen=True)
class FreeFit:
    """A frame fitted twice: with its lobes free, and as it was followed.

    Attributes:
        lobes: Free, in the units of the map.  [N, .]
        missed: How much J grows without each of them.  [N]
        followed_missed: The same of the lobes as followed.  [N]
        gain: By what share the free ones show less wrong of what materials show.
    """

    lobes: Lobes
    missed: Tensor
    followed_missed: Tensor
    gain: float


def is_broad(lobes: Lobes) -> Tensor:
    """Tell which lobes are broad along one of their axes.  [..., N]."""
    variance = 1 / (asg.per_variance(lobes.form) * lobes.sharpness)
    return variance.amax(-1) > math.radians(BROAD_DEG) ** 2


def free_fit(frame: Exposed, before: Lobes, followed: Lobes) -> FreeFit:
    """Fit a frame from the free fit of the frame before, or from its own lobes if these are nearer.

    Args:
        frame: The map. Where it is black its own lobes are what is found.
        before: The free fit of the frame before, in the units of that map.  [N, .]
        followed: The lobes of this frame as followed, in the units of the map.  [N, .]
    """
    if frame.exposure <= 0:
        nothing = torch.zeros(followed.count, dtype=torch.float64)
        return FreeFit(followed, nothing, nothing, 0.0)
    device = frame.radiance.device
    before, own = (_in_units(lobes, frame).to(device) for lobes in (before, followed))
    width_min = narrowest(frame.height)
    sharp = objective.target(frame.radiance, SHARP.corners)
    coarse = objective.trial_target(frame.radiance, SHARP.corners)
    start, _ = start_of(before, None, coarse, _leash(before), width_min)
    if float(_value(own, coarse)) < float(start.value):
        before, start = own, _begun(own)
    leash = _leash(before)
    found = stepped(
        replace(start, shown=None),  # now on the leaves of the whole map
        *(sharp, (SOFT,), temporal.prior(start.lobes), leash, width_min),
    )
    stays = leash.cosine > -1
    found = regroup.regroup(found, sharp, coarse, 1, width_min, leash=leash, stays=stays)
    found = _begun(found.lobes[0])
    found = stepped(found, sharp, (SHARP,), temporal.prior(found.lobes), leash, width_min)
    lit = align(light.relit(found, sharp).lobes[0], before)
    both = stack([lit, own])
    wrong = _materials(both, sharp).tolist()
    return FreeFit(
        with_flux_of(lit, frame, 0.0).lobes.to(followed.axes.device),
        *_missed(both, coarse).cpu(),
        gain=1 - wrong[0] / max(wrong[1], math.ulp(0.0)),
    )


def _missed(lobes: Lobes, frame: objective.Target) -> Tensor:
    """Return how much J grows without each lobe.

    That all others make up for it is told to second order, and two lobes on a lamp of their own may
    each seem to be spare because of the other: some of what the others' light alone would miss
    counts as well.

    Args:
        lobes: In two ways.  [2, N, .]
        frame: The map on few leaves.
    """
    shown = lobe_images.images(lobes, frame.places.repeated(2))
    made_up = torch.stack([regroup.absences(shown[k : k + 1], frame)[0] for k in range(2)])
    alone = light.absences(shown, frame.repeated(2))
    return made_up.clamp(min=0) + alone.clamp(max=ALONE_MAX)


def _materials(lobes: Lobes, frame: objective.Target) -> Tensor:
    """Return J's part of what materials show wrong.  [F, N, .] -> [F]."""
    many = frame.repeated(len(lobes.axes))
    shown = lobe_images.images(lobes, many.places)
    return objective.of_materials(objective.sizes(shown.radiance, many).seen, many)


def _in_units(lobes: Lobes, frame: Exposed) -> Lobes:
    return replace(lobes, amplitude=lobes.amplitude / frame.exposure)


def _leash(lobes: Lobes) -> Leash:
    """Return a leash for the broad ones that are lit."""
    held = is_broad(lobes) & ~temporal.is_dark(lobes)
    cosine = torch.where(held, math.cos(math.radians(REACH_DEG)), -1.0)
    return Leash(lobes.axis_z, cosine.to(lobes.axis_z))


def _begun(lobes: Lobes) -> newton.Outcome:
    """Return lobes that have taken no step yet.  F = 1."""
    return newton.Outcome(lobes[None], torch.empty(0), torch.tensor([DAMPING_START]))


def _value(lobes: Lobes, frame: objective.Target) -> Tensor:
    return objective.value(lobe_images.images(lobes[None], frame.places).radiance, frame)
