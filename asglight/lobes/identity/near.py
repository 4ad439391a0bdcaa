# SPDX-License-Identifier: Apache-2.0
"""Which lobe is beside another on one lamp, and where lobes turn on to."""

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes
from asglight.lobes.identity.lamps import is_broad, lamps
from asglight.lobes.motion import exact


def beside(lobes: Lobes, among: Tensor) -> tuple[Tensor, Tensor]:
    """Return which lobe on the same lamp is nearest to each.

    A sky lobe about a lamp is none of it. It may turn by tens of degrees, and the lamp stays.

    Args:
        lobes: Of some frames.  [F, N, .]
        among: Which may be it; never the lobe itself.  [F, N]

    Returns:
        The index of the nearest, and whether there is one.  [F, N] each
    """
    known = exact(lobes)
    on = lamps(known, asg.flux(known).sum(-1)).number
    others = ~torch.eye(lobes.count, dtype=torch.bool) & among[:, None].cpu()
    on = torch.where(is_broad(known), -1, on)
    same = (on[:, None] == on[..., None]) & (on >= 0)[..., None]
    cosine = known.axis_z @ known.axis_z.mT
    closest, index = torch.where(same & others, cosine, -torch.inf).max(-1)
    return index.to(among.device), closest.isfinite().to(among.device)


def onward(before: Lobes, earlier: Lobes, known: Tensor) -> Tensor:
    """Return where lobes are in the next frame if they turn on as they did.

    A lobe that is new turns with the one beside it: lobes on one lamp move together.

    Args:
        before: The frame before.  [N, .]
        earlier: The frame before that.  [N, .]
        known: Which of them were lit then.  [N]

    Returns:
        Their axes z.  [N, 3]
    """
    leader, turns = torch.arange(before.count, device=known.device), known
    if not bool(known.all()):
        nearest, is_led = (found[0] for found in beside(before[None], known[None]))
        leader, turns = torch.where(known | ~is_led, leader, nearest), known | is_led
    turned = _along_great_circle(before.axis_z, earlier.axis_z[leader], before.axis_z[leader])
    return torch.where(turns[:, None], turned, before.axis_z)


def _along_great_circle(directions: Tensor, start: Tensor, end: Tensor) -> Tensor:
    """Turn directions as from a start to an end on its great circle.  [N, 3] each."""
    axis = torch.linalg.cross(start, end)
    across = torch.linalg.cross(axis, directions)
    cosine = (start * end).sum(-1, keepdim=True)
    # Rodrigues' formula without the angle; opposite ends have no shortest way, and stay
    again = torch.linalg.cross(axis, across) / (1 + cosine).clamp(min=1e-6)
    return torch.nn.functional.normalize(directions + across + again, dim=-1)
