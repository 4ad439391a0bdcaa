# SPDX-License-Identifier: Apache-2.0
"""The lamps that lobes show: which lobes are on one, where its light is, and how wide it is.

Two lobes are on one lamp if it is bright all the way from the one to the other, in what all lobes
together show. So a broad lobe around a lamp is none of it, and a long lamp is one, however many
lobes it takes. A lamp's place is the mean direction of its light; its width is the root mean square
angle from there, that of its lobes included.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes

BRIGHT_SHARE = 0.1
"""Of the brightest on the way: where less is seen, something dark lies between two lamps. With 0.3
the same lobes are on one lamp in a tunnel."""

STEPS = 9
"""Places looked at on the way, no farther apart than the narrower lobe's sigma: nothing dark is
between them unseen. Lobes that are farther from each other are on one lamp by others between."""


@dataclass(frozen=True)
class Lamps:
    """The lamps of one frame, by lobe.

    Attributes:
        number: Of the lamp that a lobe is on; -1 for a black lobe.  [N]
        centre: Where that lamp is.  [N, 3]
        off_centre: How far the lobe is from there, in widths of the lamp.  [N]
    """

    number: Tensor
    centre: Tensor
    off_centre: Tensor


def lamps(lobes: Lobes, flux: Tensor) -> Lamps:
    """Return the lamps of a frame.

    Args:
        lobes: In float64 on the CPU.  [N, .]
        flux: Theirs, channels summed.  [N]
    """
    lit = torch.nonzero((lobes.amplitude > 0).any(-1)).flatten()
    own = lobes.select(lit)
    belongs = _connected(_bright_between(own)).double()  # [K, K]
    number = (belongs.cumsum(-1) == 0).sum(-1)  # the lamp's first lobe
    flux = flux[lit]
    centre = torch.nn.functional.normalize(belongs @ (flux[:, None] * own.axis_z), dim=-1)
    angle = (own.axis_z * centre).sum(-1).clamp(-1, 1).acos()
    square = belongs @ (flux * (angle.square() + variance(own).sum(-1))) / (belongs @ flux)
    every = lobes.amplitude.new_zeros(lobes.count)
    return Lamps(
        torch.full((lobes.count,), -1).index_copy(0, lit, number),
        torch.zeros_like(lobes.axis_z).index_copy(0, lit, centre),
        every.index_copy(0, lit, angle / square.sqrt()),
    )


def variance(lobes: Lobes) -> Tensor:
    """Return the mean square angle along each axis, at most 1.  [..., N, 2]."""
    return (1 / (asg.per_variance(lobes.form) * lobes.sharpness)).clamp(max=1.0)


def _connected(near: Tensor) -> Tensor:
    """Tell which are near to each other, by way of others at most.  [K, K]."""
    reached = near | near.mT | torch.eye(len(near), dtype=torch.bool)
    for _ in range(len(near).bit_length()):  # each time by ways twice as long
        reached = (reached.double() @ reached.double()) > 0
    return reached


def _bright_between(lobes: Lobes) -> Tensor:
    """Tell between which lobes, not too far to be looked at, it is bright all the way.  [K, K]."""
    first, last = torch.triu_indices(lobes.count, lobes.count, 1)
    sigma = variance(lobes).amax(-1).sqrt()
    apart = (lobes.axis_z[first] * lobes.axis_z[last]).sum(-1).clamp(-1, 1).acos()
    is_seen = apart <= (STEPS - 1) * torch.minimum(sigma[first], sigma[last])
    first, last = first[is_seen], last[is_seen]
    share = torch.linspace(0, 1, STEPS).to(lobes.axes)[:, None, None]
    way = torch.lerp(lobes.axis_z[first], lobes.axis_z[last], share)  # [STEPS, pairs, 3]
    way = torch.nn.functional.normalize(way, dim=-1)
    seen = asg.evaluate(lobes, way.view(-1, 3)).sum(-1).view(way.shape[:-1])
    bright = torch.zeros(lobes.count, lobes.count, dtype=torch.bool)
    bright[first, last] = seen.amin(0) >= BRIGHT_SHARE * seen.amax(0)
    return bright
