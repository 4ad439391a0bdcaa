# SPDX-License-Identifier: Apache-2.0
"""Which lobe would serve some frames of a shot best elsewhere: an exact search.

Each frame has some places where one lobe more would gain. A lobe may go from place to place of
neighbouring frames as far as its leash reaches. Where it comes from further away it is dark for two
frames before, for it turns between them, and for two frames after. What it is missed there, and in
the frames between, is its cost.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

DARK = 2
"""Frames in which a lobe is dark that was lit elsewhere: it turns between them."""


@dataclass(frozen=True)
class Places:
    """Where one lobe more would gain, in neighbouring frames.

    Attributes:
        axis_z: Directions of the K places in each frame.  [F, K, 3]
        gain: What J falls by.  [F, K]
        cost: What J grows by without a lobe.  [F, N]
        before: Directions of the lobes in the frame before each.  [F, N, 3]
        after: Directions of the lobes in the frame after each.  [F, N, 3]
        open: Which frames may be changed.  [F]
        starts: Whether the shot starts with the first frame.
        ends: Whether it ends with the last one.
    """

    axis_z: Tensor
    gain: Tensor
    cost: Tensor
    before: Tensor
    after: Tensor
    open: Tensor
    starts: bool = True
    ends: bool = True


@dataclass(frozen=True)
class Plan:
    """A lobe that is lit elsewhere for some frames.

    Attributes:
        lobe: Which.
        first: The first of the frames.
        places: Which place it has in each of them.
        worth: What J is to fall by, all frames together.
    """

    lobe: int
    first: int
    places: tuple[int, ...]
    worth: float

    @property
    def last(self) -> int:
        """The last of the frames."""
        return self.first + len(self.places) - 1


def best_plan(places: Places, cosine: float, allowed: Tensor) -> Plan | None:
    """Return the plan that is worth most, or None if there is none.

    Args:
        places: Where lobes could go.
        cosine: Of the longest way from frame to frame.
        allowed: Which lobes may be lit anew in which frames.  [F, N]
    """
    frames, count = places.gain.shape
    dark = _dark_costs(places)
    best, back, found = [], [], None
    for frame in range(frames):
        place = places.axis_z[frame]  # [K, 3]
        near = places.before[frame] @ place.mT > cosine  # [N, K]
        start = torch.where(near, 0.0, -dark[0][frame][:, None])
        came = torch.full_like(start, -1, dtype=torch.long)
        if frame:
            linked = place @ places.axis_z[frame - 1].mT > cosine  # [K, K]
            onward = torch.where(linked[None], best[-1][:, None], -math.inf)  # [N, K, K]
            on, by = onward.max(-1)
            came = torch.where(on > start, by, came)
            start = torch.maximum(on, start)
        value = start + places.gain[frame] - places.cost[frame][:, None]
        may = allowed[frame] & places.open[frame]
        best.append(torch.where(may[:, None], value, -math.inf))
        back.append(came)
        near = places.after[frame] @ place.mT > cosine
        total = best[-1] - torch.where(near, 0.0, dark[1][frame][:, None])
        worth = float(total.max())
        if found is None or worth > found[0]:
            found = worth, frame, *divmod(int(total.argmax()), count)
    if found is None or not math.isfinite(found[0]):
        return None
    worth, frame, lobe, place = found
    way = [place]
    while (place := int(back[frame][lobe, place])) >= 0:
        way.append(place)
        frame -= 1
    return Plan(lobe, frame, tuple(reversed(way)), worth)


def _dark_costs(places: Places) -> tuple[Tensor, Tensor]:
    """Return what it costs that a lobe is dark before each frame, and after it.  Two [F, N].

    Infinite where that would change a frame that is not open.
    """
    closed = torch.where(places.open[:, None], places.cost, math.inf)

    count, lobes = closed.shape

    def nearby(step: int) -> Tensor:
        """Return the costs of the frame so many frames on.  [F, N]."""
        within = closed.roll(-step, dims=0)
        free = places.starts if step < 0 else places.ends
        beyond = closed.new_full((min(abs(step), count), lobes), 0.0 if free else math.inf)
        if step < 0:
            return torch.cat([beyond, within[-step:]])
        return torch.cat([within[: max(count - step, 0)], beyond])

    steps = range(1, DARK + 1)
    before = torch.stack([nearby(-step) for step in steps]).sum(0)
    return before, torch.stack([nearby(step) for step in steps]).sum(0)
