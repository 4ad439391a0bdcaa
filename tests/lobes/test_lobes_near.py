# SPDX-License-Identifier: Apache-2.0
"""Which lobes are on one lamp."""

import math

import pytest
import torch

from asglight.lobes import Lobes
from asglight.lobes.data import joined, stack
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.near import nearest


def on_the_horizon(degrees: list[float], sharpness: float) -> Lobes:
    angle = torch.deg2rad(torch.tensor(degrees))
    axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
    count = len(degrees)
    return Lobes(axes_around(axis_z), torch.full((count, 2), sharpness), torch.ones(count, 3))


def test_the_nearest_of_those_asked_for_is_found_and_told_whether_it_is_near() -> None:
    """Widths are 1 / sqrt(2 s): 7.4 degrees of s = 30."""
    sigma = math.degrees(1 / math.sqrt(60))
    lobes = on_the_horizon([0.0, 1.9 * sigma, 4.0 * sigma], 30.0)
    index, is_near = nearest(lobes, torch.ones(3, dtype=torch.bool))
    assert index.tolist() == [1, 0, 1]
    assert is_near.tolist() == [True, True, False]
    index, is_near = nearest(lobes, torch.tensor([True, False, True]))
    assert (int(index[1]), bool(is_near[1])) == (0, True)
    assert not bool(is_near[0])


def test_broad_lobes_are_near_within_twenty_degrees_each() -> None:
    lobes = on_the_horizon([0.0, 39.0, 80.5], 0.1)
    _, is_near = nearest(lobes, torch.ones(3, dtype=torch.bool))
    assert is_near.tolist() == [True, True, False]


@pytest.mark.parametrize(("degrees", "is_within"), [(15.0, True), (18.0, False)])
def test_a_lamp_is_near_to_a_broad_lobe_that_is_about_it(degrees: float, is_within: bool) -> None:
    """Widths of 20 and 3.3 degrees: twice their geometric mean is 16.3 degrees, their sum 23."""
    lamp, sky = on_the_horizon([0.0], 150.0), on_the_horizon([degrees], 0.5)
    both = joined(lamp, sky)
    _, is_near = nearest(both, torch.ones(2, dtype=torch.bool))
    assert is_near.tolist() == [is_within] * 2


@pytest.mark.parametrize("count", [1, 2])
def test_where_none_may_be_it_none_is_near(count: int) -> None:
    lobes = on_the_horizon([0.0] * count, 30.0)
    _, is_near = nearest(lobes, torch.zeros(count, dtype=torch.bool))
    assert not bool(is_near.any())


def test_of_several_frames_each_has_its_own_nearest() -> None:
    places = ([0.0, 3.0, 40.0], [0.0, 50.0, 8.0], [0.0, 80.0, 160.0])
    frames = [on_the_horizon(degrees, 30.0) for degrees in places]
    among = torch.tensor([[True, True, True], [True, False, True], [False, False, True]])
    index, is_near = nearest(stack(frames), among[:, None])
    for frame, lobes in enumerate(frames):
        own_index, own_is_near = nearest(lobes, among[frame])
        assert is_near[frame].tolist() == own_is_near.tolist()
        assert index[frame].tolist() == own_index.tolist()
    assert index[1].tolist()[0] == 2
    assert is_near[:, 0].tolist() == [True, True, False]
