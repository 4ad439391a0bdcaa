# SPDX-License-Identifier: Apache-2.0
"""Identity switches: a track whose lobe is given another place, though no light moved.

Now and then the lobes of a sky share its light out anew. One turns by tens of degrees, and others
fill the place that it left. Between the frames its track would sweep over the sphere.

Irradiance tells such a switch from light that moves. It is a mean over half of the sphere, so where
light moves it is smooth in time: half-way between two frames it is near the cubic through these two
and their neighbours. Where the turns of lobes make it miss that, the later frames of a lobe go to a
free track: one light fades where it was, another where it is. The lobe whose turn is most at odds
with the cubic is the first.

Broad lobes are judged by the irradiance of broad lobes first. Where lamps come and go, that of all
lobes is smooth no more, and changes by more than what a sky lobe sweeps.

Symbols: G pairs of frames, K lobes, P directions, D normals.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.lobes import asg, frames, motion
from asglight.lobes.data import Lobes
from asglight.lobes.identity.lamps import is_broad
from asglight.sphere.quadrature import fibonacci_directions


@dataclass(frozen=True)
class SwitchSettings:
    """What is told from light that moves (docs/experiments/2026-11-29-smooth-irradiance.md).

    Attributes:
        turn: Radians by which a lamp turns that may be another light. By less, irradiance tells
            too little; a mirror image tells more. Broad lobes are judged however little they turn.
        unseen: Share of the mean irradiance by which fits of single frames are off.
    """

    turn: float = math.radians(10)
    unseen: float = 5e-4


SETTINGS = SwitchSettings()

WIDTH = math.radians(10)
"""Lobes are seen with at least this sigma, about the spacing of the directions. Irradiance shows
nothing as fine."""

DIRECTIONS, NORMALS = 512, 48

AT_ONCE = 64
"""Pairs of frames. What 15 lobes of each send in all directions takes 4 MB."""


class _Cubic(NamedTuple):
    """How far irradiance is from an even change half-way, on the cubic through four frames.

    Attributes:
        expected: That.  [..., D]
        variance: Of it, in the mean over normals.  [...]
    """

    expected: Tensor
    variance: Tensor

    def at(self, index: int) -> "_Cubic":
        """Return one of several."""
        return _Cubic(self.expected[index], self.variance[index])


@dataclass(frozen=True)
class _Pair:
    """What a pair of frames shows.

    Attributes:
        frame: The first of them.
        lobes: Those that turn.  [K]
        stray: By how much each turn makes irradiance stray from an even change, half-way.  [K, D]
        broad: Which of them are broad, and have been and stay so.  [K]
        sky: The cubic of the irradiance of such lobes.
        all: That of all lobes.
    """

    frame: int
    lobes: Tensor
    stray: Tensor
    broad: Tensor
    sky: _Cubic
    all: _Cubic


def switches_apart(lobes: Lobes) -> Lobes:
    """Let a lobe that was given another place go on in a track that is free.

    Where no track is dark in two frames before and after, it stays in its own.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, later frames of some tracks exchanged with those of dark ones.  [F, N, .]
    """
    order = torch.arange(lobes.count).repeat(len(lobes.axes), 1)
    lit = ~motion.is_black(lobes)
    for pair in _pairs(lobes, lit[1:] & lit[:-1]):
        for lobe in _straying(pair):
            track = int((order[pair.frame + 1] == lobe).nonzero())
            free = _free_track(lobes, lit, order, pair.frame, lobe)
            if free is not None:
                order[pair.frame + 1 :, [track, free]] = order[pair.frame + 1 :, [free, track]]
    return lobes[torch.arange(len(order))[:, None], order]


def fading_in_place(lobes: Lobes) -> Lobes:
    """Let a lobe fade where it is, if irradiance speaks against the path that it is carried on by.

    Args:
        lobes: A shot, `fading.carried_on`.  [F, N, .]

    Returns:
        The shot, with other axes of black lobes.  [F, N, .]
    """
    lit, axes = ~motion.is_black(lobes), lobes.axes.clone()
    # a track that is dark for one frame alone has a path on both sides
    alone = lit[2:] & ~lit[1:-1] & lit[:-2]
    fades = lit[1:] ^ lit[:-1]
    fades[1:] &= ~alone
    fades[:-1] &= ~alone
    for pair in _pairs(lobes, fades):
        first, last = pair.frame, pair.frame + 1
        for lobe in _straying(pair):
            dark, shines = (last, first) if lit[first, lobe] else (first, last)
            axes[dark, lobe] = axes[shines, lobe]
    return replace(lobes, axes=axes)


def _pairs(lobes: Lobes, marks: Tensor) -> Iterator[_Pair]:
    """Yield the pairs of frames in which marked lobes may be given another place.

    None of a shot of two frames, which tell nothing.

    Args:
        lobes: A shot.  [F, N, .]
        marks: Lobes from one frame to the next.  [F - 1, N]
    """
    count = len(lobes.axes)
    if count < 3:
        return
    is_sky = is_broad(lobes) | motion.is_black(lobes)
    stays_broad = is_sky[1:] & is_sky[:-1]
    angle = (lobes.axis_z[1:] * lobes.axis_z[:-1]).sum(-1).clamp(-1, 1).acos()
    turns = marks & (stays_broad | (angle > SETTINGS.turn))
    for some in torch.nonzero(turns.any(-1)).flatten().split(AT_ONCE):
        around = (some[:, None] + torch.arange(-1, 3)).clamp(0, count - 1)
        numbers = around.unique()
        at = torch.searchsorted(numbers, around)  # [G, 4]
        seen = _irradiance(motion.exact(lobes[numbers]))  # [., N, D]
        ends = some == 0, some == count - 2
        in_sky = is_sky[around].all(1)  # [G, N]; one that is a lamp in between would make it jump
        sky = _cubic((seen[at] * in_sky[:, None, :, None]).sum(2), *ends)
        every = _cubic(seen.sum(1)[at], *ends)
        place, lobe = torch.nonzero(turns[some], as_tuple=True)
        first, last = (motion.exact(lobes[some[place] + step, lobe]) for step in (0, 1))
        middle = motion.between(first, frames.align(last, first), torch.tensor(0.5))
        stray = _irradiance(middle) - (seen[at[place, 1], lobe] + seen[at[place, 2], lobe]) / 2
        for index, frame in enumerate(some.tolist()):
            own = place == index
            parts = lobe[own], stray[own], in_sky[index, lobe[own]]
            yield _Pair(frame, *parts, sky.at(index), every.at(index))


def _cubic(irradiance: Tensor, is_first: Tensor, is_last: Tensor) -> _Cubic:
    """Return how far the cubic through four frames is from an even change, half-way.

    It is off by about as much as the third differences add to it. At the ends of a shot a parabola
    stands for it, of which nothing tells by how much it is off: by all that it adds.

    Args:
        irradiance: One frame before a pair, the pair, one after; any at the ends.  [G, 4, D]
        is_first: Whether a pair begins the shot.  [G]
        is_last: Whether it ends it.  [G]
    """
    second = irradiance.diff(n=2, dim=1)  # [G, 2, D]
    before = torch.where(is_first[:, None], second[:, 1], second[:, 0])
    after = torch.where(is_last[:, None], second[:, 0], second[:, 1])
    expected = -(before + after) / 16
    is_end = (is_first | is_last)[:, None]
    doubt = torch.where(is_end, expected, (after - before) / 16)
    unseen = SETTINGS.unseen * irradiance[:, 1:3].mean((1, 2))
    return _Cubic(expected, doubt.square().mean(-1) + unseen.square())


def _straying(pair: _Pair) -> list[int]:
    """Return the lobes whose turns irradiance speaks against, the worst first."""
    among_broad = _at_odds(pair.stray, pair.broad, pair.sky)
    others = torch.ones_like(pair.broad)
    others[among_broad] = False
    return pair.lobes[[*among_broad, *_at_odds(pair.stray, others, pair.all)]].tolist()


def _at_odds(stray: Tensor, among: Tensor, cubic: _Cubic) -> list[int]:
    """Return the lobes without whose turns irradiance is nearer to the cubic, the worst first.

    Each brings it nearer by more than the doubt: the variance of the cubic, and what is missed
    without all of them, which no turn explains. All are squares, in the mean over normals.

    Args:
        stray: By how much each turn makes irradiance stray.  [K, D]
        among: Which lobes turn.  [K]
        cubic: What is expected of all of these.
    """
    missed = stray[among].sum(0) - cubic.expected
    squares, found = [missed.square().mean()], []
    left = among.nonzero().flatten().tolist()
    while left:
        without = (missed - stray[left]).square().mean(-1)
        best = int(without.argmin())
        if without[best] >= squares[-1]:
            break
        missed = missed - stray[left[best]]
        squares.append(without[best])
        found.append(left.pop(best))
    gains = -torch.stack(squares).diff()
    is_worth = (gains > cubic.variance + squares[-1]).tolist()
    return found[: [*is_worth, False].index(False)]


def _free_track(lobes: Lobes, lit: Tensor, order: Tensor, frame: int, lobe: int) -> int | None:
    """Return the free track whose light was most nearly as wide; None where none is free.

    Args:
        lobes: The shot.  [F, N, .]
        lit: Which send light.  [F, N]
        order: The lobe that each track has.  [F, N]
        frame: After which a track is needed.
        lobe: For which lobe.
    """
    near = slice(max(frame - 1, 0), frame + 3)
    dark = ~lit[near].gather(1, order[near]).any(0)
    sharpness = lobes.sharpness[frame + 1]
    unlike = (sharpness[order[frame + 1]].log() - sharpness[lobe].log()).abs().sum(-1)
    best = int(torch.where(dark, unlike, torch.inf).argmin())
    return best if bool(dark[best]) else None


def _irradiance(lobes: Lobes) -> Tensor:
    """Return the irradiance of lobes over pi, channels summed.  [..., K, .] -> [..., K, D]."""
    lit = ~motion.is_black(lobes)
    own, (directions, normals, cosines) = lobes[lit], _sphere()
    variance = 1 / own.sharpness + asg.per_variance(own.form) * WIDTH**2
    values = asg.local_values(replace(own, sharpness=1 / variance), own.axes @ directions.mT)
    flux = asg.flux(own).sum(-1, keepdim=True)
    found = flux.new_zeros(*lit.shape, len(normals))
    found[lit] = flux * (values @ cosines.mT) / values.sum(-1, keepdim=True)
    return found


@cache
def _sphere() -> tuple[Tensor, Tensor, Tensor]:
    """Return directions [P, 3], normals [D, 3], and the cosines between them over pi [D, P]."""
    directions = fibonacci_directions(DIRECTIONS, dtype=torch.float64)
    normals = fibonacci_directions(NORMALS, dtype=torch.float64)
    return directions, normals, (normals @ directions.mT).clamp(min=0) / math.pi
