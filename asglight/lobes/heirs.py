# SPDX-License-Identifier: Apache-2.0
"""Which track goes on where lobes of one lamp end: the one that has been there longest.

A lamp that comes near is seen by several lobes, one that goes away by one again. Which of its lobes
are given up is decided by what the frames show, not by which came first. So where a track ends
beside a younger one that goes on, both being on one lamp, the older track takes over the path of
the younger, which ends in its stead. The light of every frame stays as it is.

A lamp that is switched off beside another one is not told from that: names are worth no more than
this, and light between the frames is off only by the way from the one lobe to the other, within
their own widths.
"""

import torch

from asglight.lobes.data import Lobes
from asglight.lobes.near import nearest


def inherited(lobes: Lobes) -> Lobes:
    """Let the oldest track of a lamp go on.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, its tracks' later frames exchanged where one inherits.  [F, N, .]
    """
    lit = (lobes.amplitude > 0).any(-1)
    order = torch.arange(lobes.count).expand(lit.shape).clone()  # the lobe of each track
    begun = torch.full((lobes.count,), -1)  # the frame in which each track's path began
    for frame in range(len(lit)):
        now = lit[frame, order[frame]]
        begun = torch.where(now, torch.where(begun < 0, frame, begun), -1)
        if frame + 1 == len(lit):
            break
        shown = lobes[frame].select(order[frame])
        for ended in torch.nonzero(now & ~lit[frame + 1, order[frame + 1]]).flatten().tolist():
            going = now & lit[frame + 1, order[frame + 1]]
            index, is_near = nearest(shown, going & (begun > begun[ended]))
            if is_near[ended]:
                heir = int(index[ended])
                order[frame + 1 :, [ended, heir]] = order[frame + 1 :, [heir, ended]]
    return lobes[torch.arange(len(lit))[:, None], order]
