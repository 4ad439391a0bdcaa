# SPDX-License-Identifier: Apache-2.0
"""Glossy to matte balls under a map by sums over texels: no samples, no noise.

Normals and lights are taken in polar coordinates about the view: the angle to it, and the azimuth.
What a normal shows of a light depends on both angles and on the difference of the azimuths, so that
the sum over lights is a convolution along the azimuth, a product of its Fourier coefficients
[convolution theorem]: for each of them a small matrix from angles of lights to angles of normals.
The matrices are the same for every map, view and turn. Where a highlight is narrow across, at the
rim, the lights that it mirrors lie near the pole behind the ball, where columns are narrow too.

Symbols: N angles of normals; C azimuths of normals; T angles of lights; M Fourier coefficients.
"""

import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.shading import ggx
from asglight.sphere import latlong

if TYPE_CHECKING:
    from scipy import sparse


class Grid(NamedTuple):
    """How finely a ball is known.

    Attributes:
        lights: T.
        normals: N, from the view to the rim, both included.
        columns: C.
    """

    lights: int
    normals: int
    columns: int


FINE = Grid(128, 97, 512)
"""Lights of 1.4 degrees, a quarter of the half width of a highlight at a roughness of 0.25; normals
of 0.9 degrees, between which a highlight's peak is straight to 1.5 %."""

COARSE = Grid(64, 49, 256)
"""For four times as wide highlights, and matte balls."""

COARSE_ROUGHNESS = 0.5
"""From which the coarse grid shows as much as the fine one."""

ROUGHNESS_MIN = 0.25
"""Sharper balls would need finer grids: the work grows as 1 / roughness^6."""

AZIMUTHS = 2 * FINE.lights
"""Columns of lights."""

SOURCE_ROWS = 256
"""Rows of the map whose texels are dealt out to those about the view: twice as fine as these, so
that an even map is dealt out evenly."""

_COS_VIEW_MIN = 1e-3
"""Stands for n.v = 0 on the rim, where V is 0 / 0."""


class Layer(NamedTuple):
    """What normals show of the flux of lights.

    Attributes:
        plain: The part A of `f0 A + B`.  [M, N, T]
        grazing: The part B.  [M, N, T]
    """

    plain: Tensor
    grazing: Tensor


def grid(roughness: float | None) -> Grid:
    """Return the grid of a roughness; None is a Lambertian ball."""
    return COARSE if roughness is None or roughness >= COARSE_ROUGHNESS else FINE


def angles(size: Grid) -> Tensor:
    """Return the angles of normals to the view, radians, float64.  [N]."""
    return torch.linspace(0, 0.5 * math.pi, size.normals, dtype=torch.float64)


@functools.lru_cache(maxsize=4)
def layer(roughness: float) -> Layer:
    """Return the matrices of a GGX layer; an even map shows its exact directional albedo.

    Args:
        roughness: Perceptual, ROUGHNESS_MIN or more.
    """
    alpha, size = roughness**2, grid(roughness)
    cos_view, half2, cos_light = _cosines_of(size)
    sin2_half = (1 - (cos_view + cos_light).square() / half2).clamp(min=0)
    kernel = ggx.distribution(sin2_half, alpha)
    kernel *= ggx.visibility(cos_view, cos_light, alpha) * cos_light
    grazing = (1 - 0.5 * half2.sqrt()).clamp(0, 1) ** 5  # v.h is half of |v + l|
    exact = albedo(roughness)
    return Layer(
        _coefficients(kernel * (1 - grazing), exact[:, 0], size),
        _coefficients(kernel * grazing, exact[:, 1], size),
    )


@functools.lru_cache(maxsize=2)
def cosines(size: Grid) -> Tensor:
    """Return the matrices of irradiance over pi; an even map shows its radiance.  [M, N, T]."""
    *_, cos_light = _cosines_of(size)
    return _coefficients(cos_light, torch.ones(size.normals), size)


@functools.lru_cache(maxsize=8)
def albedo(roughness: float) -> Tensor:
    """Return the directional albedo at the angles of normals in its two parts.  [N, 2]."""
    cos_view = torch.cos(angles(grid(roughness))).clamp(min=_COS_VIEW_MIN)
    return ggx.albedo_parts(cos_view, roughness**2).float()


class CameraMap:
    """A latlong map as the Fourier coefficients of its flux about the view of a camera."""

    def __init__(self, radiance: np.ndarray, camera_from_world: np.ndarray) -> None:
        """Deal the light of a map's texels out to those about the view.

        Args:
            radiance: Finite and not negative, float32.  [H, W, 3]
            camera_from_world: A rotation.  [3, 3]
        """
        image = torch.from_numpy(np.ascontiguousarray(radiance))
        rows = SOURCE_ROWS
        # a map of fewer texels than there are places to deal them out to is even within them
        finer = max(1, math.ceil(rows / min(image.shape[0], image.shape[1] / 2)))
        image = image.repeat_interleave(finer, 0).repeat_interleave(finer, 1)
        image = latlong.reduce(image, rows, 2 * rows)
        flux = (image * latlong.texel_solid_angles(rows, 2 * rows)[..., None]).reshape(-1, 3)
        dealt = _dealing(camera_from_world.astype(np.float64).tobytes(), rows) @ flux.numpy()
        lights = torch.from_numpy(dealt).view(FINE.lights, AZIMUTHS, 3)
        found = torch.fft.rfft(lights, dim=1).permute(1, 0, 2)  # [M, T, 3]
        fine = torch.cat([found.real, found.imag], dim=-1).contiguous()
        merged = fine[: COARSE.lights + 1].unflatten(1, (COARSE.lights, -1)).sum(2)
        self._coefficients = {FINE: fine, COARSE: merged}  # [M, T, 6]

    def shown(self, kernel: Tensor, size: Grid) -> Tensor:
        """Return what normals show by matrices of this file.  [N, C, 3]."""
        parts = torch.bmm(kernel, self._coefficients[size])  # [M, N, 6]
        found = torch.complex(parts[..., :3].contiguous(), parts[..., 3:].contiguous())
        shown = torch.fft.irfft(found, n=size.columns, dim=0).permute(1, 0, 2)
        # beside a sun black is not quite 0: float32 rounds the coefficients
        return (shown * (size.columns / AZIMUTHS)).clamp(min=0)


