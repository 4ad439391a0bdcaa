# SPDX-License-Identifier: Apache-2.0
"""Keys as lobes: a card is stored as the lobe of its flux and its second moments.

So everything that is known of lobes holds for keys: frames continuous in time, light between
frames, the lights of a stage, and what another program changed in them.
"""

import numpy as np
import torch
from torch import Tensor

from asglight.keys.spots import Array
from asglight.lobes import Lobes, asg

STEPS = 200
"""Of the fixed point from mean squares to sharpness, at most; narrow cards take two."""

CONVERGED = 1e-12
"""Relative, of the sharpness."""

SHARPNESS = (0.05, 5e7)
"""Within the limits of a stage's lobes; a card of a hundredth of a degree has the most."""


def card_squares(extent: Array) -> Array:
    """Return the mean x^2 and y^2 of unit directions over cards.

    The closed form of `asglight.usd.lights.cards` takes the difference of two numbers near 1, which
    loses the digits of a narrow card: Gauss and Legendre's rule has them.

    Args:
        extent: Tangents of the half angles (p, q).  [..., 2]

    Returns:
        [..., 2]
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    x = extent[..., 0, None, None] * nodes[:, None]
    y = extent[..., 1, None, None] * nodes[None, :]
    square = 1 + x * x + y * y
    light = square**-1.5 * weights[:, None] * weights[None, :]
    whole = light.sum((-2, -1))
    found = [(light * one / square).sum((-2, -1)) / whole for one in (x * x, y * y)]
    return np.stack(found, axis=-1)


def as_lobes(axes: Array, extent: Array, flux: Array) -> Lobes:
    """Return the lobes of cards.

    Args:
        axes: Rows x, y, z of their frames.  [..., K, 3, 3]
        extent: Tangents of their half angles.  [..., K, 2]
        flux: Radiance times solid angle.  [..., K, 3]
    """
    wanted = torch.from_numpy(card_squares(extent))
    frames = torch.from_numpy(np.ascontiguousarray(axes))
    sharpness = 1 / (2 * wanted)
    ones = torch.ones(*extent.shape[:-1], 3, dtype=torch.float64)
    for _ in range(STEPS):
        following = (sharpness * _squares(Lobes(frames, sharpness, ones)) / wanted).clamp(
            *SHARPNESS
        )
        done = bool(((following - sharpness).abs() <= CONVERGED * sharpness).all())
        sharpness = following
        if done:
            break
    zeroth = asg.moments(Lobes(frames, sharpness, ones)).zeroth
    amplitude = torch.from_numpy(np.ascontiguousarray(flux)) / zeroth[..., None]
    return Lobes(frames, sharpness, amplitude)


def _squares(lobes: Lobes) -> Tensor:
    moments = asg.moments(lobes)
    return moments.second[..., :2] / moments.zeroth[..., None]
