# SPDX-License-Identifier: Apache-2.0
"""Lobes of frames that were fitted with lobes free to jump, linked to tracks that do not.

Lobes on a lamp that passes stand a leash apart, so one that cannot keep up with it is soon where
another one was: it takes that one's part. Which lobe takes which part, where one goes dark, and
where it comes back, is a flow from frame to frame of as many units as there are tracks. The flow
that holds most of what lobes are missed is found exactly, as for the paths of objects in a video
[Zhang, Li and Nevatia 2008, Global data association for multi-object tracking using network flows].
"""

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from asglight.fitting import temporal
from asglight.fitting.coordinates import Leash
from asglight.fitting.free_fits import REACH_DEG, is_broad
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import parallel_transport
from asglight.lobes.matching import flux_shares

SLACK, SLACK_MAX_DEG = 0.5, 10.0
"""How much further than it can a lobe may have to go, in its width along the shorter axis, at most:
it comes near enough. Without, irr of a tunnel is 1.8 times as large; with a whole width, flicker a
tenth larger."""

DARK = 2
"""Frames in which a lobe is dark that is lit elsewhere then: it turns between them."""

BROAD_WORTH = 2.0
"""What a broad lobe is worth beside what it is missed, of its share of the flux. Others make up for
it only in more steps than there are: without, irr in a tunnel is twice as large."""

TURN = 1e-6
"""What a degree costs: of links that hold the same, those that turn least."""

KEPT = 1e-5
"""What a link is worth that lobes had when they were followed."""

MISSED_MAX = 1.0
"""J that a lobe is missed, at most: a fit without it is lost anyhow."""


def worths(lobes: Lobes, missed: Tensor) -> Tensor:
    """Return what it is worth to keep each lobe of a frame, 0 for dark ones.

    Args:
        lobes: The lobes.  [N, .]
        missed: How much J grows without each.  [N]
    """
    shares = flux_shares(lobes).to(missed)
    broad = is_broad(lobes).to(missed)
    found = missed.nan_to_num(MISSED_MAX).clamp(max=MISSED_MAX) + BROAD_WORTH * broad * shares
    return torch.where(temporal.is_dark(lobes).to(missed.device), 0.0, found)


def linked(lobes: Lobes, worth: Tensor, followed: Tensor) -> Lobes:
    """Link lobes of frames to tracks.

    Args:
        lobes: As fitted, their order without meaning in frames that were fitted free.  [F, N, .]
        worth: What each of them is worth, 0 or more.  [F, N]
        followed: Frames whose lobes keep their order from one to the next, and give it to the
            tracks.  [F]

    Returns:
        Tracks in which no lobe turns by more than `REACH_DEG` in a frame but while it is dark.
        [F, N, .]
    """
    ways = tracks(lobes, worth, followed)
    ways = ways[:, _order(ways[followed])]
    shot = replace(lobes, amplitude=torch.zeros_like(lobes.amplitude)).clone()
    for index in range(lobes.count):
        _lay_out(shot, index, lobes, ways[:, index])
    return shot


def tracks(lobes: Lobes, worth: Tensor, followed: Tensor) -> Tensor:
    """Return which lobe each track has in each frame, -1 where it is dark.  [F, N].

    Args:
        lobes: As fitted.  [F, N, .]
        worth: What each of them is worth.  [F, N]
        followed: Frames whose lobes keep their order from one to the next.  [F]
    """
    frames, count = worth.shape
    network = _Network()
    for frame in range(frames):
        pool = _pool(frame)
        network.add(pool, _pool(frame + 1), count, 0.0)
        for lobe in torch.nonzero(worth[frame] > 0).flatten().tolist():
            into, out = ("in", frame, lobe), ("out", frame, lobe)
            network.add(pool, into, 1, 0.0)
            network.add(into, out, 1, -float(worth[frame, lobe]))
            network.add(out, _pool(min(frame + DARK + 1, frames)), 1, 0.0)
        for later in range(frame + 1, min(frame + DARK, frames - 1) + 1):
            kept = bool(followed[frame : later + 1].all())
            for lobe, other, cost in _links(lobes, worth, frame, later, kept):
                network.add(("out", frame, lobe), ("in", later, other), 1, cost)
    return _ways(network.flow(_pool(0), _pool(frames), count), frames, count)


def _links(
    lobes: Lobes, worth: Tensor, frame: int, later: int, kept: bool
) -> list[tuple[int, int, float]]:
    """Return which lobes may become which, and at what cost."""
    one, other = lobes[frame], lobes[later]
    turned = torch.rad2deg(torch.acos((one.axis_z @ other.axis_z.mT).clamp(-1, 1)))
    width = torch.minimum(_width_deg(one)[:, None], _width_deg(other))
    slack = (SLACK * width).clamp(max=SLACK_MAX_DEG)
    near = turned < (later - frame) * REACH_DEG + slack
    if kept:  # and may be a little further
        near |= torch.eye(lobes.count, dtype=torch.bool)
    near &= (worth[frame] > 0)[:, None] & (worth[later] > 0)
    cost = TURN * turned - (KEPT * torch.eye(lobes.count) if kept else 0.0)
    return [(a, b, float(cost[a, b])) for a, b in torch.nonzero(near).tolist()]


def _width_deg(lobes: Lobes) -> Tensor:
    """Return sigma along a lobe's shorter axis, degrees.  [N]."""
    widest = lobes.sharpness.amax(-1)
    return torch.rad2deg((asg.per_variance(lobes.form) * widest).rsqrt())


