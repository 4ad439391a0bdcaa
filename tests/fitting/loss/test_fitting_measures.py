# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import lamps, sky_and_sun

from asglight.fitting.first_frame.fit import FAST, fit_first_frame, soft_to_sharp
from asglight.fitting.loss.measures import ALLOWANCE, errors, shown
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes
from asglight.sphere import latlong

BRIEF = replace(FAST, spreads_deg=FAST.spreads_deg[:1], levels=soft_to_sharp(rounds=0)[::2])
"""How good the fits are is of no matter."""


def room(height: int) -> torch.Tensor:
    """Return a dim room with a hard-edged window and two small lamps.  [H, 2 H, 3]."""
    directions = latlong.directions(height, 2 * height)
    x, y, z = directions.unbind(-1)
    window = ((x.abs() < 0.3) & (y.abs() < 0.4) & (z > 0)).float()
    map_ = (0.2 + 0.1 * y + 6 * window)[..., None] * torch.tensor([1.0, 0.95, 0.8])
    for place in ((0.6, 0.7, -0.2), (-0.9, 0.3, 0.1)):
        lamp = torch.nn.functional.normalize(torch.tensor(place), dim=0)
        map_ = map_ + 200 * ((directions @ lamp) > math.cos(0.03)).float()[..., None]
    return map_


@pytest.mark.parametrize(("scene", "count"), [("room", 6), ("sky", 3)])
def test_errors_are_those_of_the_judge(scene: str, count: int) -> None:
    reference = room(128) if scene == "room" else sky_and_sun(40.0, 128) ** 0.8
    fit = fit_first_frame(reference, count, Form.ASG, BRIEF)
    judged = frame_errors(fit.lobes, reference).values
    found = errors(fit.lobes, shown(reference))
    assert found["r0.5"] == pytest.approx(judged["r0.5"], rel=3 * ALLOWANCE)
    # irr is smaller, and sampled on 8 rings: a tenth off where lamps are hard
    assert found["irr"] == pytest.approx(judged["irr"], rel=0.12)


def test_maps_with_fewer_rows_than_the_grid_are_measured_on_their_own() -> None:
    reference = sky_and_sun(40.0, 16)
    fit = fit_first_frame(reference, 2, Form.ASG, BRIEF)
    judged = frame_errors(fit.lobes, reference).values
    found = errors(fit.lobes, shown(reference))
    assert found["r0.5"] == pytest.approx(judged["r0.5"], rel=0.2, abs=3e-3)  # 16 rings of 16 rows


def test_errors_have_no_unit() -> None:
    reference, scene = sky_and_sun(0.0), lamps([(0.0, 1.0, 0.0)], [1.0], [1.0])
    bright = Lobes(scene.axes, scene.sharpness, 1e4 * scene.amplitude, scene.form)
    found = errors(scene, shown(reference))
    assert errors(bright, shown(1e4 * reference)) == pytest.approx(found, rel=1e-4)


def test_a_black_map_has_no_error_or_an_infinite_one() -> None:
    dark = shown(torch.zeros(16, 32, 3))
    lit = lamps([(0.0, 1.0, 0.0)], [4.0], [1.0])
    black = Lobes(lit.axes, lit.sharpness, 0 * lit.amplitude, Form.ASG)
    assert errors(black, dark) == {"irr": 0.0, "r0.5": 0.0}
    assert errors(lit, dark) == {"irr": math.inf, "r0.5": math.inf}
