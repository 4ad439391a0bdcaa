# SPDX-License-Identifier: Apache-2.0
"""Trials in which few lobes move: J is that of all lobes, and the others stay as they are."""

import pytest
import torch
from lobe_cases import angle_deg, flat, lamps

from asglight.fitting.following import trials
from asglight.fitting.loss import objective
from asglight.fitting.steps import newton
from asglight.lobes import Lobes, texels
from asglight.lobes.data import stack

HEIGHT = 64
A, B, C, FAR = (1.0, 0.2, 0.0), (-1.0, 0.5, 0.3), (-0.3, 0.3, 0.9), (0.0, -1.0, 0.1)
TRUTH = lamps([A, B, C, FAR], [80.0, 60.0, 70.0, 3.0], [10.0, 8.0, 7.0, 1.0])
AS_IT_IS = lamps([A, B, FAR, FAR], [75.0, 55.0, 3.2, 20.0], [9.5, 7.5, 0.9, 0.0])
ON_C, ON_A = (
    lamps([A, B, FAR, place], [75.0, 55.0, 3.2, 60.0], [9.5, 7.5, 0.9, 5.0]) for place in (C, A)
)
"""The last lobe is the one in question: dark, on the lamp that no lobe stands for, on another."""


def _frame() -> objective.Target:
    maps = texels.texel_means(TRUTH, HEIGHT, 2 * HEIGHT)
    return objective.trial_target(flat(maps[None]), objective.Corners(0.1, 0.005))


def _competed(companions: int | None) -> tuple[Lobes, torch.Tensor]:
    settings = trials.TrialSettings(3, companions)
    tried = stack([AS_IT_IS, ON_C, ON_A])
    return trials.compete(tried, [3, 3, 3], _frame(), settings, width_min=0.0)


@pytest.mark.parametrize("companions", [1, 2])
def test_the_loss_of_a_trial_is_that_of_all_lobes(companions: int) -> None:
    found, value = _competed(companions)
    wanted = newton.minimise(found, _frame().repeated(3), 0).value
    torch.testing.assert_close(value, wanted, rtol=1e-4, atol=1e-6)  # of float32 sums


def test_only_companions_move() -> None:
    found, _ = _competed(1)
    # the broad lobe below has the least light where the one in question is tried
    assert torch.equal(found.axes[:, 2], stack([AS_IT_IS, ON_C, ON_A]).axes[:, 2])
    assert torch.equal(found.amplitude[:, 2], stack([AS_IT_IS, ON_C, ON_A]).amplitude[:, 2])
    assert bool((found.axes[1, 3] != ON_C.axes[3]).any())


def test_the_place_that_lacks_light_wins() -> None:
    before = newton.minimise(stack([AS_IT_IS, ON_C, ON_A]), _frame().repeated(3), 0).value
    found, value = _competed(2)
    assert int(value.argmin()) == 1
    assert bool((value <= before).all())
    assert float(value[1]) < 0.3 * float(value[0])
    lamp = torch.nn.functional.normalize(torch.tensor(C), dim=0)
    assert float(angle_deg(found.axis_z[1, 3], lamp)) < 3.0


def test_as_many_companions_as_there_are_lobes_are_all() -> None:
    some, value = _competed(3)
    found, wanted = _competed(None)
    assert torch.equal(value, wanted)
    assert torch.equal(some.axes, found.axes)
