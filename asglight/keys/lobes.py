# SPDX-License-Identifier: Apache-2.0
"""Keys as lobes: a card is stored as the lobe of its flux and its second moments, and its slant.

So everything that is known of lobes holds for keys: frames continuous in time, light between
frames, the lights of a stage, and what another program changed in them.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from asglight.keys.rectangles import Card, half_extent, seen_as
from asglight.keys.spots import Array
from asglight.lobes import Lobes, asg
from asglight.lobes.data import SLANT
from asglight.lobes.rectangles import slant_of

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


def as_lobes(found: Sequence[Sequence[Card]], flux: Array) -> Lobes:
    """Return the lobes of cards.

    Args:
        found: Cards of every frame.  F of K
        flux: Radiance times solid angle.  [F, K, 3]

    Returns:
        [F, K, .]
    """
    shape = len(found), len(found[0])
    every = [card for frame in found for card in frame]
    axes, wanted, extent = _facing(every)
    frames, squares = (torch.from_numpy(one) for one in (axes, wanted))
    sharpness = 1 / (2 * squares)
    ones = torch.ones(len(every), 3, dtype=torch.float64)
    for _ in range(STEPS):
        following = (sharpness * _squares(Lobes(frames, sharpness, ones)) / squares).clamp(
            *SHARPNESS
        )
        done = bool(((following - sharpness).abs() <= CONVERGED * sharpness).all())
        sharpness = following
        if done:
            break
    zeroth = asg.moments(Lobes(frames, sharpness, ones)).zeroth
    amplitude = torch.from_numpy(np.ascontiguousarray(flux)).reshape(-1, 3) / zeroth[..., None]
    lobes = Lobes(frames, sharpness, amplitude, slant=_slants(every, axes, extent))
    return lobes.each(lambda values: values.reshape(*shape, *values.shape[1:]))


def _facing(every: Sequence[Card]) -> tuple[Array, Array, Array]:
    """Return frames, mean squares and sizes of the cards that stand for others facing the origin.

    Of a card that faces the origin they are its own.  [P, 3, 3], [P, 2], [P, 2]
    """
    axes = np.stack([card.axes for card in every])
    extent = np.stack([card.extent for card in every])
    squares = card_squares(extent)
    for index, card in enumerate(every):
        if not card.is_facing:
            axes[index], squares[index] = seen_as(card)
            extent[index] = half_extent(squares[index])
    return axes, squares, extent


def _slants(every: Sequence[Card], axes: Array, extent: Array) -> Tensor:
    """Return how cards stand beside those that face the origin.  [P, 7]."""
    slant = torch.zeros(len(every), SLANT, dtype=torch.float64)
    for index, card in enumerate(every):
        if not card.is_facing:
            beside = torch.from_numpy(axes[index]), torch.from_numpy(extent[index])
            slant[index] = slant_of(card.rectangle, *beside)
    return slant


def _squares(lobes: Lobes) -> Tensor:
    moments = asg.moments(lobes)
    return moments.second[..., :2] / moments.zeroth[..., None]
