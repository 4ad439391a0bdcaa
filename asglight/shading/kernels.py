# SPDX-License-Identifier: Apache-2.0
"""Reflection kernels that filter a radiance map: Lambert's cosine and the GGX lobe at N = V = R.

A kernel is a function of the cosine between the filter's direction and the light's. Filtering a
map with it gives what a ball of that material shows at the point whose normal is the direction:
the basis of every error that asglight reports, and of the loss that its fitter minimises.
"""

import math

import torch
from torch import Tensor

from asglight.sphere import latlong

LAMBERT = "lambert"

EVEN = "even"
"""The kernel 1 / (4 pi): what it shows is the mean radiance, the same in every direction."""

BLOCK = 2**17
"""Weights taken at once, half a megabyte: what is made of them stays in a processor's cache. With
4 million at once filtering takes 2.3 times as long."""


def lambert(cosine: Tensor) -> Tensor:
    """Return the clamped cosine over pi: filtering gives irradiance over pi."""
    return cosine.clamp(min=0) / math.pi


def ggx(cosine: Tensor, roughness: float) -> Tensor:
    """Return the GGX lobe seen along the normal, not normalised.

    With N = V = R the half vector's cosine squared is (1 + c) / 2 for the light's cosine c, and the
    distribution [Walter et al. 2007] times c is max(c, 0) / ((1 + c) / 2 (alpha^2 - 1) + 1)^2,
    with alpha = roughness^2. It is written by 1 - c to keep its digits at the peak.
    """
    alpha_squared = roughness**4
    below_peak = (1 - cosine) / 2  # sin^2 of the half vector's angle
    return cosine.clamp(min=0) / (alpha_squared + below_peak * (1 - alpha_squared)).square()


def ggx_integral(roughness: float) -> float:
    """Return the integral of `ggx` over the sphere.

    With a = alpha^2, b = 1 - a and u = a + b (1 - c) / 2 it is that of (1 - 2 (u - a) / b) / u^2,
    times 4 pi / b, from a to a + b / 2.
    """
    start = roughness**4
    slope = 1 - start
    if slope == 0:
        return math.pi
    end = start + slope / 2
    square = (1 + 2 * start / slope) * (1 / start - 1 / end)
    return 4 * math.pi / slope * (square - 2 / slope * math.log(end / start))


def filtered(
    maps: Tensor, kernel: str | float, directions: Tensor, *, normalised: bool | None = None
) -> Tensor:
    """Filter maps with a kernel around each direction, summing over every texel.

    Args:
        maps: Radiance maps.  [K, H, W, 3]
        kernel: `LAMBERT`, `EVEN`, or the roughness of a GGX lobe.
        directions: Where to filter.  [P, 3]
        normalised: Divide by the kernel's own sum over the texels. Default: GGX yes, Lambert no,
            whose result is irradiance over pi.

    Returns:
        Filtered radiance.  [K, P, 3]
    """
    count, height, width, _ = maps.shape
    texels = latlong.directions(height, width, dtype=maps.dtype, device=maps.device)
    texels = texels.reshape(-1, 3)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=maps.dtype, device=maps.device)
    solid_angle = solid_angle.reshape(-1)
    flat = maps.reshape(count, height * width, 3).permute(1, 0, 2).reshape(height * width, -1)
    divide = kernel != LAMBERT if normalised is None else normalised
    found = maps.new_zeros(len(directions), 3 * count, dtype=torch.float64)
    share = found.new_zeros(len(directions), 1)
    size = max(1, BLOCK // len(directions))
    parts = (part.split(size) for part in (texels, solid_angle, flat))
    for around, solid, radiance in zip(*parts, strict=True):
        weight = kernel_values(kernel, directions @ around.mT) * solid
        found += weight @ radiance
        share += weight.sum(-1, keepdim=True)
    mean = found / share if divide else found
    return mean.to(maps.dtype).reshape(-1, count, 3).permute(1, 0, 2)


def kernel_values(kernel: str | float, cosine: Tensor) -> Tensor:
    """Evaluate `LAMBERT`, `EVEN` or the GGX lobe of a roughness at cosines."""
    if kernel == EVEN:
        return torch.full_like(cosine, 1 / (4 * math.pi))
    return lambert(cosine) if isinstance(kernel, str) else ggx(cosine, kernel)
