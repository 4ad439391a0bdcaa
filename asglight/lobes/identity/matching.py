# SPDX-License-Identifier: Apache-2.0
"""Which lobe of a frame is which lobe of the frame before, where their order means nothing."""

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes


def matched(lobes: Lobes, before: Lobes) -> Lobes:
    """Reorder lobes that were fitted from nothing so that they turn least, the bright before all.

    Args:
        lobes: The lobes of a frame.  [N, .]
        before: Those of the frame before.  [N, .]
    """
    from scipy.optimize import linear_sum_assignment  # a third of a second to load

    angle = torch.acos((before.axis_z @ lobes.axis_z.mT).clamp(-1, 1))  # [N, N]
    cost = angle * torch.maximum(flux_shares(before)[:, None], flux_shares(lobes)[None, :])
    _, order = linear_sum_assignment(cost.cpu().numpy())
    return lobes.select(torch.from_numpy(order).to(angle.device))


def flux_shares(lobes: Lobes) -> Tensor:
    """Return each lobe's share of the flux, RGB summed; zeros where all is dark.  [N]."""
    flux = asg.flux(lobes).sum(-1)
    return flux / flux.sum().clamp(min=torch.finfo(flux.dtype).tiny)