_Node = tuple[str, int, int]
"""`in`, `out`, a frame, and a lobe; or `pool`, where a track is dark, a frame, and 0."""


def _pool(frame: int) -> _Node:
    return "pool", frame, 0


class _Network:
    """A directed network, its flow of least cost found as a linear program."""

    def __init__(self) -> None:
        self._nodes: dict[_Node, int] = {}
        self._from: list[int] = []
        self._to: list[int] = []
        self._most: list[int] = []
        self._costs: list[float] = []

    def add(self, source: _Node, target: _Node, most: int, cost: float) -> None:
        """Add an edge that takes at most so many units, each at a cost."""
        self._from.append(self._nodes.setdefault(source, len(self._nodes)))
        self._to.append(self._nodes.setdefault(target, len(self._nodes)))
        self._most.append(most)
        self._costs.append(cost)

    def flow(self, source: _Node, sink: _Node, units: int) -> list[tuple[_Node, _Node, int]]:
        """Return the edges that carry units, and how many.

        A vertex of the program is integral, for its matrix is that of a network.
        """
        import scipy.sparse  # a third of a second to load
        from scipy.optimize import linprog

        edges, nodes = len(self._costs), list(self._nodes)
        ends = np.array([self._from, self._to])
        signs = np.repeat([[1.0], [-1.0]], edges, axis=1)
        matrix = scipy.sparse.csr_array(
            (signs.ravel(), (ends.ravel(), np.tile(np.arange(edges), 2))),
            shape=(len(nodes), edges),
        )
        balance = np.zeros(len(nodes))
        balance[self._nodes[source]], balance[self._nodes[sink]] = units, -units
        bounds = np.column_stack([np.zeros(edges), self._most])
        found = linprog(self._costs, A_eq=matrix, b_eq=balance, bounds=bounds, method="highs-ds")
        carried = np.rint(found.x).astype(int)
        return [
            (nodes[self._from[edge]], nodes[self._to[edge]], int(carried[edge]))
            for edge in np.flatnonzero(carried)
        ]


def _ways(flow: list[tuple[_Node, _Node, int]], frames: int, count: int) -> Tensor:
    """Take a flow apart into the ways of its units.  [F, N], -1 where a unit is in the pool."""
    onward: defaultdict[_Node, list[_Node]] = defaultdict(list)
    for source, target, units in flow:
        onward[source] += [target] * units
    ways = torch.full((frames, count), -1)
    for index in range(count):
        node = _pool(0)
        while node != _pool(frames):
            kind, frame, lobe = node
            if kind == "in":
                ways[frame, index] = lobe
            node = onward[node].pop()
    return ways


def _order(ways: Tensor) -> Tensor:
    """Return the order in which most tracks are the lobe that was followed.

    Args:
        ways: Tracks in frames whose lobes were followed.  [F', N]
    """
    from scipy.optimize import linear_sum_assignment

    count = ways.shape[-1]
    alike = (ways[..., None] == torch.arange(count)).sum(0)  # [track, lobe]
    track, lobe = linear_sum_assignment(-alike.numpy())
    return torch.from_numpy(track[np.argsort(lobe)])


def _lay_out(shot: Lobes, index: int, lobes: Lobes, way: Tensor) -> None:
    """Write a track into a shot.

    Where it is dark it waits in the next place, from its second dark frame on. Where it is not
    found for a frame between two near places it is halfway between them.

    Args:
        shot: Every frame, all lobes black.  [F, N, .]
        index: The track.
        lobes: As fitted.  [F, N, .]
        way: Which of them it is.  [F]
    """
    lit: list[int] = []
    for frame in torch.nonzero(way >= 0).flatten().tolist():
        own = lobes[frame].select(way[frame : frame + 1])
        ago = frame - lit[-1] if lit else DARK + 1
        if ago <= DARK:
            before = shot.axis_z[lit[-1], index]
            own = _turned(own, _within(own.axis_z[0], before, ago))
            for between in range(lit[-1] + 1, frame):
                _write(shot, between, index, _turned(own, before + own.axis_z[0]))
                lit.append(between)
        _write(shot, frame, index, own)
        lit.append(frame)
    for frame in range(len(way)):
        if frame not in lit:
            place = _waits_at(frame, lit)
            for part in (shot.axes, shot.sharpness):
                part[frame, index] = part[place, index]


def _waits_at(frame: int, lit: list[int]) -> int:
    """Return the frame in whose place a track is where it is dark."""
    if frame - 1 in lit:
        return frame - 1
    return min((each for each in lit if each > frame), default=max(lit, default=0))


def _within(axis_z: Tensor, before: Tensor, frames: int) -> Tensor:
    """Return a direction pulled back to as far as a track turns in so many frames.  [3]."""
    cosine = torch.tensor(math.cos(math.radians(frames * REACH_DEG)))
    return Leash(before, cosine.to(before)).hold(axis_z)


def _turned(lobe: Lobes, axis_z: Tensor) -> Lobes:
    """Turn a lobe the shortest way.  N = 1; axis_z: [3], of any length."""
    towards = torch.nn.functional.normalize(axis_z, dim=-1)
    return replace(lobe, axes=parallel_transport(lobe.axes, towards[None]))


def _write(shot: Lobes, frame: int, index: int, lobe: Lobes) -> None:
    shot.axes[frame, index] = lobe.axes[0]
    shot.sharpness[frame, index] = lobe.sharpness[0]
    shot.amplitude[frame, index] = lobe.amplitude[0]
