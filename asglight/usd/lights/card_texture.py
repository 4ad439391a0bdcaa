# SPDX-License-Identifier: Apache-2.0
"""The texture of cards: one Gaussian for all of a stage, and what a card with it sends.

A narrow lobe is a Gaussian on the plane of its card, so a single image does for all of them; sizes
stretch it. It is alike in x and y and under reflections, so it does not matter in which order a
renderer runs through its texels. Its mean is 1: a renderer that leaves it out shows a card of the
same radiance times area.

On the card, u = x / p and v = y / q run from -1 to 1 and the image is, up to its scale,
exp(-(u^2 + v^2) / (2 s^2)) with s = 1 / REACH. Light from the plane z = 1 of the lobe's frame comes
with dw = dx dy / (1 + x^2 + y^2)^(3/2), for which there is no closed form: Gauss and Legendre's
rule in the angles of the plane.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.images import write_exr

REACH = 3.0
"""Standard deviations from the middle of a card to its sides, where the Gaussian is 1 % and 0.5 %
of its light ends. With 2.5 a lobe of 9 degrees is 1.9 % off on a ball of roughness 0.25, with 3
0.9 %; with more, cards without the texture are the wider."""

TEXELS = 64
"""Of the image, each way: a tenth of a standard deviation."""

NODES = 12
"""Of the rule, from the middle of a card to a side: off by 1e-9 of the integral up to half angles
of 70 degrees, by 1e-6 at the widest, 85."""

STEPS = 60
"""At most, of the fixed point from mean squares to sizes; a narrow card takes three."""

CONVERGED = 1e-9
"""Relative, of the sizes: a sixtieth of a float32 rounding."""


class Measured(NamedTuple):
    """What a card with the texture sends, at radiance 1.

    Attributes:
        solid_angle: Integral of the texture over the directions of the card, in steradians.  [...]
        mean_squares: Mean x^2 and y^2 of the light.  [..., 2]
    """

    solid_angle: Tensor
    mean_squares: Tensor


def gaussian() -> Tensor:
    """Return one side of the image over the card: its texels, of mean 1.  [TEXELS] float64.

    A texel is the mean of the Gaussian over it. Interpolating between texel centres spreads them by
    a quarter of a squared texel more, which a narrower Gaussian makes up for.
    """
    edges = np.linspace(-1, 1, TEXELS + 1)
    spread = math.sqrt(1 / REACH**2 - (2 / TEXELS) ** 2 / 4)
    below = torch.special.erf(torch.from_numpy(edges) / (spread * math.sqrt(2)))
    texels = below.diff()
    return texels / texels.mean()


def write_texture(path: Path) -> None:
    """Write the image, in half floats: 64 x 64 texels, 9 kB.

    Raises:
        InputError: It cannot be written.
    """
    side = gaussian()
    image = (side[:, None] * side)[..., None].expand(-1, -1, 3)
    write_exr(path, image.float(), latlong=False)


def measured(half_extent: Tensor) -> Measured:
    """Integrate the texture over cards in the plane z = 1.

    Args:
        half_extent: (p, q), the tangents of the half angles, float64.  [..., 2]
    """
    nodes, weights = (torch.from_numpy(part) for part in np.polynomial.legendre.leggauss(NODES))
    nodes, weights = (nodes + 1) / 2, weights / 2  # from 0 to 1: the four quarters are alike
    angle = half_extent.atan()[..., None]  # [..., 2, 1]
    at = (angle * nodes).tan()  # [..., 2, NODES]
    over = at / half_extent[..., None]
    weight = angle * weights * (1 + at * at) * (-(REACH**2) / 2 * over * over).exp()
    squares = at * at
    nearer = 1 / (1 + squares[..., 0, :, None] + squares[..., 1, None, :])  # z^2
    light = nearer * nearer.sqrt() * weight[..., 0, :, None] * weight[..., 1, None, :]
    along = light * nearer
    whole = light.sum((-1, -2))
    second = [
        (along * squares[..., 0, :, None]).sum((-1, -2)),
        (along * squares[..., 1, None, :]).sum((-1, -2)),
    ]
    return Measured(4 * whole / _MEAN, torch.stack(second, dim=-1) / whole[..., None])


_MEAN = (math.sqrt(math.pi / 2) / REACH * math.erf(REACH / math.sqrt(2))) ** 2
"""Of the Gaussian over the card, by which the image is divided."""


def half_extent(mean_squares: Tensor, widest: float) -> Tensor:
    """Return (p, q) of the cards whose light has these mean x^2 and y^2, or of the widest.

    Args:
        mean_squares: Of unit directions, float64.  [..., 2]
        widest: Largest p and q.

    Returns:
        Half width and half height at distance 1.  [..., 2]
    """
    extent = (REACH * mean_squares.sqrt()).clamp(max=widest)
    for _ in range(STEPS):
        ratio = (mean_squares / measured(extent).mean_squares).sqrt()
        following = (extent * ratio).clamp(max=widest)
        done = bool(((following - extent).abs() <= CONVERGED * extent).all())
        extent = following
        if done:
            break
    return extent
