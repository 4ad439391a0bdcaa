# SPDX-License-Identifier: Apache-2.0
"""Two-sided temporal refinement: every frame of a shot once more, between both its neighbours.

Frame by frame, a fit knows only what came before. Here steps are taken with the temporal term
towards both neighbours, first for the frames at even places and then for those at odd ones: a
Gauss-Seidel sweep. Frames of one kind are no neighbours, so a GPU has them all at once. The term is
a norm (temporal.py): between two places that a lamp passes it pulls to neither, and a track that is
dark in a neighbour is not held by it, so a cut is a cut. Neighbours are turned with the camera:
what stands still in front of one that shakes is held where it is.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import Exposed, narrowest, with_flux_of
from asglight.fitting.following.camera import turned_with_it
from asglight.fitting.following.initial_guess import DAMPING_START
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes, asg
from asglight.lobes.data import chosen
from asglight.threads import side_by_side

CHUNK = 16
"""Frames in memory: 25 MB of maps of 256 rows, and half as many side by side."""

GROUP = 4
"""Frames that take steps together on the processor, where each thread has a group; a GPU has all.
They stop together, so groups must not depend on the number of threads."""


@dataclass(frozen=True)
class Refinement:
    """How a shot is refined.

    Attributes:
        sweeps: Over each chunk of frames.
        steps: Of each frame in a sweep.
        corners: phi's corners.
        gamma: Weight of the temporal term towards each neighbour: several times that towards the
            frame before, which does not know where the lobes go. With 0.02 light half-way between
            every second frame of `handheld`, fitted with `best`, is 5 % worse than that of the
            fits dissolved, with 0.05 and 0.1 it is 2 %, in the mean of both halves of the frames,
            forward and backward; at the frames 0.05 costs 1 to 2 % of r0.5, 0.1 costs 3 %.
        rise: A frame stays as it was whose J, or what materials show of it, would grow by more than
            this share.
    """

    sweeps: int = 2
    steps: int = 6
    corners: Corners = Corners(0.1, 0.005)  # noqa: RUF009  frozen
    gamma: float = 0.05
    rise: float = 0.1


Read = Callable[[], Iterable[list[Exposed]]]
"""Reads the maps of a shot in order, about `CHUNK` at a time."""

OnChunk = Callable[[int, int], None]
"""Called with how many frames are done, and how many there are."""


def refine_shot(
    lobes: Lobes,
    read: Read,
    settings: Refinement,
    *,
    threads: int = 1,
    on_chunk: OnChunk = lambda *_: None,
) -> tuple[Lobes, list[float]]:
    """Refine a shot.

    Black frames stay as they are, and so do all of a chunk where its maps differ in size.

    Args:
        lobes: Every frame as fitted, in the units of its map.  [F, N, .]
        read: Reads the maps.
        settings: How.
        threads: Frames take steps on so many at once; the shot does not depend on it.
        on_chunk: Progress.

    Returns:
        The lobes [F, N, .] and the loss of each frame.
    """
    shot, losses = lobes.clone(), [0.0] * len(lobes.axes)
    first = 0
    for frames in read():
        if len({frame.height for frame in frames}) == 1:
            for _ in range(settings.sweeps):
                _sweep(shot, losses, first, frames, settings, threads)
        first += len(frames)
        on_chunk(first, len(losses))
    return shot, losses


def _sweep(
    shot: Lobes,
    losses: list[float],
    first: int,
    frames: list[Exposed],
    settings: Refinement,
    threads: int,
) -> None:
    """Take steps for the frames of a chunk, in place.

    Args:
        shot: Every frame, in the units of its map.  [F, N, .]
        losses: J of each frame.
        first: Index of the chunk's first frame in the shot.
        frames: The maps of the chunk.
        settings: How.
        threads: Groups of frames that take steps at once.
    """
    on_gpu = frames[0].radiance.is_cuda
    for parity in (0, 1):
        own = [
            first + place
            for place, frame in enumerate(frames)
            if frame.exposure > 0 and (first + place) % 2 == parity
        ]
        size = max(len(own), 1) if on_gpu else GROUP
        groups = (own[at : at + size] for at in range(0, len(own), size))
        steps = (
            partial(_step, shot, losses, group, [frames[k - first] for k in group], settings)
            for group in groups
        )
        for _ in side_by_side(steps, 1 if on_gpu else threads):
            pass


def _step(
    shot: Lobes,
    losses: list[float],
    places: list[int],
    frames: list[Exposed],
    settings: Refinement,
) -> None:
    """Take steps for frames none of which is another's neighbour, in place."""
    whole = objective.target(torch.cat([frame.radiance for frame in frames]), settings.corners)
    index = torch.tensor(places)
    tracks, dark = _lit_first(shot[index])
    own = _gathered(shot, index, tracks, frames)
    still = dark.to(own.axes.device)
    shown = lobe_images.images(own, whole.places)
    start = light.solve_amplitudes(shown, whole, still).lobes
    found = newton.minimise(
        start,
        whole,
        settings.steps,
        priors=_priors(shot, index, tracks, frames, own, settings.gamma),
        damping=DAMPING_START,
        width_min=narrowest(frames[0].height),
        still=still,
    )
    assert found.shown is not None  # of lobes that took steps
    lit = temporal.blackened(light.last(found.shown, whole, still).lobes)
    unit = lit.axes.new_tensor([frame.exposure for frame in frames])[:, None, None]
    fits = [with_flux_of(lit[k], frame, 0.0).lobes.amplitude for k, frame in enumerate(frames)]
    lit = replace(lit, amplitude=torch.stack(fits) / unit)
    after, before = replace(found.shown, lobes=lit).radiance, shown.radiance
    kept = _risen(after, before, whole, settings.rise)
    lit = chosen(kept, own, lit)
    _scatter(shot, index, tracks, replace(lit, amplitude=lit.amplitude * unit))
    after = torch.where(kept[:, None, None], before, after)
    for place, loss in zip(places, objective.value(after, whole).tolist(), strict=True):
        losses[place] = loss


