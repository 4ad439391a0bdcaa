# SPDX-License-Identifier: Apache-2.0
"""A lobe that a frame can spare goes dark, pointing to where one lobe stands for two."""

import math

import pytest
import torch
from lobe_cases import angle_deg, follow, lamps
from torch import Tensor

from asglight.fitting import newton, objective, resending
from asglight.fitting.leaves import leaves
from asglight.fitting.options import FitOptions
from asglight.fitting.temporal import waiting
from asglight.fitting.trials import THOROUGH
from asglight.judging.following import jumps
from asglight.lobes import Lobes, asg, texels
from asglight.lobes.data import stack
from asglight.sphere import latlong

LAMP = (1.0, 0.3, 0.0)
FAINT = (-1.0, 0.1, 0.0)
HEIGHT = 64


def _panel(longitude_deg: float, half_deg: tuple[float, float], radiance: float) -> Tensor:
    """Return a black map with one evenly lit rectangle on the horizon.  [H, 2 H, 3]."""
    direction = latlong.directions(HEIGHT, 2 * HEIGHT)
    longitude = torch.rad2deg(torch.atan2(direction[..., 0], direction[..., 2]))
    away = (longitude - longitude_deg + 180) % 360 - 180
    latitude = torch.rad2deg(torch.asin(direction[..., 1]))
    inside = (away.abs() < half_deg[0]) & (latitude.abs() < half_deg[1])
    return radiance * inside[..., None].expand(-1, -1, 3).float()


def _mean(maps: Tensor) -> Tensor:
    """Return the mean radiance over the sphere and RGB."""
    areas = latlong.texel_solid_angles(HEIGHT, 2 * HEIGHT, dtype=torch.float64)
    return ((areas[..., None] * maps).sum() / (12 * math.pi)).float()


def _target(maps: Tensor, rows: int = 32) -> objective.Target:
    """Return a map in units of its mean, on a coarse grid as starts compete on."""
    flat = (maps / _mean(maps)).flatten(0, 1).mT[None].contiguous()
    return objective.target(flat, objective.Corners(0.1, 0.005), leaves(flat, rows, 16))


def _started(frame: objective.Target, lobes: Lobes) -> Lobes:
    return newton.minimise(lobes[None], frame, 30).lobes[0]


def _resent(lobes: Lobes, before: Lobes, frame: objective.Target) -> resending.Resent | None:
    loss = float(newton.minimise(lobes[None], frame, 0).value)
    return resending.resent(lobes, before, frame, loss, 0.0, THOROUGH)


def test_a_drowned_lobe_is_sent_to_the_panel_that_one_lobe_stands_for() -> None:
    # the panel is 50 degrees long, with a sky of a thousandth of its light
    maps = _panel(90.0, (25.0, 5.0), 50.0) + 0.001
    frame = _target(maps)
    fitted = _started(frame, lamps([(1, 0, 0), FAINT], [8.0, 3.0], [20.0, 0.002]))
    going = _resent(fitted, fitted, frame)
    assert going is not None
    assert going.index == 1
    assert float(going.lobe.amplitude.max()) == 0
    assert angle_deg(going.lobe.axis_z[0], torch.tensor([1.0, 0.0, 0.0])) < 25.0


def test_a_lobe_that_is_seen_stays() -> None:
    maps = _panel(90.0, (25.0, 5.0), 50.0) + _panel(-90.0, (5.0, 5.0), 50.0)
    frame = _target(maps)
    fitted = _started(frame, lamps([(1, 0, 0), (-1, 0, 0)], [8.0, 80.0], [20.0, 20.0]))
    assert float(asg.flux(fitted).sum(-1).amin()) > 0.01 * float(asg.flux(fitted).sum())
    assert _resent(fitted, fitted, frame) is None


def test_a_lobe_that_was_seen_a_frame_ago_stays() -> None:
    frame = _target(_panel(90.0, (25.0, 5.0), 50.0) + 0.001)
    fitted = _started(frame, lamps([(1, 0, 0), FAINT], [8.0, 3.0], [20.0, 0.002]))
    before = lamps([(1, 0, 0), FAINT], [8.0, 3.0], [20.0, 10.0])
    assert _resent(fitted, before, frame) is None


def test_nothing_goes_where_the_fit_is_good() -> None:
    truth = lamps([LAMP, FAINT], [80.0, 40.0], [20.0, 0.02])
    frame = _target(texels.texel_means(truth, HEIGHT, 2 * HEIGHT))
    fitted = _started(frame, lamps([LAMP, FAINT], [60.0, 40.0], [20.0, 0.02]))
    assert _resent(fitted, fitted, frame) is None


@pytest.mark.parametrize("lobes", [5, 8])
def test_no_lit_lobe_jumps_when_a_panel_rushes_past(lobes: int) -> None:
    dim = 0.02 * (1 + latlong.directions(HEIGHT, 2 * HEIGHT)[..., 1:2]).expand(-1, -1, 3)
    sizes = [6.0, 7.0, 8.5, 10.5, 13.0, 17.0, 21.0, 25.0]
    maps = [
        dim + _panel(4.0 * index, (size, size / 3), 2.0 * size) for index, size in enumerate(sizes)
    ]
    fits = [fit.lobes for fit in follow(maps, FitOptions(lobes=lobes))]
    shot = waiting(stack(fits))  # as it is written
    assert jumps([shot[frame] for frame in range(len(fits))]) == 0
    for found, reference in zip(fits, maps, strict=True):
        flux = float(asg.flux(found).sum()) / (12 * math.pi)
        assert flux == pytest.approx(float(_mean(reference)), rel=1e-3)
