# SPDX-License-Identifier: Apache-2.0
"""Rough and matte balls under a map by sums over coarse texels: no samples, no noise.

A ball of roughness 0.5 or more is smooth. It is known everywhere from its values at some normals,
and it cannot tell texels of a few degrees from each other. The values are a matrix [normals,
texels] times the flux of the texels, and the matrix is the same for every map, view and turn: the
map is brought into the camera's frame, where the view is +Z.

Normals lie on a square grid over the disc whose radius is their angle to the view (the azimuthal
equidistant disc), so that the rim, where a layer changes fastest, has more of them than the
picture has pixels. Grid and texels are symmetric left to right and top to bottom: the matrix holds
a quarter of the normals and meets the map four times, mirrored.

Symbols: G normals along a side of the grid, Q = (G + 1) / 2 of a quarter; T rows of texels.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.shading import ggx
from asglight.sphere import latlong

GRID = 65
"""Normals along a side: 2.8 degrees from one to the next."""

TEXEL_ROWS = 40
"""Rows of texels: 4.5 degrees, a quarter of the half width of a highlight at a roughness of 0.5."""

SOURCE_ROWS = 128
"""Rows of the map whose texels are dealt out to those in the camera's frame."""

ROUGHNESS_MIN = 0.5
"""Sharper balls would need finer grids: the matrix grows as 1 / roughness^8."""

_COS_VIEW_MIN = 1e-3
"""Stands for n.v = 0 on the rim, where V is 0 / 0."""


class Layer(NamedTuple):
    """What a quarter of the normals shows of the flux of each texel.

    Attributes:
        plain: The part A of `f0 A + B`.  [Q Q, T 2T]
        grazing: The part B.  [Q Q, T 2T]
    """

    plain: Tensor
    grazing: Tensor


