# SPDX-License-Identifier: Apache-2.0
"""Keys and rest in the comparison."""

import pytest
import torch
from key_cases import Rectangle, with_lamps

from asglight.judging import keyed
from asglight.judging.compare import methods
from asglight.judging.compare.maps import size_of
from asglight.judging.compare.methods import COMPARED, METHODS, Task
from asglight.judging.metrics import map_errors
from asglight.keys.rectangles import Card
from asglight.sphere import latlong

ROWS = 64
LAMP = Rectangle(175, 30, 20, 16, 9)


@pytest.mark.parametrize("name", sorted(COMPARED.keys() - METHODS.keys()))
def test_keys_and_rest_are_the_map_and_say_how_large_they_are(name: str) -> None:
    radiance = with_lamps(ROWS, LAMP, rays=4)
    found = methods.run(COMPARED[name], Task(radiance, 120, 0, lambda: None))
    errors = map_errors(found.texel_means(ROWS, 2 * ROWS), radiance).values
    assert errors["flux"] < 1e-4
    assert errors["irr"] < 0.003
    assert errors["r0.25"] < 0.02
    assert errors["env"] < (0.03 if "texture" in name else 0.1)
    assert found.floats > ROWS * 2 * ROWS * 3  # no budget holds an image
    assert size_of(found) > 1000


def test_an_even_key_shows_its_flux_in_the_texels_that_its_card_covers() -> None:
    card = Card.facing(LAMP.axes, LAMP.extent).rectangle
    flux = torch.tensor([1.0, 2.0, 0.5]).double()
    image = keyed.gathered(card, flux, None, ROWS, 2 * ROWS)
    solid = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)[..., None]
    torch.testing.assert_close((image.double() * solid).sum((0, 1)), flux, rtol=1e-5, atol=0)
    lamp = with_lamps(ROWS, LAMP) - with_lamps(ROWS)
    shape = lamp / lamp.amax((0, 1)) - image / image.amax((0, 1))
    assert float(shape.abs().max()) < 0.1


def test_a_method_without_an_image_takes_four_bytes_a_number() -> None:
    radiance = with_lamps(16, Rectangle(0, 0, 0, 40, 40), rays=2)
    found = methods.run(METHODS["median-cut"], Task(radiance, 30, 0, lambda: None))
    assert size_of(found) == 4 * found.floats
