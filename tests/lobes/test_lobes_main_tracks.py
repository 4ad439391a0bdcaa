# SPDX-License-Identifier: Apache-2.0
"""The main track of a lamp stays on it, and no track moves where lobes stand still."""

import math
from collections.abc import Sequence

import pytest
import torch

from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.main_tracks import kept_on_lamps

SIGMA_DEG = math.degrees(1 / math.sqrt(2 * 30))
OFF = math.nan

Rows = Sequence[Sequence[float]]


def shot(places: Rows, light: Rows, sharpness: float = 30.0) -> Lobes:
    """Return round lobes of 7 degrees on the horizon: degrees and light by frame and track."""
    frames = []
    for degrees, amplitude in zip(places, light, strict=True):
        angle = torch.deg2rad(torch.tensor(degrees))
        axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
        lit = torch.tensor(amplitude, dtype=torch.float32)[:, None].expand(-1, 3)
        frames.append(Lobes(axes_around(axis_z), torch.full((len(degrees), 2), sharpness), lit))
    return stack(frames)


def degrees_of(lobes: Lobes, track: int) -> list[float]:
    """Return where a track is while it is lit; NaN in the dark."""
    z = lobes.axis_z[:, track]
    degrees = torch.rad2deg(torch.atan2(z[:, 0], z[:, 2])).round(decimals=3)
    return torch.where(lobes.amplitude[:, track, 0] > 0, degrees, torch.nan).tolist()


def same(found: list[float], wanted: list[float]) -> bool:
    return all(
        a == b or (math.isnan(a) and math.isnan(b)) for a, b in zip(found, wanted, strict=True)
    )


def unchanged(found: Lobes, given: Lobes) -> bool:
    return torch.equal(found.axes, given.axes) and torch.equal(found.amplitude, given.amplitude)


def test_the_older_of_two_on_one_lamp_takes_over_the_path_of_the_younger() -> None:
    given = shot(
        [[0, 90], [5, 8], [10, 13], [15, 18], [15, 23]], [[1, 0], [1, 1], [1, 1], [0, 1], [0, 1]]
    )
    found = kept_on_lamps(given)
    assert same(degrees_of(found, 0), [0, 5, 10, 18, 23])
    assert same(degrees_of(found, 1), [OFF, 8, 13, OFF, OFF])
    torch.testing.assert_close(asg.flux(found).sum(1), asg.flux(given).sum(1))


def test_the_younger_ends_where_it_is_the_younger() -> None:
    given = shot([[0, 90], [5, 8], [10, 13], [15, 18]], [[1, 0], [1, 1], [1, 1], [1, 0]])
    assert unchanged(kept_on_lamps(given), given)


def test_two_small_lobes_on_a_sun_are_side_by_side() -> None:
    """Half a degree is two of their widths, and less than a texel of the map that is fitted."""
    given = shot(
        [[0, 90], [1, 1.5], [2, 2.5], [90, 3.5]],
        [[1, 0], [1, 1], [1, 1], [0, 1]],
        1 / (2 * math.radians(0.25) ** 2),
    )
    assert same(degrees_of(kept_on_lamps(given), 0), [0, 1, 2, 3.5])


NONE = 90.0


def grown(turn: float) -> Lobes:
    """Return a lamp that grows from one lobe to five; the fit lets the first drift to its front."""
    steps = [
        [0.0, NONE, NONE, NONE, NONE],
        [0.5, -0.5, NONE, NONE, NONE],
        [0.9, -0.9, 0.0, NONE, NONE],
        *[[1.7, -1.7, 0.0, 0.85, -0.85]] * 4,
    ]
    places = [
        [1.7 * SIGMA_DEG * place + turn * k if place < NONE else NONE for place in one]
        for k, one in enumerate(steps)
    ]
    return shot(places, [[float(place < NONE) for place in one] for one in steps])


@pytest.mark.parametrize("turn", [0.0, 25.0])
def test_the_middle_of_a_lamp_that_becomes_long_is_the_old_track(turn: float) -> None:
    """A lamp that stands still, and one that turns by more than its width a frame."""
    given = grown(turn)
    found = kept_on_lamps(given)
    wanted = [1.7 * SIGMA_DEG * 0.85 + turn * k for k in range(3, 7)]
    assert degrees_of(found, 0)[3:] == pytest.approx(wanted, abs=1e-2)
    torch.testing.assert_close(asg.flux(found).sum(1), asg.flux(given).sum(1))


