# SPDX-License-Identifier: Apache-2.0
"""Which lobe is beside another on one lamp."""

import torch

from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.near import beside

LAMP, SKY = 200.0, 2.0
"""Sharpness: sigmas of 2.9 and 29 degrees."""


def on_the_horizon(degrees: list[float], sharpness: list[float], light: list[float]) -> Lobes:
    angle = torch.deg2rad(torch.tensor(degrees))
    axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
    shape = torch.tensor(sharpness)[:, None].expand(-1, 2)
    return Lobes(axes_around(axis_z), shape, torch.tensor(light)[:, None].expand(-1, 3))


def found(lobes: Lobes, among: list[bool]) -> list[int | None]:
    index, is_there = beside(lobes[None], torch.tensor([among]))
    return [
        one if is_one else None
        for one, is_one in zip(index[0].tolist(), is_there[0].tolist(), strict=True)
    ]


def test_the_nearest_of_those_asked_for_on_the_same_lamp_is_found() -> None:
    lobes = on_the_horizon([0.0, 3.0, 7.0, 60.0], [LAMP] * 4, [1.0] * 4)
    assert found(lobes, [True] * 4) == [1, 0, 1, None]
    assert found(lobes, [True, False, True, True]) == [2, 0, 0, None]


def test_a_lamp_is_not_beside_the_sky_about_it() -> None:
    lobes = on_the_horizon([0.0, 1.0, 30.0], [LAMP, SKY, SKY], [30.0, 0.3, 0.3])
    assert found(lobes, [True] * 3) == [None] * 3


def test_two_lamps_with_something_dark_between_them_are_not_beside_each_other() -> None:
    lobes = on_the_horizon([0.0, 20.0], [LAMP] * 2, [1.0] * 2)
    assert found(lobes, [True] * 2) == [None, None]


def test_a_black_lobe_is_beside_none() -> None:
    lobes = on_the_horizon([0.0, 1.0, 2.0], [LAMP] * 3, [1.0, 0.0, 1.0])
    assert found(lobes, [True] * 3) == [2, None, 0]
    assert found(lobes, [False] * 3) == [None] * 3


def test_every_frame_has_its_own_lamps() -> None:
    frames = [on_the_horizon(each, [LAMP] * 2, [1.0] * 2) for each in ([0.0, 3.0], [0.0, 30.0])]
    _, is_there = beside(stack(frames), torch.ones(2, 2, dtype=torch.bool))
    assert is_there.tolist() == [[True, True], [False, False]]