def normals() -> Tensor:
    """Return the normals of a quarter of the grid, right and up, camera frame.  [Q, Q, 3]."""
    place = torch.linspace(0, 1, (GRID + 1) // 2, dtype=torch.float64)
    up, right = torch.meshgrid(place, place, indexing="ij")
    radius = torch.hypot(right, up)
    angle = 0.5 * math.pi * radius.clamp(max=1)  # off the disc: its rim
    scale = torch.sin(angle) / radius.clamp(min=1e-12)  # 1e-12: the middle, where right is 0
    return torch.stack([right * scale, up * scale, torch.cos(angle)], dim=-1)


@functools.lru_cache(maxsize=4)
def layer(roughness: float) -> Layer:
    """Return the matrices of a GGX layer; rows sum to the layer's exact directional albedo.

    Args:
        roughness: Perceptual, ROUGHNESS_MIN or more.
    """
    alpha = roughness**2
    normal = normals().flatten(0, 1).float()  # [QQ, 3]
    lights = latlong.directions(TEXEL_ROWS, 2 * TEXEL_ROWS).flatten(0, 1)
    cos_view = normal[:, 2:].clamp(min=_COS_VIEW_MIN)
    cos_light = (normal @ lights.mT).clamp(min=0)
    half2 = (2 + 2 * lights[:, 2]).clamp(min=1e-6)  # |v + l|^2; straight behind there is no light
    sin2_half = (1 - (cos_view + cos_light).square() / half2).clamp(min=0)
    kernel = ggx.distribution(sin2_half, alpha)
    kernel *= ggx.visibility(cos_view, cos_light, alpha) * cos_light
    grazing = (1 - 0.5 * half2.sqrt()).clamp(0, 1) ** 5  # v.h is half of |v + l|
    exact = ggx.albedo_parts(cos_view[:, 0].double(), alpha).float()
    areas = latlong.texel_solid_angles(TEXEL_ROWS, 2 * TEXEL_ROWS).expand(-1, 2 * TEXEL_ROWS)
    parts = []
    for column, part in enumerate((kernel * (1 - grazing), kernel * grazing)):
        found = (part * areas.reshape(1, -1)).sum(1)
        parts.append(part * (exact[:, column] / found.clamp(min=1e-12))[:, None])
    return Layer(*parts)


@functools.lru_cache(maxsize=1)
def cosines() -> Tensor:
    """Return the matrix of irradiance over pi; rows of an even map give its radiance.

    [Q Q, T 2T].
    """
    normal = normals().flatten(0, 1).float()
    lights = latlong.directions(TEXEL_ROWS, 2 * TEXEL_ROWS).flatten(0, 1)
    areas = latlong.texel_solid_angles(TEXEL_ROWS, 2 * TEXEL_ROWS).expand(-1, 2 * TEXEL_ROWS)
    kernel = (normal @ lights.mT).clamp(min=0)
    return kernel / (kernel * areas.reshape(1, -1)).sum(1, keepdim=True)


@functools.lru_cache(maxsize=8)
def albedo(roughness: float) -> Tensor:
    """Return the directional albedo of the whole grid in its two parts.  [G, G, 2]."""
    cos_view = normals()[..., 2].clamp(min=_COS_VIEW_MIN)
    parts = ggx.albedo_parts(cos_view.flatten(), roughness**2)
    return _mirrored(parts.view(*cos_view.shape, 2).float()[None].expand(4, -1, -1, -1))


class CameraMap:
    """A latlong map as the flux of texels in a camera's frame, in each of four mirrored forms."""

    def __init__(self, radiance: np.ndarray, camera_from_world: np.ndarray) -> None:
        """Deal the light of a map's texels out to those of the camera's frame.

        Args:
            radiance: Finite and not negative, float32.  [H, W, 3]
            camera_from_world: A rotation.  [3, 3]
        """
        image = torch.from_numpy(np.ascontiguousarray(radiance))
        # a map of fewer texels than there are places to deal them out to is even within them
        finer = max(1, math.ceil(SOURCE_ROWS / min(image.shape[0], image.shape[1] / 2)))
        image = image.repeat_interleave(finer, 0).repeat_interleave(finer, 1)
        rows, columns = SOURCE_ROWS, 2 * SOURCE_ROWS
        image = latlong.reduce(image, rows, columns)
        areas = latlong.texel_solid_angles(rows, columns)[..., None]
        flux = (image * areas).reshape(-1, 3)
        rotation = camera_from_world.astype(np.float64).tobytes()
        place, weight = _dealing(rotation, rows, columns)
        dealt = torch.zeros(2 * TEXEL_ROWS**2, 3)
        for corner in range(4):
            dealt.index_add_(0, place[corner], flux * weight[corner][:, None])
        texels = dealt.view(TEXEL_ROWS, 2 * TEXEL_ROWS, 3)
        # a normal that is mirrored sees what the normal sees in the mirrored map
        forms = [texels.flip(flips) if flips else texels for flips in ([], [1], [0], [0, 1])]
        self._flux = torch.cat([form.reshape(-1, 3) for form in forms], dim=1)  # [T 2T, 12]

    def shown(self, kernel: Tensor) -> Tensor:
        """Return what normals of the whole grid show by a matrix of this file.  [G, G, 3]."""
        side = (GRID + 1) // 2
        return _mirrored((kernel @ self._flux).view(side, side, 4, 3).permute(2, 0, 1, 3))


def ball(
    seen: CameraMap,
    roughness: float | None,
    f0: tuple[float, float, float],
    base: tuple[float, float, float],
) -> np.ndarray:
    """Return what a ball shows at the normals of the grid.

    Args:
        seen: The map.
        roughness: Perceptual, ROUGHNESS_MIN or more; None for a Lambertian ball.
        f0: Reflectance of the layer along the normal.
        base: Diffuse reflectance under it.

    Returns:
        Radiance, float32; rows go down the picture.  [G, G, 3]
    """
    result = torch.zeros(GRID, GRID, 3)
    through = torch.ones(GRID, GRID, 3)
    if roughness is not None:
        matrices, reflectance = layer(roughness), torch.tensor(f0)
        result = seen.shown(matrices.plain) * reflectance + seen.shown(matrices.grazing)
        parts = albedo(roughness)
        through = 1 - (parts[..., :1] * reflectance + parts[..., 1:])
    if any(base):
        result = result + through * torch.tensor(base) * seen.shown(cosines())
    return result.numpy()


def _mirrored(quarters: Tensor) -> Tensor:
    """Put a grid together: right and up, left and up, right and down, left and down.

    Args:
        quarters: Each from the middle outwards.  [4, Q, Q, C]

    Returns:
        Rows go down the picture.  [G, G, C]
    """
    right_up, left_up, right_down, left_down = quarters
    upper = torch.cat([left_up.flip(1)[:, :-1], right_up], dim=1)
    lower = torch.cat([left_down.flip(1)[:, :-1], right_down], dim=1)
    return torch.cat([upper.flip(0)[:-1], lower], dim=0).contiguous()


@functools.lru_cache(maxsize=2)
def _dealing(rotation: bytes, rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """Return to which four texels each of a map is dealt out, and in which parts.  [4, texels]."""
    camera_from_world = torch.from_numpy(np.frombuffer(rotation).reshape(3, 3).copy()).float()
    directions = latlong.directions(rows, columns).flatten(0, 1) @ camera_from_world.mT
    u, v = latlong.uv_from_direction(directions)
    x = u * 2 * TEXEL_ROWS - 0.5
    y = (v * TEXEL_ROWS - 0.5).clamp(0, TEXEL_ROWS - 1)
    left, top = x.floor(), y.floor().clamp(max=TEXEL_ROWS - 2)
    right_part, lower_part = x - left, y - top
    places, weights = [], []
    for down in (0, 1):
        for right in (0, 1):
            column = (left + right).long() % (2 * TEXEL_ROWS)
            places.append((top.long() + down) * 2 * TEXEL_ROWS + column)
            across = right_part if right else 1 - right_part
            weights.append(across * (lower_part if down else 1 - lower_part))
    return torch.stack(places), torch.stack(weights)
