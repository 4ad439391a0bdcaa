# SPDX-License-Identifier: Apache-2.0
"""Dark lobes lie on the paths that they end or begin."""

import math

import pytest
import torch
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.fading import carried_on
from asglight.lobes.frames import axes_around


def lobe_at(degrees: float, light: float) -> Lobes:
    """Return a lobe on the horizon, and a still one far from it."""
    angle = math.radians(degrees)
    axis_z = torch.tensor([[math.sin(angle), 0.0, math.cos(angle)], [0.0, 1.0, 0.0]])
    sharpness = torch.tensor([[30.0, 60.0], [5.0, 5.0]])
    amplitude = torch.tensor([[light] * 3, [1.0] * 3])
    return Lobes(axes_around(axis_z), sharpness, amplitude)


def shot(degrees: list[float], light: list[float]) -> Lobes:
    return stack([lobe_at(*each) for each in zip(degrees, light, strict=True)])


def degrees_of(lobes: Lobes) -> list[float]:
    z = lobes.axis_z[:, 0]
    return torch.rad2deg(torch.atan2(z[:, 0], z[:, 2])).tolist()


@pytest.mark.parametrize(
    ("given", "light", "wanted"),
    [
        # a path ends and carries on; the next frame waits where the next path begins
        ([0, 5, 10, 99, 99, 60, 62], [1, 1, 1, 0, 0, 1, 1], [0, 5, 10, 15, 58, 60, 62]),
        # longer in the dark: it waits there from the second dark frame on
        ([0, 5, 99, 99, 99, 60, 62], [1, 1, 0, 0, 0, 1, 1], [0, 5, 10, 58, 58, 60, 62]),
        # one dark frame alone is of the path that ended
        ([0, 5, 99, 60, 62], [1, 1, 0, 1, 1], [0, 5, 10, 60, 62]),
        # a flash has no path, and stays where it was
        ([99, 99, 30, 99, 99], [0, 0, 1, 0, 0], [30, 30, 30, 30, 30]),
        # before the first path and after the last
        ([99, 20, 24, 99, 99], [0, 1, 1, 0, 0], [16, 20, 24, 28, 28]),
    ],
)
def test_dark_frames_carry_paths_on(
    given: list[float], light: list[float], wanted: list[float]
) -> None:
    found = carried_on(shot(given, light))
    assert degrees_of(found) == pytest.approx(wanted, abs=1e-3)


def test_light_and_lit_lobes_stay_as_they_are() -> None:
    lobes = shot([0, 5, 99, 99, 60], [1, 1, 0, 0, 1])
    found = carried_on(lobes)
    torch.testing.assert_close(asg.flux(found), asg.flux(lobes))
    lit = lobes.amplitude.amax(-1) > 0
    torch.testing.assert_close(found.axis_z[lit], lobes.axis_z[lit])
    # x and y may change places, which is the same lobe
    widths = (each.sharpness[lit].sort(-1).values for each in (found, lobes))
    torch.testing.assert_close(*widths)


def test_axes_stay_frames_when_carried_on() -> None:
    found = carried_on(shot([0, 40, 99, 99, 10, 50], [1, 1, 0, 0, 1, 1]))
    product: Tensor = found.axes @ found.axes.mT
    torch.testing.assert_close(product, torch.eye(3).expand_as(product), rtol=0, atol=1e-5)


def test_a_track_that_is_never_lit_stays_where_it_is() -> None:
    lobes = shot([10, 20, 30], [0, 0, 0])
    assert degrees_of(carried_on(lobes)) == pytest.approx([10, 20, 30], abs=1e-3)


def test_a_path_ends_and_begins_with_the_lobe_beside_it() -> None:
    """Two lobes on a lamp that speeds up: one is lit all the while, the other for two frames."""
    beside = [0.0, 4.0, 10.0, 18.0, 28.0]
    pair = shot([99, 7, 13, 99, 99], [0, 1, 1, 0, 0])
    leader = shot(beside, [1] * 5)
    both = Lobes(
        torch.cat([pair.axes, leader.axes], dim=1),
        torch.cat([pair.sharpness, leader.sharpness], dim=1),
        torch.cat([pair.amplitude, leader.amplitude], dim=1),
    )
    assert degrees_of(carried_on(both)) == pytest.approx([3, 7, 13, 21, 21], abs=1e-3)
