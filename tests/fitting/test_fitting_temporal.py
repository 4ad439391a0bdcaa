# SPDX-License-Identifier: Apache-2.0
"""Dark lobes wait where they will be lit; the leash holds lit ones."""

import math

import torch
from lobe_cases import lamps

from asglight.fitting import temporal
from asglight.fitting.coordinates import Leash
from asglight.lobes import Lobes
from asglight.lobes.data import stack

PLACES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def shot(places: list[int], light: list[float]) -> Lobes:
    """Return two lobes over frames: one that stands, one with a place and a light each frame."""
    frames = [
        lamps([PLACES[2], PLACES[place]], [20.0, 20.0], [1.0, lit])
        for place, lit in zip(places, light, strict=True)
    ]
    return stack(frames)


def directions(lobes: Lobes) -> list[int]:
    """Return the index of the place that the second lobe points at, frame by frame."""
    return (lobes.axis_z[:, 1] @ torch.tensor(PLACES).mT).argmax(-1).tolist()


def test_a_lobe_turns_between_two_dark_frames() -> None:
    lobes = shot([0, 0, 0, 0, 1, 1], [1.0, 1.0, 0.0, 0.0, 1.0, 1.0])
    assert directions(temporal.waiting(lobes)) == [0, 0, 0, 1, 1, 1]


def test_a_lobe_that_is_dark_at_first_waits_from_the_first_frame_on() -> None:
    lobes = shot([0, 0, 1, 1], [0.0, 0.0, 1.0, 1.0])
    assert directions(temporal.waiting(lobes)) == [1, 1, 1, 1]


def test_a_lobe_that_stays_dark_and_a_lit_one_are_left_alone() -> None:
    stays = shot([0, 0, 1, 2], [1.0, 0.0, 0.0, 0.0])
    assert directions(temporal.waiting(stays))[:2] == [0, 0]
    lit = shot([0, 1, 0, 1], [1.0, 1.0, 1.0, 1.0])
    assert directions(temporal.waiting(lit)) == [0, 1, 0, 1]


def test_waiting_changes_directions_only() -> None:
    lobes = shot([0, 0, 0, 1], [1.0, 0.0, 0.0, 1.0])
    waited = temporal.waiting(lobes)
    assert torch.equal(waited.amplitude, lobes.amplitude)
    assert torch.equal(waited.sharpness, lobes.sharpness)


def test_dark_is_a_share_of_the_flux_of_the_frame() -> None:
    one = lamps(PLACES, [20.0] * 3, [1.0, 1.5e-4, 0.5e-4])
    assert temporal.is_dark(one).tolist() == [False, False, True]
    brighter = Lobes(one.axes, one.sharpness, 1e6 * one.amplitude)
    assert temporal.is_dark(brighter).tolist() == [False, False, True]


def test_leash_pulls_back_to_its_angle_and_lets_the_free_go() -> None:
    at = torch.tensor([[0.0, 0.0, 1.0]]).expand(3, 3)
    leash = Leash(at, torch.tensor([math.cos(0.2), math.cos(0.2), -1.0]))
    wanted = torch.tensor([0.1, 0.5, 3.0])
    going = torch.stack([wanted.sin(), torch.zeros(3), wanted.cos()], dim=-1)
    held = leash.hold(going)
    angle = torch.atan2(held[:, 0], held[:, 2])
    # 1e-6: float32 sines
    torch.testing.assert_close(angle, torch.tensor([0.1, 0.2, 3.0]), rtol=0, atol=1e-6)
    torch.testing.assert_close(held.norm(dim=-1), torch.ones(3))
