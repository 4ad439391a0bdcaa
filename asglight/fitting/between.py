# SPDX-License-Identifier: Apache-2.0
"""Frames of a shot once more, each between its two neighbours, many side by side.

Steps are taken with the temporal term towards both neighbours, first for the frames at even places
and then for those at odd ones: frames of one kind are no neighbours, so a GPU has them all at once.
The term is a norm (temporal.py) and lets a cut be a cut.

Between two frames a lobe either keeps within its leash, or it turns, and then it is faint in both.
A lobe that turns stays as it is. All others are free to be lit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, temporal
from asglight.fitting.coordinates import Between, Leash
from asglight.fitting.first_frame import Exposed, narrowest, with_flux_of
from asglight.fitting.following import DAMPING_START, LEASH_DEG
from asglight.fitting.objective import Corners
from asglight.lobes import Lobes, asg
from asglight.lobes.data import chosen
from asglight.threads import side_by_side

STEPS = 6
"""Of a sweep: three of six end as well as three of seven, of four 3 % worse in a tunnel."""

CORNERS = Corners(0.1, 0.005)

GAMMA = 0.02
"""Weight of the temporal term towards each neighbour: several times that towards the frame before,
which does not know where the lobes go. With 0.05 slow shots have 2 % more of r0.5, with 0.01
a hundredth more flicker."""

RISE = 0.1
"""A frame stays as it was whose own J would grow by more than this share, or what materials show of
it, with the corners of a fit's last light: where lamps rush past, what its neighbours hold is no
guide. By all of J alone single frames of a tunnel came to three times their irr."""

GROUP = 4
"""Frames that take steps together on the processor, where each thread has a group; a GPU has all.
They stop together, so groups must not depend on the number of threads."""

JUMP_DEG = 10.0
"""A lobe that turns further was dark and sent, or there is a cut. One at the end of its leash of
9.9 degrees is neither, however its angle is rounded."""

CUT_SHARE = 0.5
"""Between frames that are no cut, less than this share of the flux that both have jumps."""


@dataclass(frozen=True)
class Chunk:
    """Neighbouring frames of a shot, and how well they are fitted.

    Attributes:
        first: Index of the first in the shot.
        frames: Their maps.
        losses: J of each.
        materials: J's part of what materials show, with the corners of a fit's last light.
    """

    first: int
    frames: list[Exposed]
    losses: list[float]
    materials: list[float]

    @property
    def places(self) -> list[int]:
        """Those that are not black."""
        return [place for place, frame in enumerate(self.frames) if frame.exposure > 0]


@dataclass(frozen=True)
class Bounds:
    """What holds the lobes of some frames.

    Attributes:
        turning: Which turn from the frame before or to the next one, not across a cut.  [F', N]
        leash: How far the others may go.
    """

    turning: Tensor
    leash: Between


def sweep(shot: Lobes, chunk: Chunk, places: Sequence[int], threads: int = 1) -> None:
    """Take steps for frames of a chunk, in place.

    Args:
        shot: Every frame, in the units of its map.  [F, N, .]
        chunk: Where they are.
        places: Which of the chunk.
        threads: Groups of frames that take steps at once; what they come to does not depend on it.
    """
    on_gpu = chunk.frames[0].radiance.is_cuda
    for parity in (0, 1):
        own = [place for place in places if (chunk.first + place) % 2 == parity]
        size = max(len(own), 1) if on_gpu else GROUP
        groups = (own[at : at + size] for at in range(0, len(own), size))
        steps = (partial(_step, shot, chunk, group) for group in groups)
        for _ in side_by_side(steps, 1 if on_gpu else threads):
            pass


def _in_units(shot: Lobes, index: Tensor, frames: Sequence[Exposed]) -> Lobes:
    """Return lobes in the units in which frames are fitted.

    Args:
        shot: Every frame.  [F, N, .]
        index: Which.  [F']
        frames: Maps whose units are wanted.
    """
    exposures = torch.tensor([frame.exposure for frame in frames])[:, None, None]
    found = shot[index]
    lobes = replace(found, amplitude=found.amplitude * (1 / exposures))
    return lobes.to(frames[0].radiance.device)


def _put(shot: Lobes, index: Tensor, lobes: Lobes) -> None:
    """Write lobes into frames of a shot.

    Args:
        shot: Every frame.  [F, N, .]
        index: Which.  [F']
        lobes: In the units of the maps.  [F', N, .]
    """
    shot.axes[index] = lobes.axes.to(shot.axes)
    shot.sharpness[index] = lobes.sharpness.to(shot.axes)
    shot.amplitude[index] = lobes.amplitude.to(shot.axes)


def _bounds(shot: Lobes, index: Tensor) -> Bounds:
    """Return what holds lobes between their neighbours, on the device of the shot.

    Args:
        shot: Every frame.  [F, N, .]
        index: Frames that are no neighbours of each other.  [F']
    """
    cosine = math.cos(math.radians(LEASH_DEG))
    own, turning, leashes = shot[index], [], []
    for other in _beside(shot, index):
        same, turns = _related(shot, index, other)
        bound = same[:, None] & ~turns
        leashes.append(Leash(shot.axis_z[other], torch.where(bound, cosine, -1.0).to(shot.axes)))
        turning.append(same[:, None] & turns)
    return Bounds(turning[0] | turning[1], Between(leashes[0], leashes[1], own.axis_z))


def cuts(shot: Lobes) -> list[int]:
    """Return the frames that begin a shot of their own.

    Args:
        shot: Every frame.  [F, N, .]
    """
    index = torch.arange(len(shot.axes) - 1)
    same, _ = _related(shot, index, index + 1)
    return (torch.nonzero(~same).flatten() + 1).tolist()


def _beside(shot: Lobes, index: Tensor) -> tuple[Tensor, Tensor]:
    """Return the frames before and after; at an end of the shot a frame itself.  Two [F']."""
    return (index - 1).clamp(min=0), (index + 1).clamp(max=len(shot.axes) - 1)


def _related(shot: Lobes, index: Tensor, other: Tensor) -> tuple[Tensor, Tensor]:
    """Tell which frames are neighbours in one shot [F'], and which lobes turn there [F', N]."""
    turned = _turned_deg(shot[index], shot[other])
    same = _same_shot(shot[index], shot[other], turned) & (other != index)
    return same, turned > JUMP_DEG


def _step(shot: Lobes, chunk: Chunk, places: list[int]) -> None:
    """Take steps for frames none of which is another's neighbour, in place."""
    frames = [chunk.frames[place] for place in places]
    index = torch.tensor(places) + chunk.first
    whole = objective.target(torch.cat([frame.radiance for frame in frames]), CORNERS)
    device = whole.radiance.device
    own, held = _in_units(shot, index, frames), _bounds(shot, index)
    turning, leash = held.turning.to(device), _on(held.leash, device)
    shown = lobe_images.images(own, whole.places)
    start = light.relight(shown, whole, turning).lobes
    found = newton.minimise(
        start,
        whole,
        STEPS,
        priors=_priors(shot, index, frames),
        damping=DAMPING_START,
        width_min=narrowest(frames[0].height),
        leash=leash,
        still=turning,
    )
    assert found.shown is not None  # of lobes that took steps
    lit = light.last(found.shown, whole, turning).lobes
    unit = torch.tensor([frame.exposure for frame in frames])[:, None, None].to(device)
    fits = [with_flux_of(lit[k], frame, 0.0).lobes.amplitude for k, frame in enumerate(frames)]
    lit = replace(lit, amplitude=torch.stack(fits) / unit)
    after, before = replace(found.shown, lobes=lit).radiance, shown.radiance
    kept = _risen(after, before, whole)
    lit = chosen(kept, own, lit)
    _put(shot, index, replace(lit, amplitude=lit.amplitude * unit))
    after = torch.where(kept[:, None, None], before, after)
    losses, materials = objective.value(after, whole), _materials(after, whole)[1]
    for place, loss, part in zip(places, losses.tolist(), materials.tolist(), strict=True):
        chunk.losses[place], chunk.materials[place] = loss, part


def _priors(shot: Lobes, index: Tensor, frames: list[Exposed]) -> list[temporal.Prior]:
    """Return the temporal terms towards both neighbours, for lobes that do not turn, and no cut."""
    priors = []
    for other in _beside(shot, index):
        same, turns = _related(shot, index, other)
        prior = temporal.prior(_in_units(shot, other, frames), GAMMA)
        counts = (same[:, None] & ~turns).to(prior.share)
        priors.append(replace(prior, share=prior.share * counts))
    return priors


def _on(leash: Between, device: torch.device) -> Between:
    """Bring leashes to a device."""
    before, after = (
        Leash(each.axis_z.to(device), each.cosine.to(device))
        for each in (leash.before, leash.after)
    )
    return Between(before, after, leash.own.to(device))


def _risen(after: Tensor, before: Tensor, frame: objective.Target) -> Tensor:
    """Tell in which frames J, or its part of what materials show, grew by more than `RISE`.  [F].

    Args:
        after: Radiance of the lobes on the leaves.  [F, 3, P]
        before: What it was.  [F, 3, P]
        frame: The maps.
    """
    pairs = zip(_materials(after, frame), _materials(before, frame), strict=True)
    whole, materials = (new > (1 + RISE) * old for new, old in pairs)
    return whole | materials


def _materials(radiance: Tensor, frame: objective.Target) -> tuple[Tensor, Tensor]:
    """Return J with the corners of a fit's last light, and what materials show of it.  Two [F]."""
    judged = replace(frame, corners=light.CORNERS)
    found = objective.sizes(radiance, judged)
    return found.value, objective.of_materials(found.seen, judged)


def _turned_deg(lobes: Lobes, other: Lobes) -> Tensor:
    """Return the angle between the directions of each lobe in two frames, degrees.  [F, N]."""
    chord = (lobes.axis_z - other.axis_z).norm(dim=-1)
    return 2 * torch.rad2deg(torch.asin((chord / 2).clamp(max=1)))


def _same_shot(lobes: Lobes, other: Lobes, turned: Tensor) -> Tensor:
    """Tell which frames are not parted by a cut.  [F].

    A lobe counts by the light it has in both: one that lights up elsewhere is no cut.
    """
    flux = torch.minimum(asg.flux(lobes).sum(-1), asg.flux(other).sum(-1))
    far = (flux * (turned > JUMP_DEG)).sum(-1)
    return far < CUT_SHARE * flux.sum(-1).clamp(min=math.ulp(0.0))
