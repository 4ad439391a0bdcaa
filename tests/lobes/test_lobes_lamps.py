# SPDX-License-Identifier: Apache-2.0
"""Which lobes of a frame are on one lamp, where it is, and how wide."""

import math

import pytest
import torch

from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.lamps import Lamps, lamps


def lobes_on_the_horizon(degrees: list[float], sharpness: list[float], light: list[float]) -> Lobes:
    angle = torch.deg2rad(torch.tensor(degrees, dtype=torch.float64))
    axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
    widths = torch.tensor(sharpness, dtype=torch.float64)[:, None].expand(-1, 2)
    amplitude = torch.tensor(light, dtype=torch.float64)[:, None].expand(-1, 3)
    return Lobes(axes_around(axis_z), widths, amplitude)


def lamps_of(shot: Lobes) -> Lamps:
    return lamps(shot, asg.flux(shot).sum(-1))


def on_the_horizon(degrees: list[float], sharpness: list[float], light: list[float]) -> Lamps:
    """Return the lamps of one frame."""
    found = lamps_of(lobes_on_the_horizon(degrees, sharpness, light)[None])
    return Lamps(found.number[0], found.centre[0], found.off_centre[0])


def sigma_deg(sharpness: float) -> float:
    return math.degrees(1 / math.sqrt(2 * sharpness))


def test_lobes_in_a_row_are_one_lamp_and_a_gap_parts_two() -> None:
    """Two Gaussians of one height have half-way 2 exp(-(d / 2)^2 / (2 sigma^2)) of their peak."""
    step = sigma_deg(60.0)
    gap = 2 * math.sqrt(2 * math.log(2 / 0.1))  # in sigma: there it is a tenth
    places = [0, 2 * step, 4 * step, (4 + 1.05 * gap) * step, (4 + 2.1 * gap) * step]
    found = on_the_horizon(places, [60.0] * 5, [1.0] * 5)
    assert found.number.tolist() == [0, 0, 0, 3, 4]
    near = on_the_horizon([0, 0.95 * gap * step], [60.0] * 2, [1.0] * 2)
    assert near.number.tolist() == [0, 0]


def test_a_faint_broad_lobe_around_lamps_is_on_none() -> None:
    found = on_the_horizon([0, 40, 20], [500.0, 500.0, 2.0], [10.0, 10.0, 0.1])
    assert found.number.tolist() == [0, 1, 2]


def test_a_black_lobe_is_on_no_lamp() -> None:
    found = on_the_horizon([0, 0], [60.0, 60.0], [0.0, 1.0])
    assert found.number.tolist() == [-1, 0]
    assert float(found.off_centre[0]) == 0.0


def test_the_width_is_that_of_places_and_lobes_together() -> None:
    """Two equal narrow lobes: the square of the width is (d / 2)^2 + 2 sigma^2."""
    sharpness, apart = 800.0, 2.0
    sigma = sigma_deg(sharpness)
    found = on_the_horizon([10.0, 10.0 + apart], [sharpness] * 2, [1.0] * 2)
    width = math.hypot(apart / 2, sigma, sigma)
    assert found.off_centre.tolist() == pytest.approx([apart / 2 / width] * 2, rel=1e-3)
    centre = math.radians(10.0 + apart / 2)
    wanted = torch.tensor([math.sin(centre), 0.0, math.cos(centre)], dtype=torch.float64)
    torch.testing.assert_close(found.centre, wanted.expand(2, 3))


def test_the_brighter_lobe_is_nearer_to_the_middle() -> None:
    """A third of the light and two thirds: distances are as two to one."""
    found = on_the_horizon([0.0, 3.0], [400.0] * 2, [1.0, 2.0])
    assert float(found.off_centre[0] / found.off_centre[1]) == pytest.approx(2.0, rel=1e-3)


def test_frames_have_the_lamps_that_each_has_by_itself() -> None:
    """Of a frame with every lobe, one with some, and one that is black; more pairs than fit."""
    degrees, sharpness = [-30.0, 0.0, 4.0, 8.0, 60.0], [60.0, 60.0, 60.0, 80.0, 9.0]
    lights = [[1.0, 1.0, 2.0, 1.0, 1.0], [0.0, 1.0, 0.0, 3.0, 1.0], [0.0] * 5] * 60
    found = lamps_of(stack([lobes_on_the_horizon(degrees, sharpness, light) for light in lights]))
    for frame, light in enumerate(lights):
        alone = on_the_horizon(degrees, sharpness, light)
        assert found.number[frame].tolist() == alone.number.tolist()
        torch.testing.assert_close(found.centre[frame], alone.centre)
        torch.testing.assert_close(found.off_centre[frame], alone.off_centre)
    assert found.number[:3].tolist() == [[0, 1, 1, 1, 4], [-1, 0, -1, 0, 2], [-1] * 5]


def test_lamps_are_the_same_in_any_unit_of_light() -> None:
    near = [0.0, 3.0, 90.0], [400.0] * 3
    found = on_the_horizon(*near, [1.0, 2.0, 0.0])
    dim = on_the_horizon(*near, [1e-20, 2e-20, 0.0])
    torch.testing.assert_close(dim.centre, found.centre)
    torch.testing.assert_close(dim.off_centre, found.off_centre)
