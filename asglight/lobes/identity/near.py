# SPDX-License-Identifier: Apache-2.0
"""Which lobes are on one lamp, those within each other's widths, and where they turn on to."""

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes

WIDTH_MAX = 0.35
"""Radians, 20 degrees: a broad lobe is near to lobes within these, not to half of the sphere."""


REACH = 2.0
"""Of lobes on one lamp, in the geometric mean of both widths: as far as two see that are as wide as
each other, and less where one is much wider. A sky lobe about a lamp that is switched on turns by
tens of degrees, and the lamp stays. Half-way between frames of lamps that chase each other, irr is
half of what it is with the sum of both widths."""


def nearest(lobes: Lobes, among: Tensor) -> tuple[Tensor, Tensor]:
    """Return which of some lobes is nearest to each, in their widths.

    Args:
        lobes: Of one frame, or of several.  [..., N, .]
        among: Which may be it, for all [N] or [..., 1, N], or for each lobe [..., N, N]; never the
            lobe itself.

    Returns:
        The index of the nearest, and whether it is within `REACH`.  [..., N] each
    """
    narrow = lobes.sharpness.amin(-1)
    width = (asg.per_variance(lobes.form) * narrow).rsqrt().clamp(max=WIDTH_MAX)
    angle = torch.acos((lobes.axis_z @ lobes.axis_z.mT).clamp(-1, 1))
    itself = torch.eye(lobes.count, dtype=torch.bool, device=among.device)
    both = (width[..., None, :] * width[..., None]).sqrt()
    closest, index = torch.where(among & ~itself, angle / both, torch.inf).min(-1)
    return index, closest < REACH


def onward(before: Lobes, earlier: Lobes, known: Tensor) -> Tensor:
    """Return where lobes are in the next frame if they turn on as they did.

    A lobe that is new turns with the one that it is near to: lobes on one lamp move together.

    Args:
        before: The frame before.  [N, .]
        earlier: The frame before that.  [N, .]
        known: Which of them were lit then.  [N]

    Returns:
        Their axes z.  [N, 3]
    """
    beside, is_near = nearest(before, known)
    own = torch.arange(before.count, device=beside.device)
    leader = torch.where(known | ~is_near, own, beside)
    turned = _along_great_circle(before.axis_z, earlier.axis_z[leader], before.axis_z[leader])
    return torch.where((known | is_near)[:, None], turned, before.axis_z)


def _along_great_circle(directions: Tensor, start: Tensor, end: Tensor) -> Tensor:
    """Turn directions as from a start to an end on its great circle.  [N, 3] each."""
    axis = torch.linalg.cross(start, end)
    across = torch.linalg.cross(axis, directions)
    cosine = (start * end).sum(-1, keepdim=True)
    # Rodrigues' formula without the angle; opposite ends have no shortest way, and stay
    again = torch.linalg.cross(axis, across) / (1 + cosine).clamp(min=1e-6)
    return torch.nn.functional.normalize(directions + across + again, dim=-1)
