# SPDX-License-Identifier: Apache-2.0
"""Which track goes on where lobes of one lamp begin and end.

A lamp that comes near is seen by several lobes, one that goes away by one again; two lamps that
part are seen by one lobe, then by two. Which of its lobes are given up, and which is the new one,
is decided by what the frames show, not by which came first. So

- where a track begins beside one that goes on, the one that is nearer to where that one would have
  turned to is the old one;
- where a track ends beside a younger one that goes on, both being on one lamp, the older takes over
  the path of the younger, which ends in its stead.

The light of every frame stays as it is. A lamp that is switched off beside another one is not told
from that: names are worth no more than this, and light between the frames is off only by the way
from the one lobe to the other, within their own widths.
"""

import torch
from torch import Tensor

from asglight.lobes.data import Lobes
from asglight.lobes.near import nearest, onward


def inherited(lobes: Lobes) -> Lobes:
    """Let tracks go on with the lamps that they are on.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, its tracks' later frames exchanged where one takes over.  [F, N, .]
    """
    lit = (lobes.amplitude > 0).any(-1)
    order = torch.arange(lobes.count).expand(lit.shape).clone()  # the lobe of each track
    begun = torch.full((lobes.count,), -1)  # the frame in which each track's path began
    for frame in range(len(lit)):
        now = lit[frame, order[frame]]
        begun = torch.where(now, torch.where(begun < 0, frame, begun), -1)
        if frame + 1 == len(lit):
            break
        _part(lobes, lit, order, frame)
        _hand_over(lobes, lit, order, frame, begun)
    return lobes[torch.arange(len(lit))[:, None], order]


def _part(lobes: Lobes, lit: Tensor, order: Tensor, frame: int) -> None:
    """Exchange a track that begins after a frame and one that goes on, where that is nearer.

    Args:
        lobes: A shot.  [F, N, .]
        lit: Which are lit.  [F, N]
        order: The lobe of each track, changed in place after the frame.  [F, N]
        frame: The frame.
    """
    before, now = lobes[frame].select(order[frame]), lit[frame, order[frame]]
    expected = before.axis_z
    if frame:
        known = now & lit[frame - 1, order[frame - 1]]
        expected = onward(before, lobes[frame - 1].select(order[frame - 1]), known)
    for new in torch.nonzero(~now & lit[frame + 1, order[frame + 1]]).flatten().tolist():
        after = lobes[frame + 1].select(order[frame + 1])
        beside, is_near = nearest(after, now & lit[frame + 1, order[frame + 1]])
        if is_near[new]:
            old = int(beside[new])
            cosine = after.axis_z[[new, old]] @ expected[old]
            if cosine[0] > cosine[1]:
                _exchange(order, frame + 1, new, old)


def _hand_over(lobes: Lobes, lit: Tensor, order: Tensor, frame: int, begun: Tensor) -> None:
    """Exchange a track that ends with a frame and a younger one that goes on, on one lamp.

    Args:
        lobes: A shot.  [F, N, .]
        lit: Which are lit.  [F, N]
        order: The lobe of each track, changed in place after the frame.  [F, N]
        frame: The frame.
        begun: The frame in which each track's path began.  [N]
    """
    shown, now = lobes[frame].select(order[frame]), lit[frame, order[frame]]
    for ended in torch.nonzero(now & ~lit[frame + 1, order[frame + 1]]).flatten().tolist():
        going = now & lit[frame + 1, order[frame + 1]] & (begun > begun[ended])
        heir, is_near = nearest(shown, going)
        if is_near[ended]:
            _exchange(order, frame + 1, ended, int(heir[ended]))


def _exchange(order: Tensor, first: int, one: int, other: int) -> None:
    """Exchange two tracks from a frame on, in place."""
    order[first:, [one, other]] = order[first:, [other, one]]