def test_lobes_that_stand_still_keep_their_tracks() -> None:
    """A lamp grows to one side and stays so: its oldest lobe is at an end, beyond its width.

    To be in the middle it would have to go there, and another one back.
    """
    step = 1.7 * SIGMA_DEG
    row = [0, step, 2 * step, 3 * step]
    given = shot([row] * 12, [[1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 0]] + [[1, 1, 1, 1]] * 9)
    found = kept_on_lamps(given)
    assert unchanged(found, given)


def test_a_lamp_that_is_switched_off_leaves_others_alone() -> None:
    """Those between which it is dark: half-way there is a tenth of the light at 2.4 sigma."""
    far = 2 * 2.5 * SIGMA_DEG
    given = shot([[0, far], [0, far], [0, far]], [[1, 0], [1, 1], [0, 1]])
    assert unchanged(kept_on_lamps(given), given)


def test_a_track_goes_on_again_and_again() -> None:
    """Three lobes on one lamp, which end one after the other, the oldest first."""
    given = shot(
        [[0, 99, 99], [0, 2, 99], [0, 2, 4], [0, 2, 4], [0, 2, 4]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 1]],
    )
    found = kept_on_lamps(given)
    assert bool((found.amplitude[:, 0] > 0).all())
    assert [int((found.amplitude[k, :, 0] > 0).sum()) for k in range(5)] == [1, 2, 3, 2, 1]


def test_a_track_that_is_dark_for_a_frame_does_not_sweep_to_another_place() -> None:
    """A main track at an end of its lamp, and one in the middle that is dark once.

    To exchange them there would let the dark one wait at the end and go to the middle lit.
    """
    step = 1.7 * SIGMA_DEG
    row = [2 * step, step, 0, -step, -2 * step]
    lit = [[1, 1, 1, 1, 1], [1, 1, 0, 1, 1], [1, 1, 1, 1, 1]]
    given = shot([row] * 3, lit)
    assert unchanged(kept_on_lamps(given), given)


def test_a_sun_keeps_its_track_where_a_bright_cloud_passes() -> None:
    """The sun dims to a hundredth while a cloud ten times as wide shines beside and around it."""
    sun, cloud = 4000.0, 40.0
    frames = []
    for dimmed, place in ((1, 25), (0.3, 12), (0.003, 6), (0.003, 0), (0.3, -12), (1, -25)):
        one = shot([[0.0, float(place)]], [[1000.0 * dimmed, 3.0]])[0]
        frames.append(Lobes(one.axes, torch.tensor([[sun, sun], [cloud, cloud]]), one.amplitude))
    given = stack(frames)
    assert unchanged(kept_on_lamps(given), given)


def test_a_sun_whose_lobe_is_given_up_behind_a_cloud_keeps_its_track() -> None:
    """A younger lobe, which begins at the sun where the cloud is thickest, goes on in its stead."""
    sun, cloud = 4000.0, 40.0
    light = [
        [1000.0, 3.0, 0.0],
        [300.0, 3.0, 0.0],
        [3.0, 3.0, 3.0],
        [0.0, 3.0, 6.0],
        [0.0, 3.0, 300.0],
        [0.0, 3.0, 1000.0],
    ]
    frames = []
    for place, amplitude in zip((25, 12, 6, 0, -12, -25), light, strict=True):
        one = shot([[0.0, float(place), 0.3]], [amplitude])[0]
        widths = torch.tensor([[sun, sun], [cloud, cloud], [sun, sun]])
        frames.append(Lobes(one.axes, widths, one.amplitude))
    found = kept_on_lamps(stack(frames))
    assert bool((found.amplitude[:, 0] > 0).all())
    assert max(abs(place) for place in degrees_of(found, 0)) <= 0.31
    assert same(degrees_of(found, 1), [25, 12, 6, 0, -12, -25])


def test_of_two_lobes_in_one_place_the_one_of_the_same_width_goes_on() -> None:
    given = shot([[0, 0, 0]] * 4, [[1, 0, 0], [1, 1, 1], [0, 1, 1], [0, 1, 1]])
    widths = torch.tensor([[30.0, 30.0], [30.0, 30.0], [3.0, 3.0]])
    found = kept_on_lamps(Lobes(given.axes, widths.expand(4, 3, 2), given.amplitude))
    assert found.sharpness[:, 0, 0].tolist() == [30.0] * 4


def test_a_black_shot_stays_as_it_is() -> None:
    given = shot([[0, 3], [0, 3]], [[0, 0], [0, 0]])
    assert unchanged(kept_on_lamps(given), given)
