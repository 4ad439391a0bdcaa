# SPDX-License-Identifier: Apache-2.0
"""What balls show of lights, integrated in float64.

A light is a latlong map and a list of directions with a flux each. The map holds what is broad: its
radiance is constant within a texel, of 0.7 degrees, and the reflectance is taken at the centre. The
list holds what is narrow, at nodes of its own: on the grid it would move by up to half a texel,
which a ball of roughness 0.25 shows as 3 %. Right to 0.1 % (tests/dcc/test_dcc_quadrature.py).

Symbols: K lights, P normals, T texels or nodes.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.shading import ggx
from asglight.sphere import latlong

ROWS = 256
"""Of the maps, which all are brought to one size so that the reflectance is computed once."""

_CHUNK_ELEMENTS = 2**20
"""Reflectances made at a time: 8 MiB in float64."""

Visibility = Callable[[Tensor, Tensor, float], Tensor]
"""Maps n.v, n.l and alpha to `V = G2 / (4 n.v n.l)`."""


def separable_visibility(cos_view: Tensor, cos_light: Tensor, alpha: float) -> Tensor:
    """Return V with `G2 = G1 G1`, as Mitsuba has it (Walter et al. 2007); ours is correlated."""
    alpha2 = alpha * alpha
    view_root = (alpha2 + (1 - alpha2) * cos_view * cos_view).sqrt()
    light_root = (alpha2 + (1 - alpha2) * cos_light * cos_light).sqrt()
    return 1 / ((cos_view + view_root) * (cos_light + light_root))


@dataclass(frozen=True)
class Light:
    """What comes from all directions.

    Attributes:
        radiance: Of what is broad, texel means, float64.  [256, 512, 3]
        directions: Nodes of what is narrow, unit, float64.  [T, 3]
        flux: Radiance times solid angle of the nodes.  [T, 3]
    """

    radiance: Tensor
    directions: Tensor
    flux: Tensor


def broad(radiance: Tensor) -> Light:
    """Return a map as a light without narrow parts."""
    nothing = torch.zeros(0, 3, dtype=torch.float64)
    return Light(radiance.double(), nothing, nothing)


def shown(
    lights: Sequence[Light],
    normals: Tensor,
    view: Tensor,
    roughness: float | None,
    visibility: Visibility = ggx.visibility,
) -> Tensor:
    """Integrate lights against a white ball's reflectance at some normals.

    Args:
        lights: K lights, which share the reflectance of the map's texels.
        normals: Unit, float64, n.v > 0.  [P, 3]
        view: Unit, float64.  [3]
        roughness: Of a GGX ball of Fresnel reflectance 1; None for a Lambertian one.
        visibility: Shadowing and masking of the GGX ball.

    Returns:
        Radiance, float64.  [K, P, 3]
    """

    def integral(directions: Tensor, flux: Tensor) -> Tensor:
        step = max(1, _CHUNK_ELEMENTS // max(1, len(directions)))
        parts = normals.split(step)
        return torch.cat(
            [_reflected(n, directions, view, roughness, visibility) @ flux for n in parts]
        )

    texels = latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64).view(-1, 3)
    weights = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)[..., None]
    maps = torch.stack([light.radiance * weights for light in lights], dim=2)  # [H, W, K, 3]
    result = integral(texels, maps.view(len(texels), -1)).unflatten(-1, (len(lights), 3))
    nodes = [integral(light.directions, light.flux) for light in lights]
    return result.transpose(0, 1) + torch.stack(nodes)


def at_rows(radiance: Tensor) -> Tensor:
    """Bring a map to 256 rows with its flux kept; smaller ones repeat their texels.

    Args:
        radiance: Rows divide 256, or are a multiple of it.  [H, W, 3]
    """
    times = ROWS // len(radiance)
    if times > 1:
        return radiance.repeat_interleave(times, 0).repeat_interleave(times, 1)
    return latlong.reduce(radiance, ROWS, 2 * ROWS)


def _reflected(
    normals: Tensor,
    lights: Tensor,
    view: Tensor,
    roughness: float | None,
    visibility: Visibility,
) -> Tensor:
    """Return reflectance times n.l: 1/pi, or D V.  [P, T]."""
    cosine = normals @ lights.mT
    if roughness is None:
        return cosine.clamp(min=0) / math.pi
    alpha = roughness**2
    cos_view = (normals @ view)[:, None]
    # |v + l|^2 = 2 + 2 v.l; straight behind the ball there is no half vector, and no light either
    cos_half = (cosine + cos_view) / (2 + 2 * lights @ view).clamp(min=1e-9).sqrt()
    sin2_half = (1 - cos_half.square()).clamp(min=0)
    cosine = cosine.clamp(min=0)
    return ggx.distribution(sin2_half, alpha) * visibility(cos_view, cosine, alpha) * cosine
