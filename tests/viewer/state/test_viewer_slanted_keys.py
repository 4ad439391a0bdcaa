# SPDX-License-Identifier: Apache-2.0
"""A key that hangs slanted, in the viewer and in what engines are given: the rectangle it is."""

import numpy as np
import torch
from key_cases import Rectangle, corner_error

from asglight.export.keyed import KeyedLight, key_rows
from asglight.keys.lobes import as_lobes
from asglight.keys.rectangles import Card
from asglight.lobes import Lobes, LobeTracks, asg
from asglight.sphere import latlong
from asglight.usd.lights import cards
from asglight.viewer.uniforms import key_cards

LAMP = Rectangle(170, 30, 20, 34, 24, slant=50, about=60)  # across the seam
FLUX = (3.0, 2.0, 1.0)
ROWS = 128


def key() -> Lobes:
    card = Card(LAMP.sides, LAMP.extent, LAMP.axes[2])
    return as_lobes([[card]], np.array([[FLUX]]))[0]


def test_its_light_on_the_map_is_where_the_lamp_is() -> None:
    image = key_cards.with_cards(np.zeros((ROWS, 2 * ROWS, 3), np.float32), key())
    solid = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64).numpy()[..., None]
    np.testing.assert_allclose((image * solid).sum((0, 1)), FLUX, rtol=1e-5)
    directions = latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64).numpy()
    small, large = (
        Rectangle(170, 30, 20, factor * 34, factor * 24, slant=50, about=60).covers(directions)
        for factor in (0.8, 1.25)
    )
    assert not image[~large].any()
    inside = image[small][:, 0]
    assert inside.std() < 0.02 * inside.mean()  # some more of its points fall into one than another
    middle, beyond = (torch.from_numpy(one) for one in (LAMP.axes[2], LAMP.axes[0]))
    radiance = key_cards.radiance(key(), middle).numpy()
    np.testing.assert_allclose(radiance, inside.mean() * np.array(FLUX) / FLUX[0], rtol=0.01)
    assert not key_cards.radiance(key(), beyond).any()


def test_its_outline_has_the_corners_of_the_lamp() -> None:
    found = key_cards.standing_points(key(), [(1, 1), (-1, 1), (-1, -1), (1, -1)])[0]
    assert corner_error(found, LAMP.corners()) < 1e-6
    [outline] = key_cards.outlines(key())
    assert outline.curves


def test_engines_are_given_the_rectangle_its_radiance_and_its_irradiance() -> None:
    lobes = key()
    half = cards.half_extent(cards.mean_squares(asg.moments(lobes)))
    tracks = LobeTracks((1,), 24.0, lobes[None])
    light = KeyedLight(tracks, half[None], (1,), 24.0, ("a.exr",), torch.zeros(1, 9, 3))
    [(_, row)] = key_rows(light)
    center, x, y, size = (row[k][0].numpy() for k in ("center", "axis_x", "axis_y", "half_size"))
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    corners = np.stack([center + i * size[0] * x + j * size[1] * y for i, j in signs])
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    assert corner_error(corners, LAMP.corners()) < 1e-6
    rows = 1024
    directions = latlong.directions(rows, 2 * rows, dtype=torch.float64).numpy()
    solid = latlong.texel_solid_angles(rows, 2 * rows, dtype=torch.float64).numpy()
    met = LAMP.covers(directions)
    radiance = np.array(FLUX) / solid[met].sum()
    np.testing.assert_allclose(row["radiance"][0], radiance, rtol=0.01)  # rays meet the edges
    irradiance = radiance * (directions[met] @ LAMP.axes[2] * solid[met]).sum()
    np.testing.assert_allclose(row["irradiance"][0], irradiance, rtol=0.01)
