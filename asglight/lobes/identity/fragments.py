# SPDX-License-Identifier: Apache-2.0
"""Fragments: a lamp that goes on in another track, because its lobe did not come along.

A lamp that turns by tens of degrees a frame may leave its lobe behind. The lobe goes dark, and one
of another track is lit where the lamp is now. Between the frames light would fade out here and in
there. Tracking calls such pieces of one path fragments.

Two pieces are one path if the motion of the frame before, of the frame after, or the mean of both
leads from one to the other: a lamp that turned by 30 degrees will do so again. Lamps that are
switched do not move, and stay apart.

Symbols: E ends of paths.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.lobes import asg, frames, motion
from asglight.lobes.data import Lobes


@dataclass(frozen=True)
class FragmentSettings:
    """What makes two pieces one path (docs/experiments/2026-11-29-fragments.md).

    Attributes:
        off: Share of its turn by which a lamp may miss where its motion leads. A lamp that passes
            nearby may turn by twice as much as one frame before, which is a half; from 0.8 on, sky
            lobes are joined that share their light out anew.
        alike: Factor by which flux and width may differ.
    """

    off: float = 0.6
    alike: float = 4.0


SETTINGS = FragmentSettings()


class _Ends(NamedTuple):
    """Ends of paths: the last frames of some, or the first ones.

    Attributes:
        frame: The frame of each.  [E]
        lobe: The track.  [E]
        axes: Its frame.  [E, 3, 3]
        turn: Rotation vector from one frame to the next, along the path.  [E, 3]
        is_known: Whether the path has two frames to tell that.  [E]
        size: Logarithms of flux and of sharpness over two, which is that of width.  [E, 2]
    """

    frame: Tensor
    lobe: Tensor
    axes: Tensor
    turn: Tensor
    is_known: Tensor
    size: Tensor

    def some(self, index: Tensor) -> "_Ends":
        """Return some of them."""
        return _Ends(*(each[index] for each in self))


def fragments_joined(lobes: Lobes) -> Lobes:
    """Let a path go on in its track where another track has taken it over.

    Args:
        lobes: A shot.  [F, N, .]

    Returns:
        The shot, later frames of some tracks exchanged.  [F, N, .]
    """
    lit = ~motion.is_black(lobes)
    order = torch.arange(lobes.count).repeat(len(lit), 1)
    last, first = (torch.nonzero(one) for one in (lit[:-1] & ~lit[1:], lit[1:] & ~lit[:-1]))
    last, first = _ends(lobes, lit, last, -1), _ends(lobes, lit, first + torch.tensor([1, 0]), 1)
    for frame in sorted({*last.frame.tolist()} & {*(first.frame - 1).tolist()}):
        here, there = last.some(last.frame == frame), first.some(first.frame == frame + 1)
        for one, other in _pairs(here, there):
            now = order[frame + 1]
            tracks = [int((now == lobe).nonzero()) for lobe in (here.lobe[one], there.lobe[other])]
            order[frame + 1 :, tracks] = order[frame + 1 :, tracks[::-1]]
    return lobes[torch.arange(len(order))[:, None], order]


def _pairs(last: _Ends, first: _Ends) -> list[tuple[int, int]]:
    """Return which last and first lobes of two frames are one path, the surest first."""
    turn = _turn(last.axes[:, None], first.axes)  # [E, E', 3]
    known = torch.stack(
        [last.is_known[:, None].expand(turn.shape[:2]), first.is_known.expand(turn.shape[:2])]
    )[..., None]
    led = (last.turn[:, None] * known[0] + first.turn * known[1]) / known.sum(0).clamp(min=1)
    off = (turn - led).norm(dim=-1) / turn.norm(dim=-1).clamp(min=torch.finfo(turn.dtype).tiny)
    unlike = (last.size[:, None] - first.size).abs().amax(-1)
    may_be = known.any(0)[..., 0] & (off < SETTINGS.off) & (unlike < math.log(SETTINGS.alike))
    found: list[tuple[int, int]] = []
    while bool(may_be.any()):
        best = int(torch.where(may_be, off, torch.inf).argmin())
        one, other = divmod(best, len(first.frame))
        may_be[one], may_be[:, other] = False, False
        found.append((one, other))
    return found


def _ends(lobes: Lobes, lit: Tensor, places: Tensor, step: int) -> _Ends:
    """Return ends of paths.

    Args:
        lobes: A shot.  [F, N, .]
        lit: Which send light.  [F, N]
        places: Frame and track of each.  [E, 2]
        step: To the next frame of its path: -1 of last frames, 1 of first ones.
    """
    frame, lobe = places.unbind(-1)
    own = motion.exact(lobes[frame, lobe])
    inner = (frame + step).clamp(0, len(lit) - 1)
    is_known = lit[inner, lobe] & (inner != frame)
    turn = step * _turn(own.axes, motion.exact(lobes[inner, lobe]).axes)
    size = torch.stack([asg.flux(own).sum(-1).log(), own.sharpness.log().mean(-1) / 2], -1)
    return _Ends(frame, lobe, own.axes, turn, is_known, size)


def _turn(start: Tensor, end: Tensor) -> Tensor:
    """Return how axis z of frames turns to that of others, as rotation vectors.

    [..., 3, 3] each; result [..., 3].
    """
    axis, swing, _ = frames.swing_and_twist(*torch.broadcast_tensors(start, end))
    return axis * swing[..., None]
