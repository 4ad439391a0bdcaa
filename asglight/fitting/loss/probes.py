# SPDX-License-Identifier: Apache-2.0
"""What materials show of a map: the probes of the fit's loss.

A probe filters a map with a kernel around directions that lie on rings of latitude. Kernel and grid
are the same at every longitude, so the filter is a convolution along the rows: one small matrix
from rows to rings for each frequency of longitude, the same for its cosine and its sine. Rows are
short: a product with the matrix of the Fourier transform takes less time than a fast one, between
whose steps data is moved. Images are channels first, [..., P].

The probes see the map on a coarse grid, to which its light was brought place by place
(splatting.py), for what they show is smooth at that scale.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.compiled import layout
from asglight.fitting.loss.grid import coarser
from asglight.shading import kernels
from asglight.sphere import latlong


@dataclass(frozen=True)
class Probe:
    """One material that the fit must look right on.

    Attributes:
        kernel: `kernels.LAMBERT`, `kernels.EVEN` or a GGX roughness.
        weight: w_k.
        rings: Rings on which it looks, evenly over latitude; their spacing is below its width.
    """

    kernel: str | float
    weight: float
    rings: int


PROBES = (
    Probe(kernels.EVEN, 10.0, 1),
    Probe(kernels.LAMBERT, 4.0, 8),
    Probe(0.5, 2.0, 16),
    Probe(0.25, 1.0, 24),
)

SILENT = 1e-7
"""Frequencies of which a probe lets through less than this share, below the rounding of float32,
are left out of its compiled tables: all but one of the mean radiance's."""

CURVATURE_ROWS = 32
"""Rows of the coarsest grid that is filtered, at most: the Gauss-Newton matrix's (newton.py)."""


def probe(images: Tensor, height: int, sources: tuple[Probe, ...] = PROBES) -> Tensor:
    """Filter images with every probe.

    Args:
        images: On a grid of `height` rows.  [..., P]
        height: Rows of that grid.
        sources: The probes.

    Returns:
        What they show of each image, probe by probe and ring by ring.  [..., D]
    """
    if compiled.runs_on(images):
        return compiled.probe(images, tables(height, sources))
    device = str(images.device)
    filters = _filters(sources, height, device).to(images)
    waves = _waves(2 * height, 1, device).to(images)
    spectrum = waves @ images.reshape(-1, 2 * height).mT  # [2 (H + 1), K H]
    rings = spectrum.reshape(height + 1, -1, height) @ filters  # [H + 1, 2 K, R]
    views = []
    for source, own in zip(sources, rings.split([each.rings for each in sources], -1), strict=True):
        waves = _waves(2 * height, _stride(source, height), device).to(images)
        views.append((own.reshape(len(waves), -1).mT @ waves).reshape(*images.shape[:-1], -1))
    return torch.cat(views, -1)


def pull(views: Tensor, height: int) -> Tensor:
    """Apply the transpose of `probe`.

    Args:
        views: A number for each view of each probe.  [..., D]
        height: Rows of the grid that was probed.

    Returns:
        On that grid.  [..., P]
    """
    lead, device = views.shape[:-1], str(views.device)
    rings = []
    for source, view in zip(PROBES, split(views, height), strict=True):
        waves = _waves(2 * height, _stride(source, height), device).to(views)
        ring = waves @ view.reshape(-1, waves.shape[-1]).mT
        rings.append(ring.reshape(height + 1, -1, source.rings))
    filters = _filters(PROBES, height, device).to(views)
    spectrum = torch.cat(rings, -1) @ filters.mT  # [H + 1, 2 K, H]
    waves = _waves(2 * height, 1, device).to(views)
    return (spectrum.reshape(len(waves), -1).mT @ waves).reshape(*lead, -1)


def split(views: Tensor, height: int, sources: tuple[Probe, ...] = PROBES) -> tuple[Tensor, ...]:
    """Return what each probe shows.  [..., D] -> one [..., D'] a probe."""
    return views.split(_counts(sources, height), -1)


def of_views(numbers: Tensor, height: int) -> Tensor:
    """Give each view the number of its probe.  [..., K'] -> [..., D]."""
    return numbers[..., _sources(height, str(numbers.device))]


def directions(source: Probe, rows: int) -> Tensor:
    """Return the directions at which a probe looks.  [D, 3]."""
    v = (torch.arange(source.rings, dtype=torch.float64) + 0.5) / source.rings
    u = (torch.arange(0, 2 * rows, _stride(source, rows), dtype=torch.float64) + 0.5) / (2 * rows)
    return latlong.direction_from_uv(u[None, :], v[:, None]).flatten(0, 1).float()


def tables(height: int, sources: tuple[Probe, ...] = PROBES) -> layout.Probes:
    """Return the probes on a grid of `height` rows, for what is compiled."""
    return _tables(height, sources)


