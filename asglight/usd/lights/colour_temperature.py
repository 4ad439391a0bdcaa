# SPDX-License-Identifier: Apache-2.0
"""Colours of black bodies as UsdLux defines them, and the temperature that a colour is nearest to.

A colour is a black body's times (1, 2^tint, 1), up to its luminance: temperature and tint say it as
cameras do, from magenta (tint below 0) to green.
"""

import functools
import math
import operator

import numpy as np
from pxr import UsdLux

from asglight.luminance import LUMINANCE

KELVIN_LIMITS = (1700.0, 10000.0)
"""Between which the curve of UsdLux names each temperature by one colour: below, its spline waves,
and above it holds its end."""

STEPS = 831
"""Of the table, 10 K each: finer than any meter."""


def rgb_of(kelvin: float, tint: float = 0.0) -> tuple[float, float, float]:
    """Return the linear Rec. 709 colour of a temperature and a tint, its luminance 1.

    Args:
        kelvin: Held within KELVIN_LIMITS.
        tint: Stops of green.
    """
    red, green, blue = UsdLux.BlackbodyTemperatureAsRgb(_held(kelvin))
    green *= 2.0**tint
    luminance = sum(map(operator.mul, LUMINANCE, (red, green, blue)))
    return red / luminance, green / luminance, blue / luminance


def temperature_of(rgb: tuple[float, float, float]) -> tuple[float, float]:
    """Return the temperature in kelvin and the tint in stops that give a colour.

    Red over blue falls as the temperature grows, so it names one; green then gives the tint. A
    colour that is redder or bluer than any black body gets the nearest end.

    Args:
        rgb: Linear Rec. 709; each above 0.
    """
    ratios, kelvins = _table()
    red, green, blue = (max(value, 1e-12) for value in rgb)  # a pure colour gets an end
    kelvin = float(np.interp(-math.log(red / blue), -ratios, kelvins))
    body_red, body_green, body_blue = rgb_of(kelvin)
    # as much red and blue together as the body has: their geometric mean
    scale = math.sqrt((red * blue) / (body_red * body_blue))
    return kelvin, math.log2(green / (scale * body_green))


def _held(kelvin: float) -> float:
    return min(max(kelvin, KELVIN_LIMITS[0]), KELVIN_LIMITS[1])


@functools.cache
def _table() -> tuple[np.ndarray, np.ndarray]:
    """Return the logarithm of red over blue, falling, and the temperatures."""
    kelvins = np.linspace(*KELVIN_LIMITS, STEPS)
    colours = [UsdLux.BlackbodyTemperatureAsRgb(float(kelvin)) for kelvin in kelvins]
    return np.array([math.log(red / blue) for red, _, blue in colours]), kelvins
