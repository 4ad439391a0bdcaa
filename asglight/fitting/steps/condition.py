# SPDX-License-Identifier: Apache-2.0
"""Which lobes stand in for each other: where a fit is ill-conditioned.

Two lobes trade if some change of the one, in shape or light, can be undone by a change of the
other: then only what they show together is certain, and noise of the map may move light between
them. The Gauss-Newton matrix H of J at a map that the lobes show exactly says how far. Of all
changes d of lobe i, with lobe j free to undo them, the least that is left is

    min over d of (d^T (H_ii - H_ij H_jj^-1 H_ji) d) / (d^T H_ii d) = 1 - rho^2

with rho the largest canonical correlation of their unknowns [Hotelling 1936]. An error of the map
is amplified by up to 1 / sqrt(1 - rho^2) in what the two have apart.

The fit itself stands on it: steps are damped (newton.py), and in the solution for the light a ridge
of the size of float32 rounding keeps amplitudes near to where they were (light.py), which is felt
only where lobes trade.
"""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.steps import equations
from asglight.lobes import Lobes, asg, texels

ROWS = 64
"""Of the map that the lobes show: the coarse grid of a fit."""

LIMIT = 100.0
"""Amplification from which lobes trade: an error of a percent of the map is then as large as the
lobe. Neighbours in fits of real maps have 5 to 20; four lobes within one lamp are far beyond."""

RANK = 1e-6
"""Of a lobe's own curvature: below it float32 images hold no more than rounding, and a change that
the map does not see, such as the turn of a round lobe, is no trade."""


@dataclass(frozen=True)
class Trade:
    """Two lobes that stand in for each other.

    Attributes:
        lobes: Their indices, ascending.
        amplification: Of an error of the map in what they have apart; infinite if they are alike.
    """

    lobes: tuple[int, int]
    amplification: float


def trades(lobes: Lobes, limit: float = LIMIT) -> list[Trade]:
    """Return the pairs that trade, the worst first.

    Args:
        lobes: Lobes of one frame; black ones trade with none.  [N, .]
        limit: Amplification from which two do.
    """
    lit = torch.nonzero(lobes.amplitude.amax(-1) > 0).flatten()
    if len(lit) < 2:
        return []
    correlation = correlations(_curvature(lobes.select(lit)))
    # below the rounding of float64 two lobes are the same one
    rest = 1 - correlation.clamp(max=1).square()
    amplification = torch.where(rest > 1e-12, rest.clamp(min=1e-12).rsqrt(), torch.inf)
    pairs = torch.triu_indices(len(lit), len(lit), 1)
    found = [
        Trade((int(lit[one]), int(lit[other])), float(amplification[one, other]))
        for one, other in pairs.mT.tolist()
        if amplification[one, other] >= limit
    ]
    return sorted(found, key=lambda trade: -trade.amplification)


def groups(found: list[Trade]) -> list[list[int]]:
    """Return the lobes that trade, directly or through others, as sets; the largest first."""
    sets: list[set[int]] = []
    for trade in found:
        touched = [one for one in sets if one & set(trade.lobes)]
        sets = [one for one in sets if one not in touched]
        sets.append(set(trade.lobes).union(*touched))
    return sorted((sorted(one) for one in sets), key=lambda one: (-len(one), one))


def correlations(hessian: Tensor) -> Tensor:
    """Return the largest canonical correlation of each two lobes.  [8 N, 8 N] -> [N, N]."""
    count = len(hessian) // UNKNOWNS
    blocks = hessian.reshape(count, UNKNOWNS, count, UNKNOWNS).transpose(1, 2)
    white = _whitening(torch.stack([blocks[index, index] for index in range(count)]))
    rows = [
        torch.linalg.matrix_norm(white[index] @ blocks[index] @ white.mT, ord=2)
        for index in range(count)
    ]
    return torch.stack(rows)


def _whitening(own: Tensor) -> Tensor:
    """Return W with W H_ii W^T = 1 on what the map sees, 0 elsewhere.  [N, 8, 8]."""
    diagonal = torch.diagonal(own, dim1=-2, dim2=-1)
    scale = torch.where(diagonal > 0, diagonal.clamp(min=1e-300).rsqrt(), 0.0)
    values, vectors = torch.linalg.eigh(own * scale[:, :, None] * scale[:, None, :])
    seen = values > RANK * values.amax(-1, keepdim=True)
    inverse = torch.where(seen, values.clamp(min=1e-300).rsqrt(), 0.0)
    return (vectors * inverse[:, None, :]) @ vectors.mT * scale[:, None, :]


def _curvature(lobes: Lobes) -> Tensor:
    """Return H at a map that the lobes show exactly.  [N, .] -> [8 N, 8 N]."""
    lobes = lobes.to(torch.float64)  # float32 has no flux for the least radiance it holds
    mean = float(asg.flux(lobes).sum()) / (12 * math.pi)
    own = replace(lobes, amplitude=lobes.amplitude / mean).to(torch.float32)
    shown = texels.texel_means(own, ROWS, 2 * ROWS)
    frame = objective.target(shown.flatten(0, 1).mT[None].contiguous())
    images = lobe_images.images(own[None], frame.places)
    return equations.normal_equations(
        images, objective.loss_gradient(images.radiance, frame), frame
    )[0][0]
