# SPDX-License-Identifier: Apache-2.0
"""Lobes on a latlong grid: the mean radiance over each texel, also for lobes narrower than one.

A lobe as wide as four texels or more is sampled at the texel centres. A narrower one is averaged
over each texel that it reaches by Gauss and Legendre's rule, with as many nodes as its width needs;
so its energy counts in full wherever it lies between the centres.

Width means sigma = 1 / sqrt(2 sharpness), in radians, of the sharper axis; for the sg form
sigma = 1 / sqrt(sharpness), for the flat form the deviation of the whole lobe.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from asglight.lobes import asg, flat
from asglight.lobes.data import Form, Lobes
from asglight.sphere import latlong

NARROW_WIDTH_TEXELS = 4.0
"""In texels at the equator. Sampled at the centres, a lobe this wide is 0.26 % an axis off at its
peak, and 0.26 % off in flux at a pole (the midpoint rule's (texel / sigma)^2 / 24); elsewhere its
flux is exact to (texel in radians)^2 / 24, 6e-6 on 256 rows."""

NODES = ((1 / NARROW_WIDTH_TEXELS, 1), (1.0, 2), (2.0, 4))
"""Texels per sigma q, and the nodes a side that hold the mean up to there: the rule's error is
q^2 / 24 of one node, q^4 / 1440 of two, 6e-8 q^8 of four. Beyond, a texel is cut into panels of
four nodes."""

WIDTH_MAX = 1.0
"""Radians. However broad a lobe is, the hemisphere that it lives on is no smoother than this: on
grids of 12 rows and fewer its texels too are averaged over."""

CUTOFF = 18.0
"""Exponent beyond which a narrow lobe is left out: exp(-18) = 1.5e-8, below float32 rounding."""

SAMPLES_AT_ONCE = 1 << 21
"""Directions evaluated in one piece: 24 MB of float32 triples."""


@dataclass(frozen=True)
class Pairs:
    """Lobes and the texels that they reach, all of which take the same number of nodes.

    Attributes:
        lobe: Index of the lobe.  [T]
        texel: Index into the flattened grid.  [T]
        nodes: Nodes a side.
    """

    lobe: Tensor
    texel: Tensor
    nodes: int


Function = Callable[[Lobes, Tensor], Tensor]
"""Maps T lobes [T, .] and S directions of each in its own frame [T, 3, S] to values [T, ..., S]."""


def texel_means(lobes: Lobes, height: int, width: int) -> Tensor:
    """Return the mean radiance of all lobes together over each texel.

    Args:
        lobes: N lobes of one frame.  [N, .]
        height: Rows of the grid.
        width: Columns of the grid.

    Returns:
        Linear RGB radiance.  [H, W, 3]
    """
    values = unit_texel_means(lobes, height, width)  # [N, P]
    return (values.mT @ lobes.amplitude).reshape(height, width, 3)


def unit_texel_means(lobes: Lobes, height: int, width: int) -> Tensor:
    """Return the mean of each unit-amplitude lobe over each texel.  [N, H * W]."""
    if lobes.form is Form.FLAT:  # the terms are narrower than the lobe, each in its own way
        return flat.summed(unit_texel_means(flat.terms(lobes), height, width), 0)
    directions = latlong.directions(
        height, width, dtype=lobes.sharpness.dtype, device=lobes.sharpness.device
    ).reshape(-1, 3)
    narrow = is_narrow(lobes, height)
    values = directions.new_zeros(lobes.count, height * width)
    values[~narrow] = asg.unit_lobes(lobes.select(~narrow), directions)
    for pairs in reached_pairs(lobes, narrow, (height, width)):
        values[pairs.lobe, pairs.texel] = means(asg.local_values, lobes, pairs, (height, width))
    return values


def is_narrow(lobes: Lobes, height: int) -> Tensor:
    """Tell which lobes are narrower than four texels of a grid of `height` rows.  [..., N]."""
    return lobe_width(lobes).clamp(max=WIDTH_MAX) < NARROW_WIDTH_TEXELS * math.pi / height


def lobe_width(lobes: Lobes) -> Tensor:
    """Return sigma of the sharper axis, in radians.  [..., N]."""
    factor = asg.per_variance(lobes.form)
    return (factor * lobes.sharpness.amax(-1)).rsqrt()


def reached_pairs(lobes: Lobes, chosen: Tensor, grid: tuple[int, int]) -> list[Pairs]:
    """Return the texels that each chosen lobe reaches, gathered by the nodes they need.

    Args:
        lobes: N lobes.  [N, .]
        chosen: Which of them.  [N]
        grid: Rows and columns, (H, W).
    """
    found: dict[int, tuple[list[Tensor], list[Tensor]]] = {}
    for index in torch.nonzero(chosen).flatten().tolist():
        lobe = lobes.select(torch.tensor([index], device=lobes.axes.device))
        texels = texels_reached(lobe, grid)
        lists = found.setdefault(_nodes_for(lobe, grid), ([], []))
        lists[0].append(torch.full_like(texels, index))
        lists[1].append(texels)
    return [Pairs(torch.cat(a), torch.cat(b), nodes) for nodes, (a, b) in found.items()]


def _nodes_for(lobe: Lobes, grid: tuple[int, int]) -> int:
    width = min(float(lobe_width(lobe).detach()), WIDTH_MAX)
    texels_per_sigma = max(math.pi / grid[0], 2 * math.pi / grid[1]) / width
    for bound, nodes in NODES:
        if texels_per_sigma <= bound:
            return nodes
    bound, nodes = NODES[-1]
    return nodes * math.ceil(texels_per_sigma / bound)


def texels_reached(lobe: Lobes, grid: tuple[int, int]) -> Tensor:
    """Return the indices of the texels in which one lobe exceeds exp(-CUTOFF) of its peak.

    Args:
        lobe: One lobe.  [1, .]
        grid: Rows and columns, (H, W); half a texel's diagonal is the margin.
    """
    margin = math.hypot(math.pi / grid[0], 2 * math.pi / grid[1]) / 2
    sx, sy = lobe.sharpness[0].tolist()
    if lobe.form is Form.SG:
        reach = 2 * math.asin(min(1.0, math.sqrt(2 * CUTOFF / sx) / 2))
    else:
        reach = math.asin(min(1.0, math.sqrt(CUTOFF / min(sx, sy))))
    axis_z = lobe.axes[0, 2].tolist()
    around = _texels_around(axis_z, reach + 2 * margin, grid)
    if lobe.form is Form.BINGHAM:
        opposite = _texels_around([-c for c in axis_z], reach + 2 * margin, grid)
        around = np.union1d(around, opposite)
    texels = torch.from_numpy(around).to(lobe.axes.device)
    x, y, z = lobe.axes[0] @ _centres(grid, lobe.axes.dtype, str(lobe.axes.device))[:, texels]
    if lobe.form is Form.SG:
        chord = (x * x + y * y + (z - 1).square()).sqrt()
        inside = 0.5 * sx * (chord - margin).clamp(min=0).square() < CUTOFF
    else:
        near_x, near_y = (x.abs() - margin).clamp(min=0), (y.abs() - margin).clamp(min=0)
        inside = sx * near_x.square() + sy * near_y.square() < CUTOFF
        if lobe.form is not Form.BINGHAM:
            inside &= z > -margin
    return texels[inside]


@lru_cache(maxsize=16)
@torch.inference_mode(False)
def _centres(grid: tuple[int, int], dtype: torch.dtype, device: str) -> Tensor:
    return latlong.directions(*grid, dtype=dtype, device=device).reshape(-1, 3).mT.contiguous()


def _texels_around(direction: list[float], radius: float, grid: tuple[int, int]) -> np.ndarray:
    """Return the texels of a rectangle that holds every centre within `radius` of a direction."""
    height, width = grid
    polar = math.acos(min(1.0, max(-1.0, direction[1])))
    top, bottom = polar - radius, polar + radius
    rows = np.arange(
        max(0, math.floor(top / math.pi * height)),
        min(height, math.ceil(bottom / math.pi * height) + 1),
    )
    if top <= 0 or bottom >= math.pi or math.sin(radius) >= math.sin(polar):
        columns = np.arange(width)
    else:
        half = math.asin(math.sin(radius) / math.sin(polar)) / (2 * math.pi) * width
        middle = (0.5 - math.atan2(direction[0], direction[2]) / (2 * math.pi)) * width
        first, last = math.floor(middle - half), math.ceil(middle + half)
        columns = np.arange(first, min(last + 1, first + width)) % width
    return (rows[:, None] * width + columns).reshape(-1)


def means(function: Function, lobes: Lobes, pairs: Pairs, grid: tuple[int, int]) -> Tensor:
    """Average a function of lobe and direction over the texel of each pair.

    Args:
        function: Maps T lobes and S directions of each to values.
        lobes: The lobes that the pairs count.  [N, .]
        pairs: T pairs.
        grid: Rows and columns, (H, W).

    Returns:
        Means by solid angle, exact within the rule.  [T, ...]
    """
    pieces = list(_pieces(function, lobes, pairs, grid))
    return pieces[0] if len(pieces) == 1 else torch.cat(pieces)


def _pieces(
    function: Function, lobes: Lobes, pairs: Pairs, grid: tuple[int, int]
) -> Iterator[Tensor]:
    height, width = grid
    like = lobes.axes
    latitude = _row_nodes(height, pairs.nodes, like.dtype, str(like.device))
    longitude = _column_nodes(width, pairs.nodes, like.dtype, str(like.device))
    weight_x = latitude.weight_x
    step = max(1, SAMPLES_AT_ONCE // pairs.nodes**2)
    for start in range(0, len(pairs.lobe), step):
        texel, lobe = pairs.texel[start : start + step], pairs.lobe[start : start + step]
        own = lobes.select(lobe)
        row, column = texel // width, texel % width
        total: Tensor | None = None
        rows_at_once = max(1, SAMPLES_AT_ONCE // (pairs.nodes * len(texel)))
        for first in range(0, pairs.nodes, rows_at_once):
            chosen = slice(first, first + rows_at_once)
            sin_lat, cos_lat = latitude.sin[row, chosen], latitude.cos[row, chosen]
            sin_lon, cos_lon = longitude[0][column], longitude[1][column]
            directions = torch.stack(
                [
                    cos_lat[:, :, None] * sin_lon[:, None, :],
                    sin_lat[:, :, None].expand(-1, -1, pairs.nodes),
                    cos_lat[:, :, None] * cos_lon[:, None, :],
                ],
                dim=-1,
            ).flatten(1, 2)
            weight = (latitude.weight[row, chosen, None] * weight_x).flatten(1)
            values = function(own, own.axes @ directions.mT)
            part = (values * weight.reshape(len(texel), *[1] * (values.ndim - 2), -1)).sum(-1)
            total = part if total is None else total + part
        yield total if total is not None else like.new_zeros(0)


@dataclass(frozen=True)
class _RowNodes:
    """Nodes within each row: sin and cos of latitude, and their shares of a texel.  [H, n]."""

    sin: Tensor
    cos: Tensor
    weight: Tensor
    weight_x: Tensor  # along the row  [n]


def _rule(nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes in (0, 1) and weights of sum 1: panels of up to four Gauss-Legendre nodes."""
    of_panel = min(nodes, NODES[-1][1])
    panels = nodes // of_panel
    place, weight = np.polynomial.legendre.leggauss(of_panel)
    place = ((np.arange(panels)[:, None] + (place + 1) / 2) / panels).reshape(-1)
    return place, np.tile(weight / 2, panels) / panels


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _row_nodes(height: int, nodes: int, dtype: torch.dtype, device: str) -> _RowNodes:
    place, weight = _rule(nodes)
    latitude = math.pi / 2 - math.pi * (np.arange(height)[:, None] + place) / height
    share = weight * np.cos(latitude)
    share /= share.sum(-1, keepdims=True)
    arrays = np.sin(latitude), np.cos(latitude), share, weight
    return _RowNodes(*(torch.from_numpy(a).to(device, dtype) for a in arrays))


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _column_nodes(width: int, nodes: int, dtype: torch.dtype, device: str) -> tuple[Tensor, Tensor]:
    """Return sin and cos of longitude.  [W, n], [W, n]."""
    place, _ = _rule(nodes)
    longitude = math.pi - 2 * math.pi * (np.arange(width)[:, None] + place) / width
    sin, cos = torch.from_numpy(np.sin(longitude)), torch.from_numpy(np.cos(longitude))
    return sin.to(device, dtype), cos.to(device, dtype)
