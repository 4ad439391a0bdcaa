# SPDX-License-Identifier: Apache-2.0
"""Which lobes take steps together where there are too many for one system of equations.

A step of N lobes has 8 N unknowns: its matrix grows with N^2, and the work to solve it with N^3.
But a lobe trades light with those around it alone, and what all share, the light of the whole map,
is soon right. So neighbours take steps while the light of all others is held, one part of the lobes
after the other: block coordinate descent [Tseng 2001, Convergence of a Block Coordinate Descent
Method for Nondifferentiable Minimization].
"""

import math

import torch
from torch import Tensor

from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.loss.temporal import Prior
from asglight.lobes import Lobes


def parts(axis_z: Tensor, most: int, turn: int) -> list[Tensor]:
    """Cut the lobes of each frame into parts of neighbours, as a k-d tree does [Bentley 1975].

    Each cut is across x, y or z, one after the other, and leaves as many on either side.

    Args:
        axis_z: Directions.  [F, N, 3]
        most: Lobes of a part, at most.
        turn: The first cut is across the next axis in every turn.

    Returns:
        Ascending indices; parts differ in size by one at most.  [F, K] each
    """

    def cut(index: Tensor, axis: int) -> list[Tensor]:
        """Halve lobes along an axis until the parts are small enough."""
        count = index.shape[1]
        pieces = math.ceil(count / most)
        if pieces == 1:
            return [index.sort(-1).values]
        along = axis_z[..., axis].gather(1, index)
        index = index.gather(1, along.argsort(dim=-1, stable=True))
        middle = count * (pieces // 2) // pieces
        after = (axis + 1) % 3
        return cut(index[:, :middle], after) + cut(index[:, middle:], after)

    frames, count, _ = axis_z.shape
    return cut(torch.arange(count, device=axis_z.device).expand(frames, -1), turn % 3)


def around(shown: Images, share: Tensor, places: Tensor, count: int) -> Tensor:
    """Return the lobes whose light lies most where that of some of them does, these included.

    Args:
        shown: The lobes of one frame on its adaptive cells.
        share: Solid angles of the adaptive cells.  [1, P]
        places: Indices of those lobes, in each of some cases.  [T, M]
        count: K, lobes that are wanted.

    Returns:
        Ascending indices in each case.  [T, K]
    """
    images = torch.nn.functional.normalize(shown.values[0] * share.sqrt(), dim=-1)
    alike = (images[places] @ images.mT).amax(1)  # [T, N]
    alike[_rows(places), places] = torch.inf
    return alike.topk(count, dim=-1).indices.sort(-1).values


def some(lobes: Lobes, index: Tensor) -> Lobes:
    """Return some lobes of each frame, others in each.  [F, N, .] -> [F, K, .].

    Args:
        lobes: The lobes.
        index: Which.  [F, K]
    """
    at = _rows(index), index
    return Lobes(lobes.axes[at], lobes.sharpness[at], lobes.amplitude[at], lobes.form)


def put(lobes: Lobes, index: Tensor, others: Lobes) -> Lobes:
    """Return a copy with others in the places that `some` picks."""
    found, at = lobes.clone(), (_rows(index), index)
    found.axes[at], found.sharpness[at] = others.axes, others.sharpness
    found.amplitude[at] = others.amplitude
    return found


def pick(values: Tensor, index: Tensor, *shape: int) -> Tensor:
    """Return what belongs to some lobes of each frame.  [F, K, *shape].

    Args:
        values: Of all lobes of each frame, or of one frame for all.  [(F,) N, *shape]
        index: Which.  [F, K]
        shape: Of what belongs to a lobe.
    """
    return values.expand(len(index), -1, *shape)[_rows(index), index]


def prior(given: Prior, index: Tensor) -> Prior:
    """Return the temporal term of some lobes of each frame.  [F, K]."""
    lobes = given.lobes
    own = Lobes(
        pick(lobes.axes, index, 3, 3),
        pick(lobes.sharpness, index, 2),
        pick(lobes.amplitude, index, 3),
        lobes.form,
    )
    return Prior(own, pick(given.share, index), pick(given.scale, index, UNKNOWNS))


def _rows(index: Tensor) -> Tensor:
    return torch.arange(len(index), device=index.device)[:, None]
