# SPDX-License-Identifier: Apache-2.0
"""Tracks: 2 N of them, N lit at most; who is free, and which one a new light takes."""

import pytest
import torch
from lobe_cases import lamps

from asglight.fitting.following import slots
from asglight.lobes import Form
from asglight.lobes.data import joined

A, B, C, D = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)


@pytest.mark.parametrize("form", list(Form))
def test_spare_tracks_are_dark_and_as_many(form: Form) -> None:
    lobes = lamps([A, B, C], [20.0] * 3, [1.0, 2.0, 3.0])
    lobes = type(lobes)(lobes.axes, lobes.sharpness, lobes.amplitude, form)
    found = slots.with_spare_tracks(lobes)
    assert found.count == 6
    assert found.form is form
    assert torch.equal(found.amplitude[:3], lobes.amplitude)
    assert float(found.amplitude[3:].max()) == 0.0


def test_a_track_is_free_after_two_dark_frames() -> None:
    earlier = lamps([A, B, C, D], [20.0] * 4, [1.0, 1.0, 0.0, 0.0])
    before = lamps([A, B, C, D], [20.0] * 4, [1.0, 0.0, 1.0, 0.0])
    assert slots.free_tracks(before, earlier).tolist() == [False, False, False, True]
    assert slots.free_tracks(before, None).tolist() == [False, True, False, True]


def test_a_light_that_comes_back_takes_its_own_track() -> None:
    before = lamps([A, B, C, D], [20.0] * 4, [1.0, 0.0, 0.0, 0.0])
    dark = torch.tensor([False, True, True, True])
    near_c = lamps([(0.05, 0.0, 1.0)], [20.0], [3.0])
    assert slots.track_for(near_c, dark, dark, before) == 2
    # also where it was dark for one frame alone
    assert slots.track_for(near_c, torch.tensor([False, True, False, True]), dark, before) == 2
    elsewhere = lamps([(1.0, 1.0, 1.0)], [200.0], [3.0])
    assert slots.track_for(elsewhere, dark, dark, before) == 1
    near_a = lamps([(1.0, 0.05, 0.0)], [20.0], [3.0])
    assert slots.track_for(near_a, dark, dark, before) == 1  # that at A is lit


def test_lobes_fitted_afresh_keep_the_track_of_a_light_that_stays() -> None:
    before = joined(
        lamps([A, B], [20.0, 20.0], [1.0, 1.0]), lamps([C, D], [20.0, 20.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([(0.3, 0.4, -1.0), (0.02, 1.0, 0.0)], [20.0, 20.0], [1.0, 1.0])
    assert slots.afresh(fresh, before, free) == [3, 1]  # of two as wide, that at D is nearer


def test_lobes_fitted_afresh_take_any_track_where_none_is_free() -> None:
    before = lamps([A, B], [20.0, 20.0], [1.0, 1.0])
    free = torch.tensor([False, False])
    fresh = lamps([(0.3, 0.4, -1.0), (0.3, -0.4, -1.0)], [20.0, 20.0], [1.0, 1.0])
    assert sorted(slots.afresh(fresh, before, free)) == [0, 1]


def test_a_new_light_takes_the_free_track_whose_light_was_as_wide() -> None:
    """A track is shown as a card or in a dome for the whole shot, and so a sun and a sky part."""
    before = lamps([A, B, C, D], [1000.0, 2.0, 900.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    free = torch.tensor([False, True, True, True])
    sun, sky = (lamps([(1.0, 1.0, 1.0)], [sharpness], [3.0]) for sharpness in (2000.0, 1.5))
    assert slots.track_for(sun, free, free, before) == 2
    assert slots.track_for(sky, free, free, before) == 1
    # a sun that comes out from behind a cloud, farther on than its width, takes its own
    suns = lamps([A, B, C, D], [1000.0, 1000.0, 1000.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    farther_on = lamps([(0.1, 0.0, 1.0)], [1000.0], [3.0])
    assert slots.track_for(farther_on, free, free, suns) == 2
    # nor is a sky the sun that was where its middle is
    sky_at_c = lamps([C], [1.5], [3.0])
    assert slots.track_for(sky_at_c, free, free, before) == 1


def test_lobes_fitted_afresh_take_tracks_of_lights_as_wide() -> None:
    before = joined(
        lamps([A, B], [20.0, 20.0], [1.0, 1.0]), lamps([C, D], [2.0, 1000.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([(1.0, 1.0, 1.0), (-1.0, -1.0, 1.0)], [900.0, 3.0], [1.0, 1.0])
    assert slots.afresh(fresh, before, free) == [3, 2]


def test_a_sky_fitted_afresh_is_not_the_sun_that_stays() -> None:
    """Both have their middle at B; the sun's track stays the sun's."""
    before = joined(
        lamps([A, B], [20.0, 1000.0], [1.0, 1.0]), lamps([C, D], [2.0, 900.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([B, B], [1.5, 1000.0], [1.0, 1.0])
    assert slots.afresh(fresh, before, free) == [2, 1]
    assert slots.afresh(fresh.select(torch.tensor([0])), before, free) == [2]
