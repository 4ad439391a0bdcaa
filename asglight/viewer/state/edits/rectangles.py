# SPDX-License-Identifier: Apache-2.0
"""A key in an artist's terms: the rectangle that it is, its angles and its radiance.

A key is stored as the lobe of its card's flux and second moments (`asglight.keys.lobes`); that lobe
is half a stop to a stop brighter at its peak than the card, and two thirds as wide.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.viewer.uniforms.key_cards import standing

STEPS = 100
"""Of the fixed point from mean squares to sharpness, at most; cards of 20 degrees take five."""

CONVERGED = 1e-9
"""Relative, of the sharpness: a thousandth of what a stage's float32 holds."""


def half_angles(key: Lobes) -> Tensor:
    """Return half width and half height of a key's card, as if it faced one; radians.  [2]."""
    return standing(key[None]).half[0].atan()


def gain(key: Lobes) -> float:
    """Return the radiance of a key's card, in amplitudes of its lobe.  [.]."""
    zeroth = asg.moments(_double(key)[None]).zeroth
    return float(zeroth / standing(key[None]).solid_angle())


def with_half_angles(key: Lobes, angles: Tensor) -> Lobes:
    """Return a key whose card has another size and the same radiance.

    The mean x^2 over a card is (1 - R / (1 + p^2)) / 3, with `cards.ratio_of` for R.

    Args:
        key: [.]
        angles: Half width and half height, radians, below a quarter turn.  [2]
    """
    from asglight.usd.lights import cards  # pxr, which only keyed stages need

    slant = _double(key).slant
    growth = 1.0 if slant is None else slant[5:].exp()
    extent = angles.to(torch.float64).tan() / growth
    extent = extent.clamp(max=cards.WIDEST)
    wanted = (1 - cards.ratio_of(extent) / (1 + extent.square())) / 3
    found = _double(key)
    for _ in range(STEPS):
        now = cards.mean_squares(asg.moments(found[None]))[0]
        sharpness = (found.sharpness * now / wanted).clamp(asg.SHARPNESS_MIN, asg.SHARPNESS_MAX)
        done = bool(((sharpness - found.sharpness).abs() <= CONVERGED * sharpness).all())
        found = replace(found, sharpness=sharpness)
        if done:
            break
    return replace(found, amplitude=found.amplitude * (gain(key) / gain(found)))


def sized(key: Lobes, axis: int, half_angle: float) -> tuple[tuple[float, float], float]:
    """Return the powers of 2 by which sharpnesses and light grow for another width or height.

    Args:
        key: [.]
        axis: 0 for the width, 1 for the height.
        half_angle: Radians.

    Returns:
        Of the sharpness along x and y, and of the amplitude.
    """
    angles = half_angles(key)
    angles[axis] = half_angle
    changed = with_half_angles(key, angles)
    along_x, along_y = (changed.sharpness / _double(key).sharpness).log2().tolist()
    return (along_x, along_y), math.log2(gain(key) / gain(changed))


def _double(key: Lobes) -> Lobes:
    return key.to("cpu", torch.float64)
