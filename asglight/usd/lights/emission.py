# SPDX-License-Identifier: Apache-2.0
"""RGB light as UsdLux says it: a scalar intensity times a colour whose largest component is 1.

Engines that keep a light's colour in 8 bits lose nothing of the magnitude this way.
"""

import torch
from torch import Tensor

from asglight.lobes.motion import light_of


def intensity_and_color(light: Tensor) -> tuple[Tensor, Tensor]:
    """Split RGB radiance or irradiance; black gives intensity 0 and white.

    Args:
        light: Linear RGB, >= 0.  [..., 3]

    Returns:
        The largest component [...], and the colour [..., 3].
    """
    intensity = light.amax(-1)
    lit = intensity > 0
    divisor = torch.where(lit, intensity, 1.0)[..., None]
    return intensity, torch.where(lit[..., None], light / divisor, 1.0)


def tinted(intensity: Tensor, color: Tensor) -> Tensor:
    """Return colours in which black samples have that of the light that comes or goes there.

    A program interpolates intensity and colour each by itself: a light that came up from a white
    black would be pale between.

    Args:
        intensity: Over time.  [T, ...]
        color: As `intensity_and_color` gives it.  [T, ..., 3]
    """
    source = light_of(intensity <= 0)[..., None].expand_as(color)
    return color.gather(0, source)
