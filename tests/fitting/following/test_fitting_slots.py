# SPDX-License-Identifier: Apache-2.0
"""Tracks: 2 N of them, N lit at most; who is free, and which one a new light takes."""

import math

import pytest
import torch
from lobe_cases import lamps

from asglight.fitting.following import slots
from asglight.lobes import Form, Lobes
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


def track_for(light: Lobes, before: Lobes, free: list[bool]) -> int:
    """Return the track that a new light takes."""
    return slots.tracks_for(light, [-1], before, torch.tensor(free))[0]


def test_a_light_that_comes_back_takes_its_own_track() -> None:
    before = lamps([A, B, C, D], [20.0] * 4, [1.0, 0.0, 0.0, 0.0])
    near_c = lamps([(0.05, 0.0, 1.0)], [20.0], [3.0])
    assert track_for(near_c, before, [False, True, True, True]) == 2
    # also where it was dark for one frame alone
    assert track_for(near_c, before, [False, True, False, True]) == 2
    elsewhere = lamps([(1.0, 1.0, 1.0)], [200.0], [3.0])
    assert track_for(elsewhere, before, [False, True, True, True]) == 1
    of_another_width = lamps([(1.0, 0.05, 0.0)], [900.0], [3.0])
    assert track_for(of_another_width, before, [False, True, True, True]) == 1  # that at A is lit


def test_likeness_is_the_correlation_of_two_gaussians() -> None:
    """Of plane Gaussians one sigma apart exp(-1/4), of one twice as wide as the other 4 / 5."""
    sharpness = 50.0  # sigma is a tenth of a radian; cells of 6 degrees add a twelfth to its square
    lobes = lamps([A, A], [sharpness, sharpness / 4], [1.0, 7.0])
    others = lamps([(1.0, 0.1, 0.0), A], [sharpness, sharpness], [2.0, 3.0])
    found = slots.alike(lobes, others)
    assert float(found[0, 0]) == pytest.approx(math.exp(-0.25 / 1.08), abs=0.01)
    assert float(found[0, 1]) == pytest.approx(1.0, abs=1e-6)
    assert float(found[1, 1]) == pytest.approx(0.8, abs=0.03)


def test_lobes_keep_their_tracks_while_they_are_like_them() -> None:
    known = joined(lamps([A, B], [20.0] * 2, [1.0] * 2), lamps([C, D], [20.0] * 2, [0.0] * 2))
    free = torch.tensor([False, False, True, True])
    near = lamps([(1.0, 0.1, 0.0), (0.05, 1.0, 0.0)], [20.0] * 2, [1.0] * 2)
    assert slots.tracks_for(near, [0, 1], known, free) == [0, 1]
    # the second has come to look more like the first's track than the first does
    both = lamps([(1.0, 0.2, 0.0), (1.0, 0.0, 0.0)], [20.0] * 2, [1.0] * 2)
    assert slots.tracks_for(both, [0, 1], known, free) == [0, 2]


def test_lobes_that_change_places_change_tracks() -> None:
    """As where lobes are relocated and steps lead the others back to what was there."""
    known = joined(lamps([A, B], [20.0] * 2, [1.0] * 2), lamps([C, D], [20.0] * 2, [0.0] * 2))
    free = torch.tensor([False, False, True, True])
    swapped = lamps([B, A], [20.0] * 2, [1.0] * 2)
    assert slots.tracks_for(swapped, [0, 1], known, free) == [1, 0]
    # one was given up, and the new one is where it was
    assert slots.tracks_for(swapped, [0, -1], known, free) == [1, 0]
    assert slots.tracks_for(lamps([A, D], [20.0] * 2, [1.0] * 2), [0, -1], known, free) == [0, 3]


