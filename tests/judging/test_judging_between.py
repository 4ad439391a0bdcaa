# SPDX-License-Identifier: Apache-2.0
"""Light between frames: what is known of it exactly must come out exactly."""

import math

import numpy as np
import pytest
import torch

from asglight.judging import metrics
from asglight.judging.motion import between
from asglight.lobes import Lobes, LobeTracks, frames, texels

HEIGHT = 32

SINGLE = 1e-5
"""Maps are float32."""


def lamp(longitude_deg: float, power: float = 1.0, sharpness: float = 60.0) -> Lobes:
    """Return one round lobe on the horizon."""
    angle = math.radians(longitude_deg)
    axis_z = torch.tensor([[math.sin(angle), 0.0, math.cos(angle)]], dtype=torch.float64)
    amplitude = power * torch.tensor([[3.0, 2.0, 1.0]], dtype=torch.float64)
    return Lobes(frames.axes_around(axis_z), torch.full((1, 2), sharpness).double(), amplitude)


def shot(*lobes: Lobes) -> LobeTracks:
    """Return tracks of every second frame from 1001 on."""
    stacked = Lobes(
        torch.stack([one.axes for one in lobes]),
        torch.stack([one.sharpness for one in lobes]),
        torch.stack([one.amplitude for one in lobes]),
    )
    return LobeTracks(tuple(range(1001, 1001 + 2 * len(lobes), 2)), 24.0, stacked)


def radiance(lobes: Lobes) -> torch.Tensor:
    return texels.texel_means(lobes.to(torch.float32), HEIGHT, 2 * HEIGHT)


def test_a_lamp_that_passes_is_where_it_was_by_the_rule_and_twice_when_dissolved() -> None:
    tracks = shot(lamp(0), lamp(20), lamp(40))
    truth = {1001 + k: radiance(lamp(10 * k)) for k in range(5)}
    found = between.between_errors(tracks, [1002, 1004], truth.__getitem__)
    assert list(found.times) == [1002, 1004]
    assert found.ways == (between.RULE, between.FITS, between.MAPS)
    rule, fits, maps = (found.mean[way] for way in found.ways)
    assert max(rule.values()) < SINGLE
    assert fits["r0.25"] > 0.2
    assert fits == pytest.approx(maps, rel=1e-4)  # the fit is exact at its frames
    assert found.ratios[between.RULE]["r0.25"] < 1e-3


def test_what_a_program_reads_is_judged_beside_it() -> None:
    tracks = shot(lamp(0), lamp(0, power=3))
    truth = {frame: radiance(lamp(0, power=frame - 1000)) for frame in (1001, 1002, 1003)}
    stage = shot(lamp(0, power=2.2)).lobes
    found = between.between_errors(tracks, [1002], truth.__getitem__, stage)
    assert found.mean[between.STAGE]["flux"] == pytest.approx(0.1, rel=1e-3)
    assert found.mean[between.RULE]["flux"] < SINGLE
    assert found.times[1002] == found.mean


def test_dissolving_goes_by_the_share_of_the_time() -> None:
    lobes = [lamp(0, power=1.0), lamp(90, power=4.0)]
    tracks = LobeTracks((10, 14), 24.0, shot(*lobes).lobes)
    truth = {10: radiance(lobes[0]), 14: radiance(lobes[1]), 11: radiance(lamp(30))}
    found = between.between_errors(tracks, [11], truth.__getitem__).mean
    wanted = metrics.map_errors(0.75 * truth[10] + 0.25 * truth[14], truth[11]).values
    wanted = {name: wanted[name] for name in between.METRICS}
    for way in (between.FITS, between.MAPS):
        assert found[way] == pytest.approx(wanted, rel=1e-4)


def test_frames_left_out_lie_between_fitted_ones() -> None:
    assert between.left_out((1001, 1003, 1006), range(999, 1010)) == (1002, 1004, 1005)


def test_a_ratio_over_an_exact_dissolve_is_one_or_infinite() -> None:
    still = {way: dict.fromkeys(between.METRICS, 0.0) for way in between.WAYS}
    assert between.BetweenErrors({2: still}).ratios[between.RULE]["irr"] == 1
    still[between.RULE]["irr"] = 0.1
    assert np.isinf(between.BetweenErrors({2: still}).ratios[between.RULE]["irr"])


def test_a_time_at_the_end_has_no_neighbours() -> None:
    with pytest.raises(ValueError, match="not between 1 and 3"):
        between.neighbours((1, 3), 3)
