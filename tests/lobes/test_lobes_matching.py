# SPDX-License-Identifier: Apache-2.0
"""Which lobe of a frame is which lobe of the frame before."""

import itertools

import torch

from asglight.lobes import Lobes
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.matching import flux_shares, matched


def on_horizon(degrees: list[float], light: list[float]) -> Lobes:
    """Return equally wide grey lobes on the horizon."""
    angle = torch.deg2rad(torch.tensor(degrees))
    axis_z = torch.stack([angle.cos(), torch.zeros_like(angle), angle.sin()], -1)
    grey = torch.tensor(light)[:, None].expand(-1, 3)
    return Lobes(axes_around(axis_z), torch.full((len(light), 2), 50.0), grey)


def test_shares_are_those_of_the_light_and_nothing_where_all_is_dark() -> None:
    torch.testing.assert_close(
        flux_shares(on_horizon([0, 90], [1.0, 3.0])), torch.tensor([0.25, 0.75])
    )
    assert flux_shares(on_horizon([0, 90], [0.0, 0.0])).tolist() == [0, 0]


def test_the_order_is_that_of_the_least_turn_weighed_by_light_of_all_orders() -> None:
    before = on_horizon([0, 40, 100, 250], [1.0, 4.0, 2.0, 3.0])
    after = on_horizon([240, 35, 120, 10], [3.0, 1.0, 4.0, 2.0])
    found = matched(after, before)

    def turn(lobes: Lobes) -> float:
        angle = (before.axis_z * lobes.axis_z).sum(-1).clamp(-1, 1).arccos()
        return float((angle * torch.maximum(flux_shares(before), flux_shares(lobes))).sum())

    every = [after.select(torch.tensor(order)) for order in itertools.permutations(range(4))]
    assert turn(found) <= min(turn(lobes) for lobes in every) + 1e-6
