# SPDX-License-Identifier: Apache-2.0
"""A camera that turns: one rotation for all lobes.

It moves all lamps by the same rotation. Each lobe by itself finds a part of the way, and its shape
changes with it; together they find the rotation, and keep their shapes.
"""

from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.following.pull_in import REACH
from asglight.lobes import Lobes, asg

TURNS_LEAST = 1e-9
"""Share of what lobes say that speaks for no turn: more than rounding, less than any of them."""


def turned_with_it(lobes: Lobes, seen: Tensor, flux: Tensor) -> Lobes:
    """Turn all lobes by the one rotation that best brings them to where they are seen.

    The least squares of Wahba [1965, "A Least Squares Estimate of Satellite Attitude"], by singular
    values [Markley 1988]. A mean direction is known to the variance over the flux, so a lobe weighs
    by its flux over its variance. None counts as narrower than `REACH`: one lamp that moves by
    itself is not to speak for all. What several rotations do as well, as with one lobe, that does
    which turns least.

    Args:
        lobes: As they were.  [F, N, .]
        seen: Where each is seen: unit vectors.  [F, N, 3]
        flux: How much of it is seen there.  [F, N]
    """
    variance = 1 / (asg.per_variance(lobes.form) * lobes.sharpness).mean(-1)
    weight = (flux / (variance + REACH**2)).double()[..., None]
    least = TURNS_LEAST * weight.sum(-2, keepdim=True).clamp(min=torch.finfo(weight.dtype).tiny)
    profile = (weight * seen.double()).mT @ lobes.axis_z.double()
    left, _, right = torch.linalg.svd(profile + least * torch.eye(3).to(profile))
    handed = torch.ones_like(left[..., 0])
    handed[..., 2] = torch.det(left @ right)  # 1, or -1 for a mirror
    turn = (left * handed[..., None, :]) @ right
    axes = lobes.axes.double() @ turn.mT[..., None, :, :]
    return replace(lobes, axes=axes.to(lobes.axes))
