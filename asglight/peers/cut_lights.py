# SPDX-License-Identifier: Apache-2.0
"""Point lights from regions of the map: median cut and variance cut.

Both cut the latlong map into rectangles and put a light where the light of each one is.

median cut    [Debevec 2005, "A median cut algorithm for light probe sampling", SIGGRAPH posters]:
              along the longer side, its width measured at the middle row, into halves of equal
              energy
variance cut  [Viriyothai and Debevec 2009, "Variance minimization light probe sampling", SIGGRAPH
              posters]: where the larger variance of the two parts is smallest; the variance of a
              region is the sum of energy times squared distance from the region's centroid

Energy is luminance times solid angle. Both papers cut every region n times, into 2^n; here the
region with most energy, or most variance, is cut next, which gives the same regions wherever all
would be cut and any number otherwise. Distances are chords and centroids mean directions, so that
poles and seam need no care. Sums over rectangles come from summed-area tables.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from asglight.luminance import luminance
from asglight.sphere import latlong

FLOATS = 5
"""Of a light: direction 2, RGB 3."""


@dataclass(frozen=True)
class PointLights:
    """Lights without a size: radiance is a sum of impulses.

    Attributes:
        directions: Unit.  [N, 3]
        flux: RGB flux, in radiance times steradians.  [N, 3]
    """

    directions: Tensor
    flux: Tensor

    @property
    def floats(self) -> int:
        """Numbers that it takes to store this."""
        return FLOATS * len(self.directions)

    def texel_means(self, height: int, width: int) -> Tensor:
        """Return the mean radiance over each texel: all of a light in the one it lies in."""
        u, v = latlong.uv_from_direction(self.directions)
        row = (v * height).long().clamp(max=height - 1)
        column = (u * width).long().clamp(max=width - 1)
        flux = torch.zeros(height * width, 3, dtype=self.flux.dtype)
        flux.index_add_(0, row * width + column, self.flux)
        means = flux / latlong.texel_solid_angles(height, width).reshape(-1, 1)
        return means.reshape(height, width, 3).float()


class Region(NamedTuple):
    """Rows [top, bottom) and columns [left, right)."""

    top: int
    bottom: int
    left: int
    right: int


class Sums:
    """Energy and its first moment over any rectangle of a map."""

    def __init__(self, reference: Tensor) -> None:
        """Make the tables.  reference: [H, W, 3]."""
        height, width, _ = reference.shape
        self.height, self.width = height, width
        solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
        energy = luminance(reference.double()) * solid_angle
        directions = latlong.directions(height, width, dtype=torch.float64)
        values = torch.cat([energy[..., None], energy[..., None] * directions], dim=-1)
        self._table = torch.zeros(height + 1, width + 1, 4, dtype=torch.float64)
        self._table[1:, 1:] = values.cumsum(0).cumsum(1)

    def of(self, region: Region) -> Tensor:
        """Return energy and first moment of a region.  [4]."""
        top, bottom, left, right = region
        table = self._table
        return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]

    def before(self, region: Region, axis: int) -> Tensor:
        """Return the sums of the first 1, 2, ... rows (axis 0) or columns (1) of a region.

        The last row or column is left out: a cut has something on either side.  [cuts, 4]
        """
        top, bottom, left, right = region
        if axis == 0:
            edges = self._table[top:bottom, right] - self._table[top:bottom, left]
        else:
            edges = self._table[bottom, left:right] - self._table[top, left:right]
        return edges[1:] - edges[:1]


def median_cut(reference: Tensor, floats: int) -> PointLights:
    """Place lights by median cut.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        floats: Budget, 5 or more.
    """
    return _lights(reference, floats, _median, lambda sums: float(sums[0]))


def variance_cut(reference: Tensor, floats: int) -> PointLights:
    """Place lights by variance cut; arguments as of `median_cut`."""
    return _lights(reference, floats, _least_variance, lambda sums: float(variance(sums)))


def variance(sums: Tensor) -> Tensor:
    """Return the sum of energy times squared chord to the centroid.  [..., 4] -> [...].

    Directions have length 1, so that of energy E and first moment M it is E - |M|^2 / E.
    """
    energy = sums[..., 0].clamp(min=1e-300)  # a black region has no variance, not 0 / 0
    return (sums[..., 0] - sums[..., 1:].square().sum(-1) / energy).clamp(min=0)


Cut = Callable[[Sums, Region], tuple[Region, Region]]


def _lights(
    reference: Tensor, floats: int, cut: Cut, urgency: Callable[[Tensor], float]
) -> PointLights:
    """Cut the most urgent region until there are enough, and light each from its centroid."""
    height, width, _ = reference.shape
    sums = Sums(reference)
    regions = [Region(0, height, 0, width)]
    while len(regions) < floats // FLOATS:
        divisible = [r for r in regions if (r.bottom - r.top) * (r.right - r.left) > 1]
        if not divisible:
            break
        chosen = max(divisible, key=lambda region: urgency(sums.of(region)))
        regions.remove(chosen)
        regions += cut(sums, chosen)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    flux = reference.double() * solid_angle
    colours = torch.stack([flux[r.top : r.bottom, r.left : r.right].sum((0, 1)) for r in regions])
    return PointLights(torch.stack([_centroid(sums, r) for r in regions]), colours)


def _median(sums: Sums, region: Region) -> tuple[Region, Region]:
    high = region.bottom - region.top
    latitude = math.pi * (0.5 - (region.top + region.bottom) / 2 / sums.height)
    wide = (region.right - region.left) * math.cos(latitude)
    axis = 0 if high > 1 and (high >= wide or region.right - region.left == 1) else 1
    before = sums.before(region, axis)[:, 0]
    nearest = (before - sums.of(region)[0] / 2).abs().argmin()
    return _halves(region, axis, int(nearest) + 1)


def _least_variance(sums: Sums, region: Region) -> tuple[Region, Region]:
    whole = sums.of(region)
    found: list[tuple[float, int, int]] = []
    for axis in (0, 1):
        before = sums.before(region, axis)
        if len(before):
            larger = torch.maximum(variance(before), variance(whole - before))
            found.append((float(larger.min()), axis, int(larger.argmin()) + 1))
    _, axis, position = min(found)
    return _halves(region, axis, position)


def _halves(region: Region, axis: int, position: int) -> tuple[Region, Region]:
    top, bottom, left, right = region
    if axis == 0:
        return Region(top, top + position, left, right), Region(top + position, bottom, left, right)
    return Region(top, bottom, left, left + position), Region(top, bottom, left + position, right)


def _centroid(sums: Sums, region: Region) -> Tensor:
    """Return the mean direction of a region's light; of a black one, its middle."""
    moment = sums.of(region)[1:]
    if float(moment.norm()) > 0:
        return moment / moment.norm()
    u = torch.tensor((region.left + region.right) / 2 / sums.width, dtype=torch.float64)
    v = torch.tensor((region.top + region.bottom) / 2 / sums.height, dtype=torch.float64)
    return latlong.direction_from_uv(u, v)
