# SPDX-License-Identifier: Apache-2.0
"""Tracks as slots: a shot with N lobes has 2 N tracks, and at most N of them are lit in a frame.

A light that ends in one frame and another that begins in the next are two tracks, so that between
the frames one fades out where it was and the other fades in where it is. A track that is dark for
two frames is free: in the first of them it ends its old path, in the second it begins a new one
(`lobes.fading`). Tracks that are never lit are left out, so a still scene has N. The lights of a
track are about as wide as each other: a card shows what is narrow, a dome what is broad, and what a
track is shown by holds for the whole shot.
"""

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import dark_lobes
from asglight.fitting.loss import temporal
from asglight.fitting.options import TRACKS_PER_LOBE
from asglight.lobes import Lobes, asg
from asglight.lobes.data import joined


def with_spare_tracks(lobes: Lobes) -> Lobes:
    """Return the lobes of a first frame with as many dark tracks.  [N, .] -> [2 N, .]."""
    spare = (TRACKS_PER_LOBE - 1) * lobes.count
    return joined(lobes, dark_lobes(spare, lobes.form, lobes.axes))


def free_tracks(before: Lobes, earlier: Lobes | None) -> Tensor:
    """Tell which tracks were dark in both frames before this one.  [2 N]."""
    dark = temporal.is_dark(before)
    return dark if earlier is None else dark & temporal.is_dark(earlier)


def track_for(lobe: Lobes, free: Tensor, dark: Tensor, before: Lobes) -> int:
    """Return the track that a new light takes: a dark one that was lit there, or a free one.

    A lamp that is off for a frame comes back in its own track, for that does not have to move. Of
    free tracks it is the one whose light was most nearly as wide.

    Args:
        lobe: The light.  [1, .]
        free: Which tracks are free; at least one.  [2 N]
        dark: Which were dark in the frame before.  [2 N]
        before: Where the tracks were.  [2 N, .]
    """
    apart = torch.where(dark, way(lobe, before)[0], torch.inf)
    nearest = int(apart.argmin())
    if float(apart[nearest]) < 1:
        return nearest
    return int(torch.where(free, unlike(lobe, before)[0], torch.inf).argmin())


def widths(lobes: Lobes) -> Tensor:
    """Return the widths along the shorter axis and the longer, radians, at most 1.  [..., N, 2]."""
    sigmas = (asg.per_variance(lobes.form) * lobes.sharpness).rsqrt().clamp(max=1.0)
    return sigmas.sort(-1).values


def way(lobes: Lobes, others: Lobes) -> Tensor:
    """Return how far others are from lobes, in place and widths, in widths of the lobes.

    The 2-Wasserstein distance of two Gaussians [Olkin and Pukelsheim 1982], as if their axes were
    parallel, over the lobe's longer width. Below 1 they are the same light.  [K], [N] -> [K, N].
    """
    wider = widths(lobes)[:, None] - widths(others)
    square = turned(lobes, others).square() + wider.square().sum(-1)
    return square.sqrt() / widths(lobes)[:, None, 1]


def unlike(lobes: Lobes, others: Lobes) -> Tensor:
    """Return by how much lobes differ, squared: widths in factors e, places in radians.

    A sun that comes out from behind a cloud is nearer to where it was than any other light as wide
    is.  [K], [N] -> [K, N].
    """
    ratio = widths(lobes).log()[:, None] - widths(others).log()
    return ratio.square().sum(-1) + turned(lobes, others).square()


def turned(lobes: Lobes, others: Lobes) -> Tensor:
    """Return the angles between lobes, radians.  [K], [N] -> [K, N]."""
    return torch.acos((lobes.axis_z @ others.axis_z.mT).clamp(-1, 1))


def afresh(fresh: Lobes, before: Lobes, free: Tensor) -> list[int]:
    """Return the tracks of lobes that were fitted from nothing.

    One that is as a lit track was, within its own width, is the same light. The others take
    tracks that are free, then those that are dark, then any; of these, ones about as wide.

    Args:
        fresh: The lobes.  [N, .]
        before: The tracks one frame before.  [2 N, .]
        free: Which are free.  [2 N]
    """
    from scipy.optimize import linear_sum_assignment  # half a second, for cuts alone

    dark = temporal.is_dark(before)
    # a light that is the same costs its way; one that is free less than one in use
    apart, other = way(fresh, before), unlike(fresh, before)
    taken = (~free).float() + (~dark).float()
    cost = torch.where((apart < 1) & ~dark, apart, 2.0 + taken + other / (1 + other))
    cost = cost + 1e-6 * torch.arange(before.count)
    return linear_sum_assignment(cost.cpu().double().numpy())[1].tolist()
