# SPDX-License-Identifier: Apache-2.0
"""The pass over a whole shot: each frame between its two neighbours, many frames side by side.

Frame by frame, a fit knows only what came before. Here every frame takes some more steps with the
temporal term towards both neighbours, first the frames at even places and then those at odd ones:
frames of one kind are no neighbours, so a GPU has them all at once. The term is a norm
(temporal.py) and lets a cut be a cut. A lit lobe keeps
within reach of where both neighbours have it, and a dark one stays dark.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, temporal
from asglight.fitting.coordinates import Leash
from asglight.fitting.first_frame import Exposed, narrowest, with_flux_of
from asglight.fitting.following import DAMPING_START, LEASH_DEG
from asglight.fitting.objective import Corners
from asglight.lobes import Lobes, asg
from asglight.lobes.data import chosen

CHUNK = 16
"""Frames in memory: 25 MB of maps of 256 rows, and half as many side by side."""

STEPS = 7
CORNERS = Corners(0.1, 0.005)

GAMMA = 0.05
"""Weight of the temporal term towards each neighbour: five times that towards the frame before,
which does not know where the lobes go."""

HELD = 1e3
"""Weight of the temporal term that keeps a lobe as it is: far above all else in J."""

RISE = 0.1
"""A frame stays as it was whose own J would grow by more than this share, or what materials show of
it, with the corners of a fit's last light: where lamps rush past, what its neighbours hold is no
guide. By all of J alone single frames of a tunnel came to three times their irr."""

JUMP_DEG = 10.0
"""A lobe that turns further was dark and sent, or there is a cut. One at the end of its leash of
9.9 degrees is neither, however its angle is rounded."""

CUT_SHARE = 0.5
"""Between frames that are no cut, less than this share of the flux that both have jumps."""


def refine_shot(
    lobes: Lobes, chunks: Iterable[list[Exposed]]
) -> Iterator[tuple[int, Lobes, list[float]]]:
    """Refine a shot some frames at a time.

    Args:
        lobes: Every frame as fitted, in the units of its map.  [F, N, .]
        chunks: The maps in order, about `CHUNK` at a time.

    Yields:
        Index of the first frame of a chunk, the chunk's lobes [F', N, .] and its losses.
    """
    shot = temporal.waiting(lobes).clone()
    first = 0
    for frames in chunks:
        losses = _refine(shot, first, frames)
        yield first, shot[first : first + len(frames)].clone(), losses
        first += len(frames)


def _refine(shot: Lobes, first: int, frames: list[Exposed]) -> list[float]:
    """Refine the frames of a chunk in place; return their losses.

    Black frames stay as they are, and so do all where the maps differ in size.
    """
    losses = [0.0] * len(frames)
    if len({frame.height for frame in frames}) > 1:
        return losses
    for parity in (0, 1):
        places = [
            place
            for place, frame in enumerate(frames)
            if (first + place) % 2 == parity and frame.exposure > 0
        ]
        if not places:
            continue
        index = torch.tensor(places) + first
        stepped, values = _between(shot, index, [frames[place] for place in places])
        for place, loss in zip(places, values, strict=True):
            losses[place] = loss
        shot.axes[index] = stepped.axes.to(shot.axes)
        shot.sharpness[index] = stepped.sharpness.to(shot.axes)
        shot.amplitude[index] = stepped.amplitude.to(shot.axes)
    return losses


def _between(shot: Lobes, index: Tensor, frames: list[Exposed]) -> tuple[Lobes, list[float]]:
    """Take steps for frames none of which is another's neighbour.

    Args:
        shot: The whole shot.  [F, N, .]
        index: Which frames of it.  [F']
        frames: Their maps.
    """
    maps = torch.cat([frame.radiance for frame in frames])
    unit = 1 / torch.tensor([frame.exposure for frame in frames])[:, None, None]

    def at(which: Tensor) -> Lobes:
        found = shot[which]
        return replace(found, amplitude=found.amplitude * unit).to(maps.device)

    own = at(index)
    neighbours = [(index - 1).clamp(min=0), (index + 1).clamp(max=len(shot.axes) - 1)]
    beside = [at(which) for which in neighbours]
    turned = [_turned_deg(own, other) for other in beside]
    same_shot = [
        _same_shot(own, other, angle) & (which != index).to(maps.device)
        for other, angle, which in zip(beside, turned, neighbours, strict=True)
    ]
    priors = [
        _weighed(temporal.prior(other, GAMMA), same)
        for other, same in zip(beside, same_shot, strict=True)
    ]
    held = [
        torch.where(same[:, None], angle, 0.0)
        for same, angle in zip(same_shot, turned, strict=True)
    ]
    furthest = torch.maximum(*held)
    # a dark lobe may be on its way, and one that was sent far may not light up where it waits
    stays = temporal.is_dark(own) | (furthest > JUMP_DEG)
    still = temporal.prior(own)
    priors.append(replace(still, share=HELD * stays.to(still.share)))
    room = (LEASH_DEG - furthest).clamp(min=0)
    whole = objective.target(maps, CORNERS)
    found = newton.minimise(
        own,
        whole,
        STEPS,
        priors=priors,
        damping=DAMPING_START,
        width_min=narrowest(frames[0].height),
        leash=Leash(own.axis_z, torch.cos(torch.deg2rad(room))),
    )
    shown = found.shown
    assert shown is not None  # of lobes that took steps
    lit = light.last(shown, whole).lobes
    capped = torch.minimum(lit.amplitude, own.amplitude)
    lit = replace(lit, amplitude=torch.where(stays[..., None], capped, lit.amplitude))
    fits = [with_flux_of(lit[k], frame, 0.0) for k, frame in enumerate(frames)]
    lit = replace(lit, amplitude=torch.stack([fit.lobes.amplitude for fit in fits]) * unit)
    showed = lobe_images.images(own, whole.places).radiance
    shows = replace(shown, lobes=lit).radiance
    kept = _risen(shows, showed, whole)
    lit = chosen(kept, own, lit)
    losses = objective.value(torch.where(kept[:, None, None], showed, shows), whole)
    return replace(lit, amplitude=lit.amplitude / unit), losses.tolist()


def _risen(after: Tensor, before: Tensor, frame: objective.Target) -> Tensor:
    """Tell in which frames J, or its part of what materials show, grew by more than `RISE`.  [F].

    Args:
        after: Radiance of the lobes on the leaves.  [F, 3, P]
        before: What it was.  [F, 3, P]
        frame: The maps.
    """
    judged = replace(frame, corners=light.CORNERS)
    new, old = objective.sizes(after, judged), objective.sizes(before, judged)
    materials = [objective.of_materials(found.seen, judged) for found in (new, old)]
    return (new.value > (1 + RISE) * old.value) | (materials[0] > (1 + RISE) * materials[1])


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


def _weighed(held: temporal.Prior, same: Tensor) -> temporal.Prior:
    return replace(held, share=held.share * same[:, None])
