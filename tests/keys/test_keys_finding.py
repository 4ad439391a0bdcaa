# SPDX-License-Identifier: Apache-2.0
"""Lamps in maps: what is one, what is not, and where one ends."""

import numpy as np
import torch
from key_cases import Rectangle, sky, with_lamps

from asglight.keys.finding import lamps
from asglight.keys.following import FIGURE_MIN
from asglight.keys.sighting import enclosed, sightings
from asglight.keys.spots import Grid
from asglight.sphere import latlong

ROWS = 128


def test_a_lamp_has_the_light_of_its_rectangle_above_the_sky() -> None:
    lamp = Rectangle(30, 20, 10, 12, 7)
    radiance = with_lamps(ROWS, lamp).double().numpy().mean(-1)
    grid = Grid.of(ROWS, 2 * ROWS)
    [found] = lamps(radiance, grid)
    behind = sky(ROWS).double().numpy().mean(-1)
    truth = float(((radiance - behind) * grid.solid_angle).sum())
    assert abs(found.flux / truth - 1) < 0.05  # texels that its edge divides are in or out
    assert np.degrees(np.arccos(found.direction @ lamp.axes[2])) < 0.2


def test_a_sun_of_one_texel_is_a_lamp_anywhere() -> None:
    for row, column in ((0, 17), (40, 0), (64, 255), (127, 3)):
        radiance = sky(ROWS)
        radiance[row, column] = 1e5
        [found] = sightings(radiance)
        assert found.place.tolist() == [row * 2 * ROWS + column]


def test_a_sun_that_a_filter_has_cut_in_two_is_one_lamp() -> None:
    radiance = sky(ROWS)
    radiance[30, 60] = radiance[30, 62] = 3e4
    radiance[30, 61] = 0
    [found] = sightings(radiance)
    assert len(found.place) == 2


def test_a_glow_without_an_edge_is_none() -> None:
    directions = latlong.directions(ROWS, 2 * ROWS)
    for width in (0.3, 0.6, 1.0):
        angle = (directions @ torch.tensor([0.6, 0.0, 0.8])).clamp(-1, 1).acos()
        glow = sky(ROWS) * (1 + 12 * torch.exp(-angle / width))[..., None]
        assert sightings(glow) == []


def test_an_overcast_sky_and_a_black_map_have_none() -> None:
    torch.manual_seed(0)
    clouds = sky(ROWS) * (1 + 0.5 * torch.rand(ROWS, 2 * ROWS, 1))
    assert sightings(clouds) == []
    assert sightings(torch.zeros(ROWS, 2 * ROWS, 3)) == []


def test_two_windows_beside_each_other_are_two_lamps() -> None:
    radiance = with_lamps(ROWS, Rectangle(0, 0, 0, 10, 14), Rectangle(16, 0, 0, 10, 14))
    assert len(sightings(radiance)) == 2


def test_leaves_before_a_sky_have_no_outline() -> None:
    torch.manual_seed(0)
    grid = Grid.of(ROWS, 2 * ROWS)
    window = Rectangle(0, 20, 0, 50, 40)
    inside = torch.from_numpy(window.covers(grid.directions))
    radiance = 0.05 * sky(ROWS)
    leaves = torch.nn.functional.interpolate(torch.rand(1, 1, 32, 64), (ROWS, 2 * ROWS))[0, 0]
    radiance[inside & (leaves > 0.4)] = 2.0
    assert sightings(radiance)[0].figure < FIGURE_MIN
    whole = 0.05 * sky(ROWS)
    whole[inside] = 2.0
    [lamp] = sightings(whole)
    assert lamp.figure > 0.9


def test_dark_rings_that_filters_leave_in_a_lamp_are_of_its_outline() -> None:
    grid = Grid.of(ROWS, 2 * ROWS)
    angle = np.degrees(np.arccos(np.clip(grid.directions @ [0.0, 0.6, 0.8], -1, 1)))
    spot = (angle < 14) & ~((angle > 8) & (angle < 10))
    ring = enclosed(spot, grid)
    np.testing.assert_array_equal(ring, (angle < 14) & ~spot)
    assert not enclosed(angle < 14, grid).any()
