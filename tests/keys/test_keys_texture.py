# SPDX-License-Identifier: Apache-2.0
"""The pixels of a lamp on its card."""

import numpy as np
import pytest
import torch
from key_cases import Rectangle

from asglight.keys import texture
from asglight.keys.rectangles import Card
from asglight.sphere import latlong

ROWS = 64


def card_of(lamp: Rectangle) -> Card:
    return Card.facing(lamp.axes, lamp.extent)


def test_the_first_texel_of_the_first_row_is_at_plus_x_and_plus_y() -> None:
    # UsdLux: "a texture file's min coordinates should be at (+X, +Y)"
    lamp = Rectangle(170, 40, 25, 40, 30)
    card = card_of(lamp)
    corner = card.corners()[0]  # +x, +y
    near = latlong.directions(ROWS, 2 * ROWS).double() @ torch.from_numpy(corner)
    light = torch.exp(20 * (near - 1))[..., None].expand(-1, -1, 3)
    image = texture.rectified(card, (20, 30), light, 0)
    assert int(image.sum(-1).argmax()) == 0


def test_an_even_light_is_an_even_image_of_mean_one() -> None:
    for lamp in (Rectangle(0, 0, 0, 60, 40), Rectangle(179, 88, 10, 30, 20)):
        light = torch.full((ROWS, 2 * ROWS, 3), 7.0)
        image = texture.rectified(card_of(lamp), (16, 24), light, 0)
        torch.testing.assert_close(image, torch.ones(16, 24, 3), rtol=1e-5, atol=0)


def test_an_image_has_the_flux_of_its_light_on_the_card() -> None:
    torch.manual_seed(0)
    lamp = Rectangle(30, 20, 15, 50, 30)
    card = card_of(lamp)
    light = torch.rand(ROWS, 2 * ROWS, 3)
    rows, columns = 40, 60
    image = texture.rectified(card, (rows, columns), light, 0).double().numpy()
    p, q = card.extent
    y, x = np.meshgrid(
        q * (1 - 2 * (np.arange(rows) + 0.5) / rows),
        p * (1 - 2 * (np.arange(columns) + 0.5) / columns),
        indexing="ij",
    )
    weight = (1 + x * x + y * y) ** -1.5
    mean = (image * weight[..., None]).sum((0, 1)) / weight.sum()
    # the weights are taken at middles here, and at nine points there
    np.testing.assert_allclose(mean, 1, rtol=1e-4)


def test_light_of_some_rows_is_found_where_they_are_and_a_dark_channel_is_even() -> None:
    lamp = Rectangle(0, 45, 0, 20, 20)
    light = torch.ones(ROWS // 2, 2 * ROWS, 3) * torch.tensor([1.0, 2.0, 0.0])
    image = texture.rectified(card_of(lamp), (8, 8), light, 0)
    torch.testing.assert_close(image, torch.ones(8, 8, 3))
    shifted = texture.rectified(card_of(lamp), (8, 8), light, ROWS // 2)
    torch.testing.assert_close(shifted, torch.ones(8, 8, 3))  # none is there


@pytest.mark.parametrize("latitude", [0.0, 85.0])
def test_images_are_finer_than_the_map_also_beside_a_pole(latitude: float) -> None:
    rows, columns = texture.size(card_of(Rectangle(0, latitude, 0, 3, 2)), 256)
    narrow = np.degrees(np.pi / 256) * max(np.cos(np.radians(latitude + 1.5)), 0.1)
    assert columns >= 3 / narrow * 4
    assert rows >= 2 / narrow * 4
    assert max(rows, columns) <= 512
