# SPDX-License-Identifier: Apache-2.0
"""Three spheres, as papers that estimate light from photographs are judged by.

The protocol of StyleLight [Wang et al. 2022, ECCV] as DiffusionLight [Phongthawee et al. 2024,
CVPR] publishes it. A map is brought to 128 x 256, raised to 1 / 2.4 and scaled so that its median
(of the values that are not 0) is 0.5, without clipping, prediction and truth each for itself.
Under it stand, from far away,

    mirror    metal of reflectance 0.8, roughness 0
    silver    metal of reflectance 0.8, roughness 0.327
    diffuse   matte 0.8 under a dielectric layer of reflectance 0.04, roughness 0.364

The papers render with Blender's Cycles through a lens of 85 mm; here asglight's own renderer does
it, orthographic, so numbers compare among themselves and only roughly with theirs.

Symbols: K maps, S pixels across a ball.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.shading import ggx, kernels
from asglight.shading.balls import coverage, pixel_centres, render_balls
from asglight.sphere import latlong

SPHERES = ("mirror", "silver", "diffuse")

METAL, MATTE, DIELECTRIC = 0.8, 0.8, 0.04
"""Reflectance along the normal of the metals, of the matte base, of the layer over it."""

SILVER_ROUGHNESS, LAYER_ROUGHNESS = 0.327, 0.364

PROTOCOL_ROWS = 128
GAMMA, MEDIAN = 2.4, 0.5

MIRROR_POINTS = 8
"""Along an edge of a pixel: of 96 pixels the middle one mirrors 3.4 texels of 256 rows, more than
two points a texel."""

LAMBERT_ROWS = 128
"""Maps are averaged down to these for irradiance, which a texel of 1.4 degrees moves by 1e-4."""

_COSINE_MIN = 0.03
"""Of the view, for the layers' albedo: the outermost hundredth of a pixel."""


@dataclass(frozen=True)
class SphereErrors:
    """How far a ball is from the one under the reference.

    Attributes:
        rmse: Root of the squared difference, summed over RGB, meant over the ball's pixels.
        si_rmse: The same of the ball scaled as suits best.
        angular: Mean angle between RGB vectors, in degrees: an error of colour, not of place. Black
            where there should be light is 90; the published code, dividing 0 by 0, counts it as 0.
    """

    rmse: float
    si_rmse: float
    angular: float


def render(maps: Tensor, size: int) -> Tensor:
    """Render the three spheres under maps, seen along -Z.

    Fresnel's term is Schlick's; of the rough layers it is taken as its mean over the layer.

    Args:
        maps: Radiance, all of one size.  [K, H, W, 3]
        size: S.

    Returns:
        Reflected radiance times `coverage(size)`.  [K, 3, S, S, 3]
    """
    silver, layer = render_balls(maps, (SILVER_ROUGHNESS, LAYER_ROUGHNESS), size=size).unbind(1)
    centres = _pixel_normals(size)
    silver = silver * _tint(centres[:, 2], SILVER_ROUGHNESS, METAL).view(size, size, 1)
    layer = layer * _tint(centres[:, 2], LAYER_ROUGHNESS, DIELECTRIC).view(size, size, 1)
    return torch.stack([_mirror(maps, size), silver, _matt(maps, size, centres) + layer], dim=1)


def tone_mapped(radiance: Tensor) -> Tensor:
    """Return a map as the protocol lights its spheres with it.  [H, W, 3] -> [128, 256, 3].

    Negative values become 0; maps with fewer rows keep them.
    """
    rows = min(PROTOCOL_ROWS, radiance.shape[0])
    raised = latlong.reduce(radiance, rows, 2 * rows).clamp(min=0) ** (1 / GAMMA)
    lit = raised[raised > 0]
    return raised * (MEDIAN / lit.quantile(0.5)) if len(lit) else raised