def _lit_first(lobes: Lobes) -> tuple[Tensor, Tensor]:
    """Return the tracks that are lit in each frame, and dark ones that fill up the rows.

    Args:
        lobes: Some frames.  [F', N, .]

    Returns:
        Tracks, in ascending order of those lit, [F', K], and which of them are dark [F', K].
    """
    dark = temporal.is_dark(lobes)
    order = dark.int().argsort(dim=-1, stable=True)
    most = int((~dark).sum(-1).max())
    order = order[:, : max(most, 1)]
    return order, dark.gather(-1, order)


def _priors(
    shot: Lobes, index: Tensor, tracks: Tensor, frames: list[Exposed], own: Lobes, gamma: float
) -> list[temporal.Prior]:
    """Return the temporal terms towards the frames before and after, of no weight beyond an end."""
    priors = []
    for other in ((index - 1).clamp(min=0), (index + 1).clamp(max=len(shot.axes) - 1)):
        there = _gathered(shot, other, tracks, frames)
        prior = temporal.prior(_as_seen_from(own, there), gamma)
        counts = (other != index)[:, None].to(prior.share)
        priors.append(replace(prior, share=prior.share * counts))
    return priors


def _as_seen_from(own: Lobes, there: Lobes) -> Lobes:
    """Return the lobes of another frame turned with the camera, where they are nearer for it.

    Where a camera turns, what stands still moves by one rotation. Held in place, lobes would lag.

    Args:
        own: The lobes of a frame.  [F', K, .]
        there: The same of its neighbour.  [F', K, .]
    """
    flux = torch.minimum(asg.flux(own).sum(-1), asg.flux(there).sum(-1))
    turned = turned_with_it(there, own.axis_z, flux)
    nearer = temporal.value(own, temporal.prior(turned)) < temporal.value(
        own, temporal.prior(there)
    )
    return chosen(nearer, turned, there)


def _gathered(shot: Lobes, index: Tensor, tracks: Tensor, frames: list[Exposed]) -> Lobes:
    """Return some tracks of some frames, in the units of given maps and on their device.

    Args:
        shot: Every frame.  [F, N, .]
        index: Frames.  [F']
        tracks: Of each.  [F', K]
        frames: Maps whose units are wanted.
    """
    rows = index[:, None]
    unit = torch.tensor([frame.exposure for frame in frames], dtype=torch.float32)[:, None, None]
    found = shot[rows, tracks]
    lobes = replace(found, amplitude=found.amplitude * (1 / unit))
    return lobes.to(frames[0].radiance.device)


def _scatter(shot: Lobes, index: Tensor, tracks: Tensor, lobes: Lobes) -> None:
    """Write what `_gathered` returned back, in the units of the maps."""
    rows = index[:, None]
    shot.axes[rows, tracks] = lobes.axes.to(shot.axes)
    shot.sharpness[rows, tracks] = lobes.sharpness.to(shot.axes)
    shot.amplitude[rows, tracks] = lobes.amplitude.to(shot.axes)


def _risen(after: Tensor, before: Tensor, frame: objective.Target, rise: float) -> Tensor:
    """Tell in which frames J, or its part of what materials show, grew by more than a share.  [F].

    Args:
        after: Radiance of the lobes on the adaptive cells.  [F, 3, P]
        before: What it was.  [F, 3, P]
        frame: The maps.
        rise: The share.
    """
    judged = replace(frame, corners=light.CORNERS)
    new, old = (objective.loss_terms(radiance, judged) for radiance in (after, before))
    seen = (objective.of_materials(found.seen, judged) for found in (new, old))
    materials_new, materials_old = seen
    whole = new.value > (1 + rise) * old.value
    return whole | (materials_new > (1 + rise) * materials_old)
