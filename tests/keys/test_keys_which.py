# SPDX-License-Identifier: Apache-2.0
"""Which lamps of a map are keys: suns in glare and behind cloud, lamps among others, halves."""

import numpy as np
import pytest
import torch
from key_cases import Array, Rectangle, sky

from asglight.keys.following import MOST, SHADOW, keys
from asglight.keys.sighting import Sighting, sightings
from asglight.keys.spots import Grid

ROWS = 128
GRID = Grid.of(ROWS, 2 * ROWS)
SUN = np.array([0.3, 0.6, 0.7])
TEXEL = np.pi / ROWS


def angle(direction: Array) -> Array:
    unit = direction / np.linalg.norm(direction)
    return np.arccos(np.clip(GRID.directions @ unit, -1, 1))


def disc(direction: Array, radius_deg: float) -> Array:
    """Return which share of each texel a disc covers, about."""
    return np.clip((np.radians(radius_deg) - angle(direction)) / TEXEL + 0.5, 0, 1)


def found(*lights: Array) -> list[Sighting]:
    """Return the keys of a sky with lights of one radiance a texel."""
    radiance = sky(ROWS) + sum(torch.from_numpy(light)[..., None].float() for light in lights)
    return [track.seen[0] for track in keys([sightings(radiance)])]


@pytest.mark.parametrize("strength", [1e3, 1e4, 1e5])
@pytest.mark.parametrize(("part", "width"), [(1e-3, 0.03), (1e-3, 0.1), (1e-2, 0.03), (3e-3, 0.2)])
def test_a_sun_in_its_glare_is_one_key(strength: float, part: float, width: float) -> None:
    glare = part * strength * np.exp(-angle(SUN) / width)
    [sun] = found(strength * disc(SUN, 1), glare)
    away = np.arccos(np.clip(sun.direction @ SUN / np.linalg.norm(SUN), -1, 1))
    assert away < TEXEL
    assert sun.radius < np.radians(12)  # a glare of 0.2 radians has light to 40 degrees and more


def test_glare_that_has_less_light_than_its_sun_stays_in_the_rest() -> None:
    [sun] = found(1e4 * disc(SUN, 1), 10 * np.exp(-angle(SUN) / 0.1))
    assert sun.radius < np.radians(1) + TEXEL


def test_a_sun_that_shows_through_a_thin_cloud_is_one_key_until_its_disc_is_gone() -> None:
    aureole = 20 * np.exp(-angle(SUN) / 0.35)  # as wide as a lamp may be, and without an edge
    for strength in (1e4, 1e3, 400):
        [sun] = found(strength * disc(SUN, 1), aureole)
        assert sun.radius < np.radians(1) + TEXEL
    assert found(aureole) == []


def test_a_bulb_in_a_dish_is_a_lamp_with_it() -> None:
    [lamp] = found(50 * disc(SUN, 12), 200 * disc(SUN, 2))
    assert lamp.radius == pytest.approx(np.radians(12), abs=TEXEL)


def test_of_two_lamps_the_weak_one_is_a_key_while_its_shadow_is_seen() -> None:
    first, second = np.array([1, 0.5, 0.2]), np.array([-1, 0.4, 0.5])
    for strength in (300, 150, 80, 30, 10):
        seen = found(300 * disc(first, 3), strength * disc(second, 3))
        flux = strength * 2 * np.pi * (1 - np.cos(np.radians(3)))
        unit = second / np.linalg.norm(second)
        behind = sky(ROWS).double().numpy().mean(-1)
        other = (behind * np.maximum(GRID.directions @ unit, 0) * GRID.solid_angle).sum()
        shadow = flux / (flux + other)  # the first lamp is behind a surface that faces this one
        assert len(seen) == 1 + (shadow > SHADOW)


@pytest.mark.parametrize("count", [2, 3, 6, 20])
def test_equal_lamps_are_keys_until_most_of_their_light_is_carried(count: int) -> None:
    turns = 2.39996 * np.arange(count)  # the golden angle
    height = 0.85 - 0.75 * (np.arange(count) + 0.5) / count
    wide = np.sqrt(1 - height**2)
    middles = np.stack([wide * np.cos(turns), height, wide * np.sin(turns)], 1)
    lights = [200 * disc(one, 1.5) for one in middles]
    seen = found(*lights)
    assert MOST * count - 1 < len(seen) <= count
    if count <= 3:  # each has a shadow that is plainly seen: none is left out among its like
        assert len(seen) == count


def test_an_overcast_sky_with_a_bright_side_has_none() -> None:
    gradient = 2 * np.maximum(GRID.directions @ (SUN / np.linalg.norm(SUN)), 0)
    assert found(gradient) == []
    assert found(gradient, 3 * np.exp(-((angle(SUN) / 0.35) ** 2))) == []


def test_half_a_soft_box_behind_something_is_the_half_that_is_seen() -> None:
    box = Rectangle(20, 30, 0, 30, 20)
    seen = box.covers(GRID.directions)
    half = seen & (GRID.directions @ box.axes[0] < 0)
    [lamp] = found(60.0 * half)
    solid = float(GRID.solid_angle[half].sum())
    assert lamp.radius == pytest.approx(np.sqrt(solid / np.pi), rel=0.02)
    assert lamp.figure > 0.9


def test_a_patch_of_sky_with_a_ragged_rim_is_none() -> None:
    torch.manual_seed(1)
    leaves = torch.nn.functional.interpolate(torch.rand(1, 1, 40, 80), (ROWS, 2 * ROWS))[0, 0]
    patch = (angle(SUN) < np.radians(22)) & (leaves.numpy() > 0.45)
    assert found(20.0 * patch) == []
