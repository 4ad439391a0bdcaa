# SPDX-License-Identifier: Apache-2.0
"""The latlong (equirectangular) grid: directions, exact solid angles, exact reduction.

Conventions, as OpenEXR and UsdLux define them: right-handed, +Y up, row 0 at +Y,
`lon = pi - 2 pi u`, `lat = pi/2 - pi v`, `d = (cos lat sin lon, sin lat, cos lat cos lon)`,
texel centres at `(i + 1/2) / W` and `(j + 1/2) / H`. The image centre is +Z, u = 1/4 is +X.

Symbols: H, W rows and columns; P query directions; u, v in [0, 1] from the top left corner.
"""

import math

import torch
from torch import Tensor


def direction_from_uv(u: Tensor, v: Tensor) -> Tensor:
    """Return the unit directions of latlong coordinates.

    Args:
        u: Horizontal coordinate, 0 at the left edge, 1 at the right; broadcast with v.  [...]
        v: Vertical coordinate, 0 at the top (+Y), 1 at the bottom.  [...]

    Returns:
        Unit directions (x, y, z).  [..., 3]
    """
    longitude = math.pi - 2 * math.pi * u
    latitude = math.pi / 2 - math.pi * v
    cos_latitude = torch.cos(latitude)
    components = torch.broadcast_tensors(
        cos_latitude * torch.sin(longitude),
        torch.sin(latitude),
        cos_latitude * torch.cos(longitude),
    )
    return torch.stack(components, dim=-1)


def uv_from_direction(direction: Tensor) -> tuple[Tensor, Tensor]:
    """Return the latlong coordinates of directions; the inverse of `direction_from_uv`.

    Args:
        direction: Vectors of any positive length.  [..., 3]

    Returns:
        u and v, each in [0, 1]; at a pole u is 1/2.  [...], [...]
    """
    x, y, z = (direction + 0.0).unbind(-1)  # -0 would turn a pole by half a circle
    u = 0.5 - torch.atan2(x, z) / (2 * math.pi)
    v = 0.5 - torch.atan2(y, torch.hypot(x, z)) / math.pi
    return u, v


def directions(
    height: int,
    width: int,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str | None = None,
) -> Tensor:
    """Return the direction of every texel centre.

    Computed in float64 and rounded once, so that neighbouring texels of a large map stay distinct.

    Returns:
        Unit directions.  [H, W, 3]
    """
    v = (torch.arange(height, dtype=torch.float64) + 0.5) / height
    u = (torch.arange(width, dtype=torch.float64) + 0.5) / width
    v, u = torch.meshgrid(v, u, indexing="ij")
    return direction_from_uv(u, v).to(dtype=dtype, device=device)


def texel_solid_angles(
    height: int,
    width: int,
    *,
    dtype: torch.dtype = torch.float32,
    device: torch.device | str | None = None,
) -> Tensor:
    """Return the exact solid angle of every texel, in steradians.

    A row is the band between two latitudes: `(2 pi / W) (sin lat_top - sin lat_bottom)`. The sum
    is 4 pi to rounding.

    Returns:
        Steradians.  [H, W]
    """
    rows = (2 * math.pi / width) * torch.diff(_band_edges(height))
    return rows.to(dtype=dtype, device=device)[:, None].expand(height, width)


def reduce(radiance: Tensor, height: int, width: int) -> Tensor:
    """Average a map onto a coarser grid, exactly weighted by solid angle.

    Each new texel is the mean of the radiance over its own solid angle, the map taken as constant
    within each of its texels; the flux of the map is the flux of the result. Any ratio of sizes is
    allowed, also a finer grid, where texels are split. The overlap of two latlong texels is a
    product of a latitude band and a longitude interval, so two small matrices do it.

    Args:
        radiance: Map.  [H, W, C]
        height: Rows of the result.
        width: Columns of the result.

    Returns:
        Map of the same dtype.  [height, width, C]
    """
    if radiance.shape[:2] == (height, width):
        return radiance
    if radiance.shape[0] % height == 0 and radiance.shape[1] % width == 0:
        areas = torch.diff(_band_edges(radiance.shape[0])).reshape(height, -1)
        return _block_means(radiance, areas, width)
    rows = _covered_shares(_band_edges(radiance.shape[0]), _band_edges(height)).to(radiance)
    columns = _covered_shares(_column_edges(radiance.shape[1]), _column_edges(width)).to(radiance)
    by_row = (rows @ radiance.flatten(1)).reshape(height, *radiance.shape[1:])  # [height, W, C]
    return columns @ by_row


def split(radiance: Tensor, rows: int) -> Tensor:
    """Split the texels of a map that has fewer rows: the same light on a finer grid.

    Args:
        radiance: Map.  [H, W, C]
        rows: Rows of the result, at least.

    Returns:
        The map, each texel as a square of equal ones.  [k H, k W, C]
    """
    height, width = radiance.shape[:2]
    factor = -(-rows // height)
    return reduce(radiance, factor * height, factor * width)


def _block_means(rows: Tensor, areas: Tensor, width: int) -> Tensor:
    """Average whole texels, weighted by the areas of their rows: a tenth of the general cost.

    Args:
        rows: Texels of equal width.  [height high, width wide, C]
        areas: Of the rows, `high` of them for each row of the result.  [height, high]
        width: Columns of the result.

    Returns:
        [height, width, C]
    """
    height, high = areas.shape
    wide = rows.shape[1] // width
    shares = (areas / (wide * areas.sum(1, keepdim=True))).to(rows)
    blocks = rows.reshape(height, high, width, wide, -1)
    # strided slices: a reduction over a short inner axis takes several times as long
    along = sum((blocks[:, :, :, k] for k in range(1, wide)), blocks[:, :, :, 0])
    return (along * shares[:, :, None, None]).sum(1)


def _band_edges(height: int) -> Tensor:
    """Return -sin(latitude) of the row edges, ascending from -1: equal steps are equal areas."""
    return -torch.cos(torch.linspace(0, math.pi, height + 1, dtype=torch.float64))


def _column_edges(width: int) -> Tensor:
    return torch.linspace(0, 1, width + 1, dtype=torch.float64)


def _covered_shares(source_edges: Tensor, target_edges: Tensor) -> Tensor:
    """Return the share of each target interval that each source interval covers; rows sum to 1."""
    low = torch.maximum(source_edges[None, :-1], target_edges[:-1, None])
    high = torch.minimum(source_edges[None, 1:], target_edges[1:, None])
    covered = (high - low).clamp(min=0)
    return covered / covered.sum(dim=1, keepdim=True)