def test_lobes_fitted_afresh_keep_the_track_of_a_light_that_stays() -> None:
    before = joined(
        lamps([A, B], [20.0, 20.0], [1.0, 1.0]), lamps([C, D], [20.0, 20.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([(0.3, 0.4, -1.0), (0.02, 1.0, 0.0)], [20.0, 20.0], [1.0, 1.0])
    # of two as wide, that at D is nearer
    assert slots.tracks_for(fresh, [-1, -1], before, free) == [3, 1]


def test_new_lights_take_any_track_where_none_is_free() -> None:
    """One that is dark rather than one that was lit just before."""
    elsewhere = lamps([(0.3, 0.4, -1.0), (0.3, -0.4, -1.0)], [20.0, 20.0], [1.0, 1.0])
    none = torch.zeros(3, dtype=torch.bool)
    before = lamps([A, B, D], [20.0] * 3, [1.0, 1.0, 0.0])
    assert slots.tracks_for(elsewhere, [-1, -1], before, none) == [2, 0]
    assert slots.tracks_for(elsewhere, [0, 1], before, none) == [2, 0]


def test_a_new_light_takes_the_free_track_whose_light_was_as_wide() -> None:
    """A track is shown as a card or in a dome for the whole shot, and so a sun and a sky part."""
    before = lamps([A, B, C, D], [1000.0, 2.0, 900.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    free = [False, True, True, True]
    sun, sky = (lamps([(1.0, 1.0, 1.0)], [sharpness], [3.0]) for sharpness in (2000.0, 1.5))
    assert track_for(sun, before, free) == 2
    assert track_for(sky, before, free) == 1
    # a sun that comes out from behind a cloud, farther on than its width, takes its own
    suns = lamps([A, B, C, D], [1000.0, 1000.0, 1000.0, 3.0], [1.0, 0.0, 0.0, 0.0])
    farther_on = lamps([(0.1, 0.0, 1.0)], [1000.0], [3.0])
    assert track_for(farther_on, suns, free) == 2
    # nor is a sky the sun that was where its middle is
    sky_at_c = lamps([C], [1.5], [3.0])
    assert track_for(sky_at_c, before, free) == 1


def test_lobes_fitted_afresh_take_tracks_of_lights_as_wide() -> None:
    before = joined(
        lamps([A, B], [20.0, 20.0], [1.0, 1.0]), lamps([C, D], [2.0, 1000.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([(1.0, 1.0, 1.0), (-1.0, -1.0, 1.0)], [900.0, 3.0], [1.0, 1.0])
    assert slots.tracks_for(fresh, [-1, -1], before, free) == [3, 2]


def test_a_sky_fitted_afresh_is_not_the_sun_that_stays() -> None:
    """Both have their middle at B; the sun's track stays the sun's."""
    before = joined(
        lamps([A, B], [20.0, 1000.0], [1.0, 1.0]), lamps([C, D], [2.0, 900.0], [0.0, 0.0])
    )
    free = torch.tensor([False, False, True, True])
    fresh = lamps([B, B], [1.5, 1000.0], [1.0, 1.0])
    assert slots.tracks_for(fresh, [-1, -1], before, free) == [2, 1]
    assert slots.tracks_for(fresh.select(torch.tensor([0])), [-1], before, free) == [2]


@pytest.mark.parametrize(
    ("degrees", "sharpness", "light", "is_other"),
    [
        (40, (1.0, 400.0), 1.0, True),  # a sky lobe that goes to a lamp
        (9, (1.0, 400.0), 1.0, True),  # to one within it
        (40, (400.0, 300.0), 1.0, False),  # a lamp that moves by far
        (40, (400.0, 1.0), 1.0, True),
        (5, (400.0, 300.0), 0.01, True),  # what is left of a lamp that faded has drifted
        (5, (300.0, 400.0), 100.0, True),
        (1, (400.0, 300.0), 0.01, False),  # by less than its width, 2 degrees
        (5, (400.0, 300.0), 0.05, False),
        (5, (400.0, 300.0), 0.0, False),  # gone: fading.py says where to
    ],
)
def test_a_lobe_of_other_widths_or_one_that_faded_and_drifts_is_another_light(
    degrees: float, sharpness: tuple[float, ...], light: float, is_other: bool
) -> None:
    angle = math.radians(degrees)
    places = [(0.0, 0.0, 1.0), (math.sin(angle), 0.0, math.cos(angle))]
    before, after = (
        lamps([place, (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)], [narrow, 5.0, 5.0], [1.0] * 3)
        for place, narrow in zip(places, sharpness, strict=True)
    )
    found = slots.is_other(after, before, torch.tensor([light, 1.0, 0.001]))
    assert found.tolist() == [is_other, False, False]
