# SPDX-License-Identifier: Apache-2.0
"""Lobes as a light to be integrated: broad ones on the grid, narrow ones at nodes of their own.

For the nodes, d = (x, r sin t, r cos t) in the lobe's frame with r = sqrt(1 - x^2) and x the
narrower axis: dw = dx dt, everything is smooth up to the edge of the hemisphere, and Gauss and
Legendre's rule serves both. A narrow lobe of the form sg ends before that, one of the form bingham
has two such halves.
"""

import math
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg, texels
from dcc.quadrature import ROWS, Light

BROAD_TEXELS = 6.0
"""Standard deviations of lobes that the grid holds: midpoints are then 0.1 % off at the peak."""

_REACH = 6.0
"""Standard deviations to which nodes go: 1e-8 of a Gaussian lies beyond."""

_NODE = math.radians(0.7)
"""Distance of nodes along a long lobe, as on the grid: a tenth of what the sharp ball mirrors."""

_NODES_MIN = 24
"""Across a lobe: four for each standard deviation, which Gauss's rule integrates to 1e-6."""


def light_of(lobes: Lobes) -> Light:
    """Return the lobes of one frame as a light.

    Args:
        lobes: N lobes.  [N, .]
    """
    lobes = lobes.to(torch.float64)
    is_broad = texels.lobe_width(lobes) > BROAD_TEXELS * math.pi / ROWS
    radiance = texels.texel_means(lobes.select(is_broad), ROWS, 2 * ROWS)
    nodes = [_nodes(lobes.select(index[None])) for index in (~is_broad).nonzero().flatten()]
    directions = [torch.zeros(0, 3, dtype=torch.float64)] + [where for where, _ in nodes]
    fluxes = [torch.zeros(0, 3, dtype=torch.float64)] + [flux for _, flux in nodes]
    return Light(radiance, torch.cat(directions), torch.cat(fluxes))


def gauss(low: float, high: float, spacing: float) -> tuple[Tensor, Tensor]:
    """Return Gauss and Legendre's nodes and weights on an interval.

    Args:
        low: Start.
        high: End.
        spacing: Mean distance of nodes, unless they would be fewer than 24.
    """
    count = max(_NODES_MIN, math.ceil((high - low) / spacing))
    place, weight = _legendre(count)
    return low + (high - low) * (place + 1) / 2, weight * (high - low) / 2


@lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[Tensor, Tensor]:
    """Return Gauss and Legendre's nodes and weights on [-1, 1]: time goes with `count` cubed."""
    place, weight = np.polynomial.legendre.leggauss(count)
    return torch.from_numpy(place), torch.from_numpy(weight)


def _nodes(lobe: Lobes) -> tuple[Tensor, Tensor]:
    """Return directions and fluxes of one lobe.  [T, 3], [T, 3]."""
    axes, sharpness = lobe.axes[0], lobe.sharpness[0]
    if sharpness[0] < sharpness[1]:  # x is to be the narrower; which way it points matters not
        axes, sharpness = axes[[1, 0, 2]], sharpness[[1, 0]]
    per_variance = asg.per_variance(lobe.form)
    reach = (_REACH * (per_variance * sharpness).rsqrt()).clamp(max=1).tolist()
    x, weight_x = gauss(-reach[0], reach[0], _NODE)
    turn = math.asin(reach[1])
    t, weight_t = gauss(-turn, turn, _NODE)
    radius = (1 - x * x).sqrt()[:, None]
    local = torch.stack([x[:, None].expand(-1, len(t)), radius * t.sin(), radius * t.cos()], -1)
    directions = local.view(-1, 3) @ axes
    weights = (weight_x[:, None] * weight_t).view(-1, 1)
    flux = weights * asg.evaluate(lobe, directions)
    if lobe.form is Form.BINGHAM:  # the same from behind
        return torch.cat([directions, -directions]), torch.cat([flux, flux])
    return directions, flux
