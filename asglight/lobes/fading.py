# SPDX-License-Identifier: Apache-2.0
"""Where a track is that is dark: it ends its path as it fades out, and begins one as it fades in.

Between a frame in which a light is lit and the next, in which it is dark, a program shows it fade.
A lamp that goes out of sight moves on meanwhile, and a lobe that takes over part of a lamp comes
along with it. So the first dark frame after a path, and the last one before a path, carry it on:
with the turn of the lobe beside it on its lamp that is lit in both frames, for these move together;
where there is none, with the turn of the path's own last two frames.
"""

import itertools
from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes.data import Lobes
from asglight.lobes.frames import continuous
from asglight.lobes.identity.near import beside

AT_ONCE = 256
"""Ends of paths that are looked at together: among 30 lobes, distances between them take 2 MB."""


def carried_on(lobes: Lobes) -> Lobes:
    """Place black lobes on the paths that they end or begin.

    A track that is dark for one frame alone is on the path that it ends. Otherwise it waits where
    the next path begins, from its second dark frame on, or after its last path where that ended.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, continuous, with other axes and sharpness of black lobes.  [F, N, .]
    """
    shot = continuous(lobes)
    lit = (shot.amplitude > 0).any(-1)
    axes, sharpness = shot.axes.clone(), shot.sharpness.clone()
    fading = torch.nonzero(lit.any(0) & ~lit.all(0)).flatten().tolist()
    stretches = [
        (index, first, last, end)
        for index in fading
        for first, last, end in _dark_stretches(lit[:, index].tolist())
    ]
    for begin in range(0, len(stretches), AT_ONCE):
        part = stretches[begin : begin + AT_ONCE]
        ends = torch.tensor([end for _, _, _, end in part])
        # from the end of each path a step into the dark
        beyond = ends + torch.tensor([1 if end < first else -1 for _, first, _, end in part])
        nearest, is_led = beside(shot[ends], lit[ends] & lit[beyond])
        for place, (index, first, last, end) in enumerate(part):
            leader = int(nearest[place, index]) if bool(is_led[place, index]) else None
            turn = _turn(shot, lit, index, end, int(beyond[place]), leader)
            axes[first : last + 1, index] = shot.axes[end, index] @ turn.mT
            sharpness[first : last + 1, index] = shot.sharpness[end, index]
    return replace(shot, axes=axes, sharpness=sharpness)


def _dark_stretches(lit: list[bool]) -> list[tuple[int, int, int]]:
    """Return dark frames of a track, from one to another, and the end of the path they belong to.

    Args:
        lit: Whether it is lit in each frame; in one at least.
    """
    found: list[tuple[int, int, int]] = []
    frames = [frame for frame, shines in enumerate(lit) if shines]
    if frames[0] > 0:
        found.append((0, frames[0] - 1, frames[0]))
    for before, after in itertools.pairwise(frames):
        if after - before > 1:
            found.append((before + 1, before + 1, before))
        if after - before > 2:
            found.append((before + 2, after - 1, after))
    if frames[-1] < len(lit) - 1:
        found.append((frames[-1] + 1, len(lit) - 1, frames[-1]))
    return found


def _turn(
    shot: Lobes, lit: Tensor, index: int, end: int, beyond: int, leader: int | None
) -> Tensor:
    """Return the rotation that carries a path on beyond one of its ends.  [3, 3].

    Args:
        shot: The lobes.  [F, N, .]
        lit: Which are lit.  [F, N]
        index: The track.
        end: The path's last frame, or its first.
        beyond: The dark frame next to it.
        leader: The lobe beside it on its lamp, lit in both; None for none.
    """
    if leader is not None:
        return shot.axes[beyond, leader].mT @ shot.axes[end, leader]
    inner = 2 * end - beyond
    if not 0 <= inner < len(lit) or not bool(lit[inner, index]):
        return torch.eye(3).to(shot.axes)
    return shot.axes[end, index].mT @ shot.axes[inner, index]
