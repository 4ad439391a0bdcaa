# SPDX-License-Identifier: Apache-2.0
"""Keys as lobes: the card that a stage makes of one is the card that it was made of."""

import numpy as np
import pytest
import torch
from key_cases import Rectangle

from asglight.keys.lobes import as_lobes, card_squares
from asglight.keys.rectangles import Card
from asglight.lobes import asg
from asglight.usd.lights import cards

LAMPS = (
    Rectangle(0, 0, 0, 0.5, 0.5),
    Rectangle(50, 80, 30, 20, 2),
    Rectangle(180, -20, 70, 90, 50),
    Rectangle(10, 5, 0, 0.1, 30),
)


def test_a_card_comes_back_with_its_size_and_flux() -> None:
    extent = np.stack([lamp.extent for lamp in LAMPS])
    flux = np.array([[1.0, 2.0, 3.0], [0.5, 0.0, 0.1], [9.0, 8.0, 7.0], [0.0, 0.0, 0.0]])
    lobes = as_lobes([[Card.facing(lamp.axes, lamp.extent) for lamp in LAMPS]], flux[None])[0]
    assert lobes.slant is not None
    assert not lobes.slant.any()
    found = cards.half_extent(cards.mean_squares(asg.moments(lobes)))
    np.testing.assert_allclose(found.numpy(), extent, rtol=1e-4)
    torch.testing.assert_close(asg.flux(lobes), torch.from_numpy(flux), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("extent", [(0.3, 0.7), (1.2, 0.05)])
def test_mean_squares_are_the_closed_form(extent: tuple[float, float]) -> None:
    p, q = extent
    s = p * q / np.sqrt(1 + p * p + q * q)
    closed = [(1 - s / ((1 + e * e) * np.arctan(s))) / 3 for e in extent]
    np.testing.assert_allclose(card_squares(np.array(extent)), closed, rtol=1e-9)
