# SPDX-License-Identifier: Apache-2.0
"""The look of the ground: bare, level soil whose albedo varies in patches."""

import torch
from torch import Tensor

from asglight.sky.noise import fractal

CONTRAST = 0.45
"""Share of the mean albedo by which patches differ from it at most."""

_PATCH = 1.5
"""Size of the largest patch in eye heights."""


def pattern(directions: Tensor, seed: int) -> Tensor:
    """Return the factor on the mean albedo along each direction; 1 at and above the horizon.

    Patches shrink with distance, faster than texels do, so their contrast is faded out with the
    sine of the depression: no detail is left where texels could not hold it.

    Args:
        directions: Unit directions, float64.  [..., 3]
        seed: Seed of the pattern.

    Returns:
        0.55 to 1.45, about 1 on average.  [...]
    """
    down = (-directions[..., 1]).clamp(min=0)
    far = down < 0.02  # faded below 0.1 % of the contrast there
    plane = directions[..., (0, 2)] / torch.where(far, 1.0, down)[..., None] / _PATCH
    level = torch.zeros_like(down)[..., None]
    noise = fractal(torch.cat([plane, level], dim=-1), seed, octaves=4)
    contrast = torch.where(far, 0.0, CONTRAST * down * (2 - down))
    return 1 + contrast * noise.clamp(-1, 1)