def ball(
    seen: CameraMap,
    roughness: float | None,
    f0: tuple[float, float, float],
    base: tuple[float, float, float],
) -> np.ndarray:
    """Return what a ball shows at the normals of its grid.

    Args:
        seen: The map.
        roughness: Perceptual, ROUGHNESS_MIN or more; None for a Lambertian ball.
        f0: Reflectance of the layer along the normal.
        base: Diffuse reflectance under it.

    Returns:
        Radiance, float32; rows from the view to the rim, columns from the right of the picture
        over its top.  [N, C, 3]
    """
    size = grid(roughness)
    result = torch.zeros(size.normals, size.columns, 3)
    through = torch.ones(size.normals, 1, 3)
    if roughness is not None:
        matrices, reflectance = layer(roughness), torch.tensor(f0)
        result = seen.shown(matrices.plain, size) * reflectance
        result += seen.shown(matrices.grazing, size)
        parts = albedo(roughness)[:, None]
        through = 1 - (parts[..., :1] * reflectance + parts[..., 1:])
    if any(base):
        result = result + through * torch.tensor(base) * seen.shown(cosines(size), size)
    return result.numpy()


def _cosines_of(size: Grid) -> tuple[Tensor, Tensor, Tensor]:
    """Return n.v, |v + l|^2 and n.l, of azimuths from 0 to half a turn.

    [N, 1, 1], [T, 1], [N, T, M].
    """
    normal = angles(size)[:, None, None]
    light = (torch.arange(size.lights, dtype=torch.float64)[:, None] + 0.5) * math.pi / size.lights
    turn = torch.arange(AZIMUTHS // 2 + 1, dtype=torch.float64) * 2 * math.pi / AZIMUTHS
    cos_light = torch.sin(normal) * torch.sin(light) * torch.cos(turn)
    cos_light = (cos_light + torch.cos(normal) * torch.cos(light)).clamp(min=0)
    half2 = (2 + 2 * torch.cos(light)).clamp(min=1e-6)  # straight behind there is no light
    return torch.cos(normal).clamp(min=_COS_VIEW_MIN).float(), half2.float(), cos_light.float()


def _coefficients(kernel: Tensor, of_even: Tensor, size: Grid) -> Tensor:
    """Return the Fourier coefficients of a kernel over azimuths, which are real: it is even.

    Args:
        kernel: At azimuths from 0 to half a turn.  [N, T, AZIMUTHS / 2 + 1]
        of_even: What an even map of radiance 1 is to show.  [N]
        size: The grid.

    Returns:
        [M, N, T], as many as the lights have to half a turn
    """
    whole = torch.cat([kernel, kernel[..., 1:-1].flip(-1)], dim=-1)
    found = torch.fft.rfft(whole, dim=-1).real
    edges = torch.linspace(0, math.pi, size.lights + 1, dtype=torch.float64)
    areas = -torch.diff(torch.cos(edges)) * 2 * math.pi / AZIMUTHS
    even = (found[..., 0].double() * areas).sum(1).clamp(min=1e-12)
    found = found * (of_even / even)[:, None, None].float()
    return found[..., : size.lights + 1].permute(2, 0, 1).contiguous()


@functools.lru_cache(maxsize=2)
def _dealing(rotation: bytes, rows: int) -> "sparse.csc_array":
    """Return the matrix that deals each texel of a map out to four about the view, linearly."""
    from scipy import sparse  # a window without a reference opens sooner

    camera_from_world = torch.from_numpy(np.frombuffer(rotation).reshape(3, 3).copy()).float()
    seen = latlong.directions(rows, 2 * rows).flatten(0, 1) @ camera_from_world.mT
    azimuth = torch.atan2(seen[:, 1], seen[:, 0])
    angle = torch.atan2(torch.hypot(seen[:, 0], seen[:, 1]), seen[:, 2])
    x = azimuth * (AZIMUTHS / (2 * math.pi))
    y = (angle * (FINE.lights / math.pi) - 0.5).clamp(0, FINE.lights - 1)
    left, top = x.floor(), y.floor().clamp(max=FINE.lights - 2)
    right_part, lower_part = x - left, y - top
    places, weights = [], []
    for down in (0, 1):
        for right in (0, 1):
            places.append((top.int() + down) * AZIMUTHS + (left.int() + right) % AZIMUTHS)
            across = right_part if right else 1 - right_part
            weights.append(across * (lower_part if down else 1 - lower_part))
    texels = len(seen)
    parts = torch.stack(weights, dim=1).flatten().numpy(), torch.stack(places, 1).flatten().numpy()
    starts = np.arange(0, 4 * texels + 1, 4, dtype=np.int32)
    return sparse.csc_array((*parts, starts), shape=(FINE.lights * AZIMUTHS, texels))
