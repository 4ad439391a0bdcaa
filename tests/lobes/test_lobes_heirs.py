# SPDX-License-Identifier: Apache-2.0
"""Where lobes of one lamp end, the one that has been there longest goes on."""

import math

import torch

from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.lobes.heirs import inherited

SIGMA_DEG = math.degrees(1 / math.sqrt(2 * 30))


def shot(places: list[list[float]], light: list[list[float]]) -> Lobes:
    """Return round lobes of 7 degrees on the horizon: degrees and light by frame and track."""
    frames = []
    for degrees, amplitude in zip(places, light, strict=True):
        angle = torch.deg2rad(torch.tensor(degrees))
        axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
        lit = torch.tensor(amplitude)[:, None].expand(-1, 3)
        frames.append(Lobes(axes_around(axis_z), torch.full((len(degrees), 2), 30.0), lit))
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


OFF = math.nan


def test_the_older_of_two_on_one_lamp_takes_over_the_path_of_the_younger() -> None:
    given = shot(
        [[0, 90], [5, 8], [10, 13], [15, 18], [15, 23]], [[1, 0], [1, 1], [1, 1], [0, 1], [0, 1]]
    )
    found = inherited(given)
    assert same(degrees_of(found, 0), [0, 5, 10, 18, 23])
    assert same(degrees_of(found, 1), [OFF, 8, 13, OFF, OFF])
    torch.testing.assert_close(asg.flux(found).sum(1), asg.flux(given).sum(1))


def test_the_younger_ends_where_it_is_the_younger() -> None:
    given = shot([[0, 90], [5, 8], [10, 13], [15, 18]], [[1, 0], [1, 1], [1, 1], [1, 0]])
    found = inherited(given)
    torch.testing.assert_close(found.axes, given.axes)
    torch.testing.assert_close(found.amplitude, given.amplitude)


def test_a_lamp_that_is_switched_off_leaves_others_alone() -> None:
    """Those farther away than both widths."""
    far = 2.2 * SIGMA_DEG
    given = shot([[0, far], [0, far], [0, far]], [[1, 0], [1, 1], [0, 1]])
    found = inherited(given)
    torch.testing.assert_close(found.amplitude, given.amplitude)


def test_a_track_inherits_again_and_again() -> None:
    """Three lobes on one lamp, which end one after the other, the oldest first."""
    given = shot(
        [[0, 99, 99], [0, 2, 99], [0, 2, 4], [0, 2, 4], [0, 2, 4]],
        [[1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1], [0, 0, 1]],
    )
    found = inherited(given)
    assert same(degrees_of(found, 0), [0, 0, 0, 2, 4])
    assert int((found.amplitude[-1, :, 0] > 0).sum()) == 1


def test_a_light_that_comes_back_begins_anew() -> None:
    """One that was dark in between is younger than one that went on."""
    given = shot([[0, 3], [0, 3], [0, 3], [0, 3]], [[1, 1], [0, 1], [1, 1], [1, 0]])
    found = inherited(given)
    assert same(degrees_of(found, 1), [3, 3, 3, 0])
    assert same(degrees_of(found, 0), [0, OFF, 0, OFF])
