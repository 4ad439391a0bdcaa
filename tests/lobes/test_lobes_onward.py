# SPDX-License-Identifier: Apache-2.0
"""Where lobes of the next frame are looked for: on great circles, with the lamp they are on."""

import math

import pytest
import torch

from asglight.lobes import Lobes
from asglight.lobes.frames import axes_around
from asglight.lobes.identity.near import onward


def along(degrees: list[float], light: list[float], up: float = 20.0) -> Lobes:
    """Return lobes of 4 degrees at one elevation: azimuth and light of each."""
    azimuth, elevation = torch.deg2rad(torch.tensor(degrees).double()), math.radians(up)
    level = math.cos(elevation)
    height = torch.full_like(azimuth, math.sin(elevation))
    axis_z = torch.stack([level * azimuth.sin(), height, level * azimuth.cos()], -1)
    amplitude = torch.tensor(light).double()[:, None].expand(-1, 3)
    sharpness = torch.full((len(degrees), 2), 100.0).double()
    return Lobes(axes_around(axis_z), sharpness, amplitude)


def lit(lobes: Lobes) -> torch.Tensor:
    return (lobes.amplitude > 0).any(-1)


def test_a_lobe_goes_on_as_far_on_its_great_circle() -> None:
    earlier, before = along([0.0], [1.0]), along([7.0], [1.0])
    found = onward(before, earlier, lit(earlier))[0]
    a, b = earlier.axis_z[0], before.axis_z[0]
    torch.testing.assert_close(found, 2 * (a @ b) * b - a)


def test_a_new_lobe_turns_with_the_one_beside_it() -> None:
    """About the axis of that one: the angle between both stays."""
    earlier, before = along([0.0, 50.0], [1.0, 0.0]), along([7.0, 11.0], [1.0, 1.0])
    found = onward(before, earlier, lit(earlier))
    assert found.norm(dim=-1).tolist() == pytest.approx([1, 1])
    assert float(found[0] @ found[1]) == pytest.approx(
        float(before.axis_z[0] @ before.axis_z[1]), abs=1e-9
    )
    turned = torch.rad2deg(torch.acos(found[1] @ before.axis_z[1]))
    assert 6 < float(turned) < 7  # seven degrees of azimuth, 20 degrees up


def test_a_new_lobe_by_itself_stays() -> None:
    earlier, before = along([0.0, 50.0], [1.0, 0.0]), along([7.0, 90.0], [1.0, 1.0])
    torch.testing.assert_close(onward(before, earlier, lit(earlier))[1], before.axis_z[1])


def test_the_opposite_direction_is_no_turn_to_go_on_with() -> None:
    earlier = along([0.0], [1.0], up=0.0)
    before = along([180.0], [1.0], up=0.0)
    found = onward(before, earlier, lit(earlier))[0]
    assert bool(found.isfinite().all())
    torch.testing.assert_close(found, before.axis_z[0], atol=1e-6, rtol=0)