def sphere_errors(ball: Tensor, reference: Tensor) -> SphereErrors:
    """Judge one ball against the one under the reference, both [S, S, 3]."""
    inside = coverage(len(ball)) > 0
    fit, wanted = ball[inside].double(), reference[inside].double()  # [P, 3]
    squares, product = float(fit.square().sum()), float((fit * wanted).sum())
    total = float(wanted.square().sum())
    # scaled by product / squares; rounding can take it below 0
    scaled = max(total - product**2 / squares, 0.0) if squares > 0 else total
    lengths = fit.norm(dim=-1) * wanted.norm(dim=-1)
    cosine = torch.where(lengths > 0, (fit * wanted).sum(-1) / lengths, 0.0)
    cosine[(fit == wanted).all(-1)] = 1.0  # also where both are black
    return SphereErrors(
        rmse=math.sqrt(float((fit - wanted).square().sum()) / len(fit)),
        si_rmse=math.sqrt(scaled / len(fit)),
        angular=math.degrees(float(cosine.clamp(0, 1).acos().mean())),
    )


def _tint(cosine: Tensor, roughness: float, reflectance: float) -> Tensor:
    """Return the albedo of a layer over that of one that reflects all.  [P]."""
    low, high = _albedo_parts(cosine, roughness).unbind(-1)
    return (reflectance * low + high) / (low + high)


def _albedo_parts(cosine: Tensor, roughness: float) -> Tensor:
    """Interpolate `ggx.albedo_parts` between 256 cosines, 3e-4 apart at most.  [P, 2]."""
    nodes = torch.linspace(_COSINE_MIN, 1, 256)
    parts = ggx.albedo_parts(nodes, roughness**2)
    place = (cosine.clamp(min=_COSINE_MIN) - _COSINE_MIN) / (1 - _COSINE_MIN) * 255
    below = place.long().clamp(max=254)
    return torch.lerp(parts[below], parts[below + 1], (place - below)[:, None])


def _mirror(maps: Tensor, size: int) -> Tensor:
    """Look up the mirror direction at points of each pixel.  [K, S, S, 3]."""
    normals = _pixel_normals(MIRROR_POINTS * size)
    inside = normals[:, :2].square().sum(-1) < 1
    cosine = normals[inside, 2:]
    mirrored = 2 * cosine * normals[inside] - torch.tensor([0.0, 0.0, 1.0])
    height, width = maps.shape[1:3]
    u, v = latlong.uv_from_direction(mirrored)
    row = (v * height).long().clamp(max=height - 1)
    column = (u * width).long().clamp(max=width - 1)
    result = maps.new_zeros(len(maps), len(normals), 3)
    fresnel = METAL + (1 - METAL) * (1 - cosine) ** 5
    result[:, inside] = maps[:, row, column] * fresnel
    blocks = result.view(len(maps), size, MIRROR_POINTS, size, MIRROR_POINTS, 3)
    return blocks.mean((2, 4))


def _matt(maps: Tensor, size: int, normals: Tensor) -> Tensor:
    """Return the base of the diffuse sphere, lit by what its layer lets through.  [K, S, S, 3]."""
    rows = min(LAMBERT_ROWS, maps.shape[1])
    coarse = torch.stack([latlong.reduce(m, rows, 2 * rows) for m in maps])
    share = coverage(size).flatten()
    lit = share > 0
    low, high = _albedo_parts(normals[lit, 2], LAYER_ROUGHNESS).unbind(-1)
    passed = MATTE * (1 - DIELECTRIC * low - high) * share[lit]
    result = maps.new_zeros(len(maps), size * size, 3)
    result[:, lit] = kernels.filtered(coarse, kernels.LAMBERT, normals[lit]) * passed[:, None]
    return result.view(len(maps), size, size, 3)


def _pixel_normals(size: int) -> Tensor:
    """Return the normal at the centre of every pixel, on the edge where it is off the ball.

    Off the ball x and y are kept, so that they still tell.  [S * S, 3]
    """
    x, y = pixel_centres(size).unbind(-1)
    z = (1 - x * x - y * y).clamp(min=0).sqrt()
    return torch.stack([x, y, z], dim=-1).view(-1, 3)
