# SPDX-License-Identifier: Apache-2.0
"""Identity switches: a track whose lobe is given another place, though no light moved.

Now and then the lobes of a sky share its light out anew. One turns by tens of degrees, and others
fill the place that it left. Between the frames its track would sweep over the sphere.

Irradiance tells such a switch from light that moves. It is a mean over half of the sphere, so where
light moves it changes almost evenly from frame to frame. Where it would stray from an even change
half-way, the later frames of a lobe go to a free track: one light fades where it was, another where
it is. The lobe whose turn makes irradiance stray most is the first.

Broad lobes are judged among themselves. Where lamps fade, irradiance changes evenly, and by more
than what a sky lobe sweeps.

Symbols: G pairs of frames, K lobes, P directions, D normals.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import torch
from torch import Tensor

from asglight.lobes import asg, frames, motion
from asglight.lobes.data import Lobes
from asglight.lobes.identity.lamps import is_broad
from asglight.sphere.quadrature import fibonacci_directions


@dataclass(frozen=True)
class SwitchSettings:
    """What is told from light that moves (docs/experiments/2026-11-29-identity-switches.md).

    Attributes:
        turn: Radians by which a lobe turns that may be another light. By less, turning and fading
            look the same.
        stray: Share of half the change of irradiance by which it may stray half-way. Of lamps that
            pass in every second frame of `tunnel`, and of cameras that pan by 10 to 30 degrees a
            frame, it is at most 0.25; of switches in `handheld`, 0.33 to 1.
        alone: How much more it may stray than by what each lobe strays in its own change. A lamp
            alone that turns by 60 degrees strays by 0.45, and so do all lobes of a camera that pans
            by as much.
        unseen: Share of the mean irradiance by which it may stray whatever moves: what fits of
            single frames are off by.
    """

    turn: float = math.radians(10)
    stray: float = 0.3
    alone: float = 1.25
    unseen: float = 5e-4


SETTINGS = SwitchSettings()

WIDTH = math.radians(10)
"""Lobes are seen with at least this sigma, about the spacing of the directions. Irradiance shows
nothing as fine."""

DIRECTIONS, NORMALS = 512, 48

AT_ONCE = 64
"""Pairs of frames. What 15 lobes of each send in all directions takes 4 MB."""


@dataclass(frozen=True)
class _Pair:
    """What a pair of frames shows.

    Attributes:
        frame: The first of them.
        lobes: Those that turn.  K
        stray: By how much each turn makes irradiance stray in the middle.  [K, D]
        change: Half of what each changes it by.  [K, D]
        total: Half of what all lobes change it by, or all broad ones, in the mean over normals.
        unseen: How much it may stray whatever moves.
    """

    frame: int
    lobes: list[int]
    stray: Tensor
    change: Tensor
    total: Tensor
    unseen: Tensor

    @property
    def moved(self) -> Tensor:
        """How much it strays if these lobes are all that moves."""
        alone = self.total * self.stray.abs().sum() / self.change.abs().sum()
        return torch.maximum(alone, self.unseen)

    @property
    def most(self) -> Tensor:
        """How much it may stray."""
        return torch.maximum(SETTINGS.stray * self.total, self.unseen)


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
        most = torch.maximum(pair.most, SETTINGS.alone * pair.moved)
        for lobe in _straying(pair, most, enough=pair.moved):
            track = int((order[pair.frame + 1] == lobe).nonzero())
            free = _free_track(lobes, lit, order, pair.frame, lobe)
            if free is not None:
                order[pair.frame + 1 :, [track, free]] = order[pair.frame + 1 :, [free, track]]
    return lobes[torch.arange(len(order))[:, None], order]


def fading_in_place(lobes: Lobes) -> Lobes:
    """Let a lobe fade where it is, if its path is carried on to where no light goes.

    That is a path by which irradiance strays by too much of what the lobe itself changes it by, or
    all lobes together do: one that was turned by 40 degrees is no lamp that goes on as far.

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
        own = pair.stray.abs().mean(-1) > SETTINGS.stray * pair.change.abs().mean(-1)
        far = [lobe for lobe, is_far in zip(pair.lobes, own.tolist(), strict=True) if is_far]
        for lobe in {*far, *_straying(pair, pair.most, enough=pair.most)}:
            first, last = pair.frame, pair.frame + 1
            dark, shines = (last, first) if lit[first, lobe] else (first, last)
            axes[dark, lobe] = axes[shines, lobe]
    return replace(lobes, axes=axes)


def _pairs(lobes: Lobes, marks: Tensor) -> Iterator[_Pair]:
    """Yield the pairs of frames in which marked lobes turn, broad ones by themselves.

    Args:
        lobes: A shot.  [F, N, .]
        marks: Lobes from one frame to the next.  [F - 1, N]
    """
    angle = (lobes.axis_z[1:] * lobes.axis_z[:-1]).sum(-1).clamp(-1, 1).acos()
    turns = marks & (angle > SETTINGS.turn)
    broad = _are_broad(lobes)
    for some in torch.nonzero(turns.any(-1)).flatten().split(AT_ONCE):
        numbers = torch.cat([some, some + 1]).unique()
        seen = _irradiance(motion.exact(lobes[numbers]))
        before, after = (seen[torch.searchsorted(numbers, some + step)] for step in (0, 1))
        changes = (after - before) / 2
        unseen = SETTINGS.unseen * (after + before).sum(1).mean(-1) / 2
        place, lobe = torch.nonzero(turns[some], as_tuple=True)
        first, last = (motion.exact(lobes[some[place] + step, lobe]) for step in (0, 1))
        middle = motion.between(first, frames.align(last, first), torch.tensor(0.5))
        stray = _irradiance(middle) - (before + after)[place, lobe] / 2
        for index, frame in enumerate(some.tolist()):
            turning, every = broad[frame, lobe], torch.ones_like(broad[frame])
            for counts, alike in ((every, ~turning), (broad[frame], turning)):
                own = (place == index) & alike
                if bool(own.any()):
                    total = changes[index, counts].sum(0).abs().mean(-1)
                    change = changes[index, lobe[own]]
                    yield _Pair(frame, lobe[own].tolist(), stray[own], change, total, unseen[index])


def _are_broad(lobes: Lobes) -> Tensor:
    """Tell which lobes are broad in two frames, as far as they are lit there.  [F - 1, N]."""
    black = motion.is_black(lobes)
    broad = is_broad(lobes) | black
    return broad[1:] & broad[:-1] & ~(black[1:] & black[:-1])


def _straying(pair: _Pair, most: Tensor, enough: Tensor) -> Iterator[int]:
    """Yield lobes, the worst first, as long as irradiance strays less without their turn.

    Args:
        pair: What two frames show.
        most: How much it may stray.
        enough: How much it is to stray in the end, if it strays by more than that.
    """
    stray, left = pair.stray.sum(0), list(range(len(pair.lobes)))
    if stray.abs().mean() <= most:
        return
    while left and stray.abs().mean() > enough:
        without = (stray - pair.stray[left]).abs().mean(-1)
        best = int(without.argmin())
        if float(without[best]) >= float(stray.abs().mean()):
            return
        stray = stray - pair.stray[left[best]]
        yield pair.lobes[left.pop(best)]


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
