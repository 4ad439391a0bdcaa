# SPDX-License-Identifier: Apache-2.0
"""What materials show of a map: the probes of the fit's loss.

A probe filters a map with a kernel around directions that lie on rings of latitude. Kernel and grid
are the same at every longitude, so the filter is a convolution along the rows: one small matrix
from rows to rings for each frequency of longitude. Images are channels first, [..., P].

The probes see the map on a coarse grid, to which its light was brought place by place
(splatting.py), for what they show is smooth at that scale.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.fitting.grid import coarser
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

CURVATURE_ROWS = 32
"""Rows of the coarsest grid that is filtered, at most: the Gauss-Newton matrix's (newton.py)."""


def probe(images: Tensor, height: int, sources: tuple[Probe, ...] = PROBES) -> tuple[Tensor, ...]:
    """Filter images with every probe.

    Args:
        images: On a grid of `height` rows.  [..., P]
        height: Rows of that grid.
        sources: The probes.

    Returns:
        What each probe shows of each image, ring by ring.  One [..., D] a probe.
    """
    spectrum = torch.fft.rfft(images.unflatten(-1, (height, 2 * height)))
    rings = _between_rows(_stacked_spectra(sources, height, str(images.device)), spectrum)
    parts = torch.fft.irfft(rings, 2 * height).split([p.rings for p in sources], dim=-2)
    strides = [_stride(p, height) for p in sources]
    return tuple(part[..., ::s].flatten(-2) for part, s in zip(parts, strides, strict=True))


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _stacked_spectra(sources: tuple[Probe, ...], height: int, device: str) -> Tensor:
    return torch.cat([_spectra(p, height, device) for p in sources], dim=1)


def pull(views: tuple[Tensor, ...], height: int) -> Tensor:
    """Apply the transpose of `probe`.

    Args:
        views: A number for each view of each probe.  One [..., D] a probe
        height: Rows of the grid that was probed.

    Returns:
        On that grid.  [..., P]
    """
    rings = views[0].new_zeros(*views[0].shape[:-1], sum(p.rings for p in PROBES), 2 * height)
    first = 0
    for source, view in zip(PROBES, views, strict=True):
        placed = rings[..., first : first + source.rings, :: _stride(source, height)]
        placed.copy_(view.unflatten(-1, (source.rings, -1)))
        first += source.rings
    weights = _stacked_spectra(PROBES, height, str(rings.device))
    spectrum = _between_rows(weights.mT, torch.fft.rfft(rings))
    return torch.fft.irfft(spectrum, 2 * height).flatten(-2)


def _between_rows(weights: Tensor, spectrum: Tensor) -> Tensor:
    """Multiply each frequency by its matrix.  [F, R, H], [..., H, F] complex -> [..., R, F]."""
    rows, frequencies = spectrum.shape[-2:]
    parts = torch.view_as_real(spectrum.reshape(-1, rows, frequencies)).permute(2, 1, 0, 3)
    result = torch.bmm(weights, parts.reshape(frequencies, rows, -1)).unflatten(2, (-1, 2))
    back = torch.view_as_complex(result).permute(2, 1, 0)  # moved as complex numbers, not as reals
    return back.reshape(*spectrum.shape[:-2], *back.shape[-2:])


def shares(height: int, device: str, sources: tuple[Probe, ...] = PROBES) -> tuple[Tensor, ...]:
    """Return each view's share of the sphere.  One [D] a probe."""
    return tuple(_shares(p, height, device) for p in sources)


def directions(source: Probe, rows: int) -> Tensor:
    """Return the directions at which a probe looks.  [D, 3]."""
    v = (torch.arange(source.rings, dtype=torch.float64) + 0.5) / source.rings
    u = (torch.arange(0, 2 * rows, _stride(source, rows), dtype=torch.float64) + 0.5) / (2 * rows)
    return latlong.direction_from_uv(u[None, :], v[:, None]).flatten(0, 1).float()


@lru_cache(maxsize=64)
def _stride(source: Probe, rows: int) -> int:
    """Return the texels from view to view along a ring: as far apart as the rings, at most.

    They are counted on the coarsest grid that is filtered, so that every grid has the same views.
    """
    coarse = coarser(rows, CURVATURE_ROWS)
    most = max(1, coarse // source.rings)
    return rows // coarse * max(s for s in range(1, most + 1) if 2 * coarse % s == 0)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _shares(source: Probe, rows: int, device: str) -> Tensor:
    columns = 2 * rows // _stride(source, rows)
    areas = latlong.texel_solid_angles(source.rings, columns, dtype=torch.float64)
    return (areas / (4 * math.pi)).reshape(-1).to(device, torch.float32)


@lru_cache(maxsize=32)
@torch.inference_mode(False)
def _spectra(source: Probe, rows: int, device: str) -> Tensor:
    """Return the filter from rows to rings for each frequency of longitude.  [F, R, H]."""
    texels = latlong.directions(rows, 2 * rows, dtype=torch.float64).reshape(-1, 3)
    v = (torch.arange(source.rings, dtype=torch.float64) + 0.5) / source.rings
    u = torch.tensor(0.5 / (2 * rows), dtype=torch.float64)  # on the first column of texels
    cosine = latlong.direction_from_uv(u, v) @ texels.mT
    weight = kernels.kernel_values(source.kernel, cosine).double()
    weight = weight * latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64).reshape(-1)
    weight = (weight / weight.sum(-1, keepdim=True)).reshape(source.rings, rows, 2 * rows)
    # even in the difference of longitude, so the frequencies are real
    return torch.fft.rfft(weight).real.permute(2, 0, 1).contiguous().to(device, torch.float32)
