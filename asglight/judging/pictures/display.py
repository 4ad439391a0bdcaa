# SPDX-License-Identifier: Apache-2.0
"""From linear radiance to what a screen shows: one exposure, a shoulder for lights, sRGB."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.luminance import luminance
from asglight.shading.balls import coverage
from asglight.sphere import latlong

_MIDDLE_GREY = 0.18
_SHOULDER = 0.6
"""Display-linear level from which highlights are compressed; below it the picture is exact."""


def exposure_stops(references: Tensor) -> float:
    """Return the exposure that brings the median luminance over the sphere to middle grey.

    The median, weighted by solid angle, does not follow a sun that comes and goes.

    Args:
        references: Maps.  [K, H, W, 3]

    Returns:
        Stops; 0 for maps without light.
    """
    height, width = references.shape[1:3]
    level = luminance(references).flatten()
    weight = latlong.texel_solid_angles(height, width).flatten().repeat(len(references))
    order = level.argsort()
    cumulative = weight[order].cumsum(0)
    median = float(level[order][int(torch.searchsorted(cumulative, cumulative[-1] / 2))])
    if median <= 0:
        median = float((level * weight).sum() / weight.sum())
    return float(np.log2(_MIDDLE_GREY / median)) if median > 0 else 0.0


def ball_exposure_stops(balls: Tensor) -> float:
    """Return the stops that bring the median of the last ball, the roughest, to a light grey.

    It is a matte white ball, which a photographer puts a stop above middle grey.

    Args:
        balls: Rendered under references.  [K, R, S, S, 3]

    Returns:
        Stops; 0 for balls without light.
    """
    inside = coverage(balls.shape[2]) > 0.99
    level = float(luminance(balls[:, -1])[:, inside].median())
    return float(np.log2(2 * _MIDDLE_GREY / level)) if level > 0 else 0.0


def view_transform(radiance: Tensor, stops: float) -> NDArray[np.uint8]:
    """Return 8-bit sRGB of linear Rec.709.

    The brightest channel is compressed by a rational shoulder that starts at 0.6 with slope 1 and
    tends to 1. The others keep their ratio to it, and give way to white as it is compressed, which
    is what makes a light look bright rather than flat.

    Args:
        radiance: Linear.  [..., 3]
        stops: Exposure.

    Returns:
        sRGB, 0 to 255.  [..., 3]
    """
    exposed = radiance.double() * 2.0**stops
    peak = exposed.amax(-1, keepdim=True).clamp(min=1e-12)  # keeps black black, not 0 / 0
    room = 1 - _SHOULDER
    excess = (peak - _SHOULDER).clamp(min=0) / room
    compressed = torch.where(peak > _SHOULDER, _SHOULDER + room * excess / (1 + excess), peak)
    whiteness = 1 - 1 / (1 + 0.02 * excess)  # half white five stops above display white
    display = torch.lerp(exposed * compressed / peak, compressed.expand_as(exposed), whiteness)
    display = display.clamp(0, 1)
    low, high = 12.92 * display, 1.055 * display ** (1 / 2.4) - 0.055  # IEC 61966-2-1
    encoded = torch.where(display <= 0.0031308, low, high)
    return (encoded * 255).round().to(torch.uint8).numpy()
