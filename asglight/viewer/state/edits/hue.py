# SPDX-License-Identifier: Apache-2.0
"""Hue and saturation of a light's linear colour, as HSV has them.

[Smith 1978, "Color gamut transform pairs"]; the conversion is Python's own.
"""

import colorsys
from collections.abc import Sequence

from asglight.viewer.state.balls import Rgb

SATURATION_MAX = 0.999
"""A channel that is black stays black, whatever it is multiplied by; so no slider takes it away."""


def hue_of(colour: Sequence[float]) -> tuple[float, float]:
    """Return the hue of a linear colour in degrees, and its saturation from 0 to 1."""
    hue, saturation, _ = colorsys.rgb_to_hsv(*_scaled(colour))
    return 360 * hue, saturation


def with_hue(
    colour: Sequence[float], *, hue: float | None = None, saturation: float | None = None
) -> Rgb:
    """Return a linear colour with another hue or saturation; the largest channel is 1.

    Args:
        colour: Linear RGB, not black.
        hue: In degrees; None leaves it.
        saturation: From 0 to 1; None leaves it.
    """
    own_hue, own_saturation, _ = colorsys.rgb_to_hsv(*_scaled(colour))
    wanted_hue = own_hue if hue is None else hue / 360
    wanted_saturation = own_saturation if saturation is None else saturation
    return colorsys.hsv_to_rgb(wanted_hue, min(wanted_saturation, SATURATION_MAX), 1.0)


def _scaled(colour: Sequence[float]) -> Rgb:
    red, green, blue = colour
    peak = max(colour)
    return red / peak, green / peak, blue / peak
