# SPDX-License-Identifier: Apache-2.0
"""A lobe that is given another place fades there; one whose light moves turns."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from horizon_lobes import lobes_at
from torch import Tensor

from asglight.lobes import Form, Lobes, LobeTracks, asg, motion
from asglight.lobes.data import stack
from asglight.lobes.fading import carried_on
from asglight.lobes.identity.switches import fading_in_place, switches_apart

BROAD, LAMP = 3.0, 2000.0
"""Sharpness: sigmas of 23 and 0.9 degrees."""


def shot(
    places: Sequence[Sequence[float]], light: Sequence[Sequence[float]], sharpness: Sequence[float]
) -> Lobes:
    """Return lobes by frame and track."""
    return stack([lobes_at(*each, sharpness) for each in zip(places, light, strict=True)])


def irradiance(lobes: Lobes) -> Tensor:
    """Return the irradiance of all lobes, by a latlong sum of what they show.  [D]."""
    rows = 120
    polar = (torch.arange(rows, dtype=torch.float64) + 0.5) * math.pi / rows
    turn = (torch.arange(2 * rows, dtype=torch.float64) + 0.5) * math.pi / rows
    y, x = polar.cos()[:, None].expand(-1, 2 * rows), polar.sin()[:, None] * turn.sin()
    directions = torch.stack([x, y, polar.sin()[:, None] * turn.cos()], -1).view(-1, 3)
    share = (polar.sin() * (math.pi / rows) ** 2).repeat_interleave(2 * rows)
    normals = directions[::197]
    shown = asg.evaluate(lobes, directions).sum(-1) * share
    return (normals @ directions.mT).clamp(min=0) @ shown


def stray(lobes: Lobes, first: int) -> float:
    """Return how far irradiance is from an even change, half-way to the next frame."""
    tracks = LobeTracks(tuple(range(len(lobes.axes))), 24.0, carried_on(lobes), {})
    even = (irradiance(lobes[first]) + irradiance(lobes[first + 1])) / 2
    found = irradiance(motion.at(tracks, [first + 0.5])[0])
    return float((found - even).abs().mean() / even.mean())


def is_same(found: Lobes, given: Lobes) -> bool:
    return all(
        torch.equal(one, other)
        for one, other in (
            (found.axes, given.axes),
            (found.sharpness, given.sharpness),
            (found.amplitude, given.amplitude),
        )
    )


def swapped(spare: int, growth: float = 1, degrees: float = 70, sharpness: float = BROAD) -> Lobes:
    """Two lobes that change places after the second frame, and tracks that are dark."""
    places = [[0, degrees, *[180] * spare]] * 2 + [[degrees, 0, *[180] * spare]] * 2
    light = [[growth**frame, growth**frame, *[0] * spare] for frame in range(4)]
    return shot(places, light, [sharpness] * (2 + spare))


def test_broad_lobes_that_change_places_fade_instead() -> None:
    given = swapped(2)
    found = switches_apart(given)
    assert stray(given, 1) > 0.1
    assert stray(found, 1) < 1e-3
    lit = (found.amplitude > 0).any(-1)
    assert lit.tolist() == [[True, True, False, False]] * 2 + [[False, False, True, True]] * 2


def test_broad_lobes_that_change_places_while_a_lamp_fades_in_fade_too() -> None:
    """The lamp changes irradiance by ten times what the broad lobes do."""
    places = [[0, 70, 40, 180, 180]] * 2 + [[70, 0, 40, 180, 180]] * 2
    light = [[1, 1, power, 0, 0] for power in (2, 5, 20, 20)]
    given = shot(places, light, [BROAD, BROAD, LAMP, BROAD, BROAD])
    found = switches_apart(given)
    assert stray(found, 1) < 1e-3 < stray(given, 1) / 10
    lit = (found.amplitude > 0).any(-1)
    assert lit[2:].tolist() == [[False, False, True, True, True]] * 2


@pytest.mark.parametrize(("sharpness", "is_apart"), [(BROAD, True), (LAMP, False)])
def test_broad_lobes_fade_that_turn_by_less_than_what_tells_of_a_lamp(
    sharpness: float, is_apart: bool
) -> None:
    given = swapped(2, degrees=9, sharpness=sharpness)
    assert is_same(switches_apart(given), given) != is_apart


@pytest.mark.parametrize("form", list(Form))
def test_the_light_of_every_frame_stays_as_it_is(form: Form) -> None:
    given = replace(swapped(2), form=form)
    found = switches_apart(given)
    assert not is_same(found, given)
    for frame in range(4):
        torch.testing.assert_close(irradiance(found[frame]), irradiance(given[frame]))


def test_with_one_track_free_one_of_them_parts() -> None:
    given = swapped(1)
    assert stray(switches_apart(given), 1) < stray(given, 1) / 2 + 1e-3


def test_without_a_free_track_lobes_stay_in_theirs() -> None:
    given = swapped(0)
    assert is_same(switches_apart(given), given)


@pytest.mark.parametrize("when", [0, 3])
def test_a_track_that_is_lit_a_frame_before_or_after_is_not_free(when: int) -> None:
    given = swapped(1)
    amplitude = given.amplitude.clone()
    amplitude[when, 2] = 0.01
    given = replace(given, amplitude=amplitude)
    assert is_same(switches_apart(given), given)


def test_the_free_track_whose_light_was_as_wide_takes_it() -> None:
    places = [[0, 70, 180, 180]] * 2 + [[70, 0, 180, 180]] * 2
    given = shot(places, [[0.5, 0.5, 0, 0]] * 4, [BROAD, BROAD, LAMP, 1.1 * BROAD])
    found = switches_apart(given)
    assert (found.amplitude[-1] > 0).any(-1).tolist() == [False, False, True, True]
    # the one that strays most is the first to part


@pytest.mark.parametrize("frames", [3, 6])
@pytest.mark.parametrize("degrees", [11, 40, 60])
def test_a_lamp_that_passes_turns(degrees: float, frames: int) -> None:
    places = [[step * degrees, 180, 0] for step in range(frames)]
    given = shot(places, [[1, 1, 0]] * frames, [LAMP, BROAD, BROAD])
    assert is_same(switches_apart(given), given)


def test_two_frames_tell_nothing() -> None:
    given = shot([[0, 180, 0], [40, 180, 0]], [[1, 1, 0]] * 2, [BROAD] * 3)
    assert is_same(switches_apart(given), given)


@pytest.mark.parametrize("growth", [0.5, 1.2, 2])
def test_broad_lobes_that_change_places_while_all_light_grows_fade_too(growth: float) -> None:
    """From frame to frame irradiance changes by more than what they sweep, but evenly."""
    given = swapped(2, growth)
    found = switches_apart(given)
    assert stray(given, 1) > 0.1
    assert stray(found, 1) < 1e-3


@pytest.mark.parametrize("degrees", [11, 30, 60])
def test_lobes_of_a_camera_that_pans_turn(degrees: float) -> None:
    start = torch.tensor([0.0, 50, 100, 180, 250])
    places = [[*(start + step * degrees).tolist(), 0, 0] for step in range(3)]
    light = [[1, 0.3, 0.5, 1, 2, 0, 0]] * 3
    given = shot(places, light, [LAMP, BROAD, 10.0, BROAD, 0.5, BROAD, BROAD])
    assert is_same(switches_apart(given), given)


def test_a_shot_that_is_black_stays_as_it_is() -> None:
    given = shot([[0, 90], [60, 90]], [[0, 0]] * 2, [BROAD] * 2)
    assert is_same(switches_apart(given), given)
    assert is_same(fading_in_place(given), given)


def test_a_lamp_that_is_switched_on_does_not_come_from_elsewhere() -> None:
    """Its dark frames were carried on with a lobe that turned."""
    places = [[80, 180], [80, 180], [0, 180], [0, 180]]
    given = shot(places, [[0, 1], [0, 1], [0.3, 1], [0.3, 1]], [LAMP, BROAD])
    found = fading_in_place(given)
    torch.testing.assert_close(found.axes[1, 0], given.axes[2, 0])
    torch.testing.assert_close(found.axes[0], given.axes[0])


def test_a_lamp_goes_on_as_it_fades_however_much_other_lights_change() -> None:
    places = [[step * 25, 180] for step in range(3)] + [[50, 180]]
    given = carried_on(shot(places, [[1, 1], [1, 1], [1, 1], [0, 9]], [LAMP, BROAD]))
    assert is_same(fading_in_place(given), given)
    turned = lobes_at([75], [1], [LAMP]).axis_z[0]
    torch.testing.assert_close(given.axis_z[3, 0], turned)


def test_the_end_of_a_path_moves_on_with_the_lamp_that_it_was_part_of() -> None:
    places = [[0, 2], [15, 17], [30, 32], [45, 45]]
    given = shot(places, [[1, 1], [1, 1], [1, 0], [1, 0]], [LAMP, LAMP])
    assert is_same(fading_in_place(given), given)


def test_a_frame_in_the_dark_alone_stays_on_the_path_that_it_ends() -> None:
    places = [[0, 180], [60, 180], [60, 180]]
    given = shot(places, [[1, 1], [0, 1], [1, 1]], [LAMP, BROAD])
    assert is_same(fading_in_place(given), given)
