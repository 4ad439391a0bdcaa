# SPDX-License-Identifier: Apache-2.0
"""Which lobes are on one lamp: those within each other's widths."""

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes

WIDTH_MAX = 0.35
"""Radians, 20 degrees: a broad lobe is near to lobes within these, not to half of the sphere."""


def nearest(lobes: Lobes, among: Tensor) -> tuple[Tensor, Tensor]:
    """Return which of some lobes is nearest to each, in their widths.

    Args:
        lobes: Of one frame.  [N, .]
        among: Which may be it, for all [N] or for each lobe [N, N]; never the lobe itself.

    Returns:
        The index of the nearest [N], and whether it is within the sum of both widths [N].
    """
    narrow = lobes.sharpness.amin(-1)
    width = (asg.per_variance(lobes.form) * narrow).rsqrt().clamp(max=WIDTH_MAX)
    turned = torch.acos((lobes.axis_z @ lobes.axis_z.mT).clamp(-1, 1))
    itself = torch.eye(lobes.count, dtype=torch.bool, device=among.device)
    apart = torch.where(among & ~itself, turned / (width + width[:, None]), torch.inf)
    closest, index = apart.min(-1)
    return index, closest < 1
