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
from asglight.fitting.loss import lobe_images, temporal
from asglight.fitting.loss.measures import even_cells
from asglight.fitting.options import TRACKS_PER_LOBE
from asglight.lobes import Lobes, asg
from asglight.lobes.data import joined

SAME = 0.5
"""Likeness from which two lobes are the same light. Half-way between every second frame of
`tunnel` and `handheld`, eight ways each, irr is .743 and 1.033 of that of the fits dissolved
(`live`, `fast`); with .3 it is .754 and 1.050, with .7 it is .798 and 1.048."""

ROWS = 32
"""Of the images by which lobes are alike: lamps in one cell of 6 degrees are. With 64 rows irr is
.768 and 1.038 of the same."""

ALIKE = 0.2
"""A lobe whose widths are less alike is another light. Sky lobes that go to a lamp come to .11 or
less, lamps that pass in `tunnel` to .3 or more."""

FADED = 0.02
"""A lobe that keeps a smaller share of its light, or had one, and turns by more than its width, is
another light. Of lamps that fade over into each other it is .002 to .015."""

FAR = 1e3
"""More than lobes can be unlike: 2 log(3e-4)^2 + pi^2 is 140."""


def with_spare_tracks(lobes: Lobes) -> Lobes:
    """Return the lobes of a first frame with as many dark tracks.  [N, .] -> [2 N, .]."""
    spare = (TRACKS_PER_LOBE - 1) * lobes.count
    return joined(lobes, dark_lobes(spare, lobes.form, lobes.axes))


def free_tracks(before: Lobes, earlier: Lobes | None) -> Tensor:
    """Tell which tracks were dark in both frames before this one.  [2 N]."""
    dark = temporal.is_dark(before)
    return dark if earlier is None else dark & temporal.is_dark(earlier)


def tracks_for(lobes: Lobes, origin: list[int], known: Lobes, free: Tensor) -> list[int]:
    """Return the track of each light: that of the lit light that it is, or one for a new light.

    A lobe that is still like what its track has come to keeps it. Of the others it does not count
    where they come from: one that looks like what a track has lost is that light. Pairs are taken
    by likeness, the most alike first.

    Args:
        lobes: The lights of a frame.  [K, .]
        origin: The track that each comes from; -1 for none.  K
        known: The tracks: where lit ones have come to, where dark ones were.  [2 N, .]
        free: Which are free.  [2 N]
    """
    dark = temporal.is_dark(known)
    likeness = torch.where(dark, 0.0, alike(lobes, known))
    found = {
        light: track
        for light, track in enumerate(origin)
        if track >= 0 and float(likeness[light, track]) >= SAME
    }
    values, pairs = likeness.flatten().sort(descending=True, stable=True)
    for pair in pairs[values >= SAME].tolist():
        light, track = divmod(pair, known.count)
        if light not in found and track not in found.values():
            found[light] = track
    taken = torch.zeros_like(dark)
    for light in range(lobes.count):
        taken[list(found.values())] = True
        if light not in found:
            own = lobes.select(torch.tensor([light], device=lobes.axes.device))
            found[light] = track_for(own, free, dark, taken, known)
    return [found[light] for light in range(lobes.count)]


def alike(lobes: Lobes, others: Lobes) -> Tensor:
    """Return how much alike lobes look: the correlation of their images, from 0 to 1.

    [K], [N] -> [K, N].
    """
    cells = even_cells(ROWS, str(lobes.axes.device))
    values = lobe_images.images(joined(lobes, others)[None], cells).values[0]
    shown = torch.nn.functional.normalize(values * cells.share.sqrt(), dim=-1)
    return shown[: lobes.count] @ shown[lobes.count :].mT


def track_for(light: Lobes, free: Tensor, dark: Tensor, taken: Tensor, known: Lobes) -> int:
    """Return the track that a new light takes: a dark one that was lit there, or a free one.

    A lamp that is off for a frame comes back in its own track, for that does not have to move. Of
    free tracks it is the one whose light was most nearly as wide. Where none is free it is one that
    is dark, and last one that is not.

    Args:
        light: The light.  [1, .]
        free: Which tracks are free.  [2 N]
        dark: Which are dark.  [2 N]
        taken: Which have a light already; not all.  [2 N]
        known: Where the tracks are, or were.  [2 N, .]
    """
    apart = torch.where(dark & ~taken, way(light, known)[0], torch.inf)
    nearest = int(apart.argmin())
    if float(apart[nearest]) < 1:
        return nearest
    rank = unlike(light, known)[0] + FAR * ((~free).long() + (~dark).long())
    return int(torch.where(taken, torch.inf, rank).argmin())


def is_other(lobes: Lobes, before: Lobes, light: Tensor) -> Tensor:
    """Tell which lobes have become another light.

    A sky lobe that goes to a lamp which is switched on would sweep there between the frames. Widths
    are as alike as the peaks of two Gaussians of one place are, one seen through the other. And a
    lobe that has faded may drift: what is left of it does not say where the light went.

    Args:
        lobes: Lobes.  [K, .]
        before: Each of them one frame before.  [K, .]
        light: Its share of the frame's light, over that one frame before.  [K]
    """
    now, then = widths(lobes), widths(before)
    ratio = now / then
    alike = (2 * ratio / (1 + ratio.square())).prod(-1)
    turn = torch.acos((lobes.axis_z * before.axis_z).sum(-1).clamp(-1, 1))
    brighter = torch.where(light < 1, then[..., 1], now[..., 1])
    faded = (light > 0) & (torch.minimum(light, 1 / light) < FADED)
    return (alike < ALIKE) | (faded & (turn > brighter))


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
