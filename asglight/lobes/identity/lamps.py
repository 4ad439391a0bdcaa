# SPDX-License-Identifier: Apache-2.0
"""The lamps that lobes show: which lobes are on one, where its light is, and how wide it is.

Two lobes are on one lamp if it is bright all the way from the one to the other, in what all lobes
together show. So a broad lobe around a lamp is none of it, and a long lamp is one, however many
lobes it takes. A lamp's place is the mean direction of its light; its width is the root mean square
angle from there, that of its lobes included.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes

BROAD = math.radians(15)
"""Sigma, the root mean square of both axes, above which a lobe is broad and shows no lamp. Where
broad lobes are judged by themselves first (switches.py), irr half-way between frames is lower by up
to 6 % (docs/experiments/2026-11-29-smooth-irradiance.md)."""

BRIGHT_SHARE = 0.1
"""Of the brightest on the way: where less is seen, something dark lies between two lamps. With 0.3
the same lobes are on one lamp in a tunnel."""

STEPS = 9
"""Places looked at on the way, no farther apart than the narrower lobe's sigma: nothing dark is
between them unseen. Lobes that are farther from each other are on one lamp by others between."""


PAIRS_AT_ONCE = 256
"""With 15 lobes, what is seen between so many takes 1 MB."""


@dataclass(frozen=True)
class Lamps:
    """The lamps of frames, by lobe.

    Attributes:
        number: Of the lamp that a lobe is on, counted in its frame; -1 for a black lobe.  [F, N]
        centre: Where that lamp is.  [F, N, 3]
        off_centre: How far the lobe is from there, in widths of the lamp.  [F, N]
    """

    number: Tensor
    centre: Tensor
    off_centre: Tensor


def lamps(lobes: Lobes, flux: Tensor) -> Lamps:
    """Return the lamps of each frame.

    Args:
        lobes: In float64 on the CPU.  [F, N, .]
        flux: Theirs, channels summed.  [F, N]
    """
    every = (lobes.amplitude > 0).any(-1)
    # the lit ones first, in their order, and no more black ones than it takes
    most = max(int(every.sum(-1).max()), 1)
    order = (~every).int().argsort(stable=True, dim=-1)[:, :most]
    rows = torch.arange(len(order))[:, None]
    own, lit, flux = lobes[rows, order], every[rows, order], flux[rows, order]
    flux = torch.where(lit, flux, 0.0)
    belongs = _connected(_bright_between(own, lit)) & lit[:, None] & lit[..., None]
    number = belongs.int().argmax(-1)  # the lamp's first lobe
    light = belongs.double() * flux[:, None]  # [F, K, K]
    # `normalize` leaves vectors below 1e-12 as they are
    light = light / light.amax(-1, keepdim=True).clamp(min=torch.finfo(light.dtype).tiny)
    centre = torch.nn.functional.normalize(light @ own.axis_z, dim=-1)
    angle = (own.axis_z * centre).sum(-1).clamp(-1, 1).acos()
    spread = angle.square() + variance(own).sum(-1)
    square = (light @ spread[..., None])[..., 0] / light.sum(-1)
    found = Lamps(
        torch.full(every.shape, -1),
        torch.zeros_like(lobes.axis_z),
        torch.zeros_like(lobes.sharpness[..., 0]),
    )
    found.number[rows, order] = torch.where(lit, number, -1)
    found.centre[rows, order] = centre
    found.off_centre[rows, order] = torch.where(lit, angle / square.sqrt(), 0.0)
    return found


def variance(lobes: Lobes) -> Tensor:
    """Return the mean square angle along each axis, at most 1.  [..., N, 2]."""
    return (1 / (asg.per_variance(lobes.form) * lobes.sharpness)).clamp(max=1.0)


def is_broad(lobes: Lobes) -> Tensor:
    """Tell which lobes are too broad to be on a lamp.  [..., N]."""
    return variance(lobes).mean(-1) > BROAD**2


def _connected(near: Tensor) -> Tensor:
    """Tell which are near to each other, by way of others at most.  [F, K, K]."""
    count = near.shape[-1]
    reached = near | near.mT | torch.eye(count, dtype=torch.bool)
    for _ in range(count.bit_length()):  # each time by ways twice as long
        reached = (reached.float() @ reached.float()) > 0
    return reached


def _bright_between(lobes: Lobes, lit: Tensor) -> Tensor:
    """Tell between which lobes, not too far to be looked at, it is bright all the way.

    Args:
        lobes: [F, K, .]
        lit: [F, K]

    Returns:
        Only from a lobe to a later one.  [F, K, K]
    """
    sigma = variance(lobes).amax(-1).sqrt()
    apart = (lobes.axis_z @ lobes.axis_z.mT).clamp(-1, 1).acos()
    is_seen = apart <= (STEPS - 1) * torch.minimum(sigma[..., None], sigma[..., None, :])
    bright = (is_seen & lit[..., None] & lit[:, None]).triu(1)
    every = torch.nonzero(bright)
    for frame, first, last in (pairs.unbind(-1) for pairs in every.split(PAIRS_AT_ONCE)):
        bright[frame, first, last] = _is_bright(lobes[frame], first, last)
    return bright


def _is_bright(lobes: Lobes, first: Tensor, last: Tensor) -> Tensor:
    """Tell whether it is bright from one lobe to another.

    Args:
        lobes: Those of the pair's frame.  [P, K, .]
        first: The one.  [P]
        last: The other.  [P]
    """
    pair = torch.arange(len(first))
    share = torch.linspace(0, 1, STEPS).to(lobes.axes)[:, None]
    start, end = (lobes.axis_z[pair, one, None] for one in (first, last))  # [P, 1, 3]
    way = torch.nn.functional.normalize(torch.lerp(start, end, share), dim=-1)
    values = asg.local_values(lobes, lobes.axes @ way.mT[:, None])  # [P, K, STEPS]
    seen = (values * lobes.amplitude.sum(-1)[..., None]).sum(-2)
    return seen.amin(-1) >= BRIGHT_SHARE * seen.amax(-1)