@lru_cache(maxsize=16)  # to it, a default that is given and one that is left out are two calls
@torch.inference_mode(False)
def _tables(height: int, sources: tuple[Probe, ...]) -> layout.Probes:
    filters = [_filter(source, height) for source in sources]
    strides = [_stride(source, height) for source in sources]
    sizes = [each.abs().amax((1, 2)) for each in filters]
    return layout.tables(
        _waves(2 * height, 1, "cpu"),
        filters,
        [_waves(2 * height, stride, "cpu") for stride in strides],
        [int((size > SILENT * size.max()).nonzero().max()) + 1 for size in sizes],
    )


@lru_cache(maxsize=64)
def _stride(source: Probe, rows: int) -> int:
    """Return the texels from view to view along a ring: as far apart as the rings, at most.

    They are counted on the coarsest grid that is filtered, so that every grid has the same views.
    """
    coarse = coarser(rows, CURVATURE_ROWS)
    most = max(1, coarse // source.rings)
    return rows // coarse * max(s for s in range(1, most + 1) if 2 * coarse % s == 0)


@lru_cache(maxsize=64)
def _counts(sources: tuple[Probe, ...], rows: int) -> tuple[int, ...]:
    """Return how many views each probe has."""
    return tuple(source.rings * (2 * rows // _stride(source, rows)) for source in sources)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _sources(rows: int, device: str) -> Tensor:
    """Return the index of each view's probe.  [D]."""
    counts = torch.tensor(_counts(PROBES, rows))
    return torch.arange(len(counts)).repeat_interleave(counts).to(device)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def shares(height: int, device: str, sources: tuple[Probe, ...] = PROBES) -> Tensor:
    """Return each view's share of the sphere, 1 in all for each probe.  [D]."""
    found = []
    for source in sources:
        columns = 2 * height // _stride(source, height)
        areas = latlong.texel_solid_angles(source.rings, columns, dtype=torch.float64)
        found.append((areas / (4 * math.pi)).reshape(-1))
    return torch.cat(found).to(device, torch.float32)


@lru_cache(maxsize=64)
@torch.inference_mode(False)
def _waves(count: int, stride: int, device: str) -> Tensor:
    """Return the real Fourier basis, orthonormal: of each frequency the cosine, then the sine.

    Those sines that are no wave, of the first frequency and the last, are 0.

    Args:
        count: Texels of a row; even.
        stride: From one of those texels to the next at which the waves are wanted.
        device: Of the result.

    Returns:
        [count + 2, count / stride]
    """
    frequency = torch.arange(count // 2 + 1, dtype=torch.float64)[:, None]
    angle = 2 * math.pi / count * frequency * torch.arange(0, count, stride, dtype=torch.float64)
    size = torch.full_like(frequency, math.sqrt(2 / count))
    size[0] = size[-1] = math.sqrt(1 / count)
    sines = size * angle.sin()
    sines[[0, -1]] = 0.0
    waves = torch.stack([size * angle.cos(), sines], dim=1).flatten(0, 1)
    return waves.to(device, torch.float32)


@lru_cache(maxsize=64)
@torch.inference_mode(False)
def _filters(sources: tuple[Probe, ...], rows: int, device: str) -> Tensor:
    """Return the filter from rows to the rings of all probes by frequency.  [H + 1, H, R]."""
    return torch.cat([_filter(source, rows) for source in sources], -1).to(device)


@lru_cache(maxsize=64)
@torch.inference_mode(False)
def _filter(source: Probe, rows: int) -> Tensor:
    """Return the filter of one probe, computed in float64.  [H + 1, H, R]."""
    texels, solid_angle = _texels(rows)
    v = (torch.arange(source.rings, dtype=torch.float64) + 0.5) / source.rings
    u = torch.tensor(0.5 / (2 * rows), dtype=torch.float64)  # on the first column of texels
    found = torch.empty(source.rings, rows, rows + 1, dtype=torch.float32)
    some = max(1, kernels.BLOCK // len(texels))
    cosine = latlong.direction_from_uv(u, v) @ texels.mT  # at once: of one ring it rounds otherwise
    for of_rings, ring in zip(cosine.split(some), found.split(some), strict=True):
        weight = kernels.kernel_values(source.kernel, of_rings) * solid_angle
        weight /= weight.sum(-1, keepdim=True)
        # even in the difference of longitude, so a cosine and its sine are filtered alike
        ring.copy_(torch.fft.rfft(weight.unflatten(-1, (rows, 2 * rows))).real)
    return found.permute(2, 1, 0)


@lru_cache(maxsize=1)  # for one probe of a grid after the other
@torch.inference_mode(False)
def _texels(rows: int) -> tuple[Tensor, Tensor]:
    """Return directions [P, 3] and solid angles [P] of the texels of a grid, in float64."""
    directions = latlong.directions(rows, 2 * rows, dtype=torch.float64).reshape(-1, 3)
    solid_angle = latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64)
    return directions, solid_angle.reshape(-1)
