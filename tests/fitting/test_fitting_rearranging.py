# SPDX-License-Identifier: Apache-2.0
"""Where light changes too hard to be followed, lobes go at once to where it is."""

import itertools
import math

import pytest
import torch
from lobe_cases import angle_deg, follow, lamps, sky_and_sun
from torch import Tensor

from asglight.fitting import following, newton, objective, rearranging, regroup
from asglight.fitting.coordinates import Leash
from asglight.fitting.leaves import leaves
from asglight.fitting.options import FitOptions, Preset
from asglight.judging import stress_maps
from asglight.judging.following import jumps
from asglight.judging.metrics import frame_errors
from asglight.lobes import Lobes, asg, texels

HEIGHT = 64

STILL = [(0.0, 1.0, 0.1), (1.0, 0.3, 0.0), (0.2, 0.1, -1.0), (-0.4, -1.0, 0.3)]
"""A sky, two lamps and the ground, which do not change."""


def shown(directions: list[tuple[float, float, float]], light: list[float]) -> Tensor:
    """Return the map of `STILL` and of lamps of sharpness 60 in these directions.  [H, 2 H, 3]."""
    sharpness = [1.0, 80.0, 120.0, 2.0, *[60.0] * len(directions)]
    scene = lamps([*STILL, *directions], sharpness, [1.0, 12.0, 15.0, 0.4, *light])
    return texels.texel_means(scene, HEIGHT, 2 * HEIGHT)


def at(longitude_deg: float) -> tuple[float, float, float]:
    """Return a direction 45 degrees above the horizon."""
    angle = math.radians(longitude_deg)
    return (math.sin(angle), 1.0, math.cos(angle))


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
@pytest.mark.parametrize("step_deg", [40.0, 90.0])
def test_a_lamp_that_turns_further_than_a_leash_is_lit_in_every_frame(
    step_deg: float, preset: Preset
) -> None:
    maps = [shown([at(step_deg * frame)], [60.0]) for frame in range(5)]
    fits = follow(maps, FitOptions(6, preset))
    for fit, reference in zip(fits, maps, strict=True):
        errors = frame_errors(fit.lobes, reference).values
        assert errors["r0.5"] < 0.03  # a lamp that is not lit at all costs 0.5 and more
        assert errors["irr"] < 0.01


@pytest.mark.parametrize("preset", [Preset.LIVE, Preset.FAST])
def test_a_camera_that_turns_by_45_degrees_a_frame_costs_no_light(preset: Preset) -> None:
    """No few lobes that go make up for all that are elsewhere: such a frame starts from nothing."""
    day = stress_maps.sun_and_sky()
    maps = [stress_maps.turned(day, 45.0 * frame) for frame in range(3)]
    for fit, reference in zip(follow(maps, FitOptions(preset=preset)), maps, strict=True):
        assert frame_errors(fit.lobes, reference).values["irr"] < 2e-3


def test_no_more_lobes_jump_than_are_sent() -> None:
    maps = [shown([at(90.0 * frame)], [60.0]) for frame in range(5)]
    fits = [fit.lobes for fit in follow(maps, FitOptions(8))]
    for pair in itertools.pairwise(fits):
        assert 0 < jumps(pair) <= rearranging.ROUNDS


def test_lamps_that_are_switched_off_and_on_cost_no_light() -> None:
    away = [at(200.0), at(230.0), at(260.0)]
    on, off = shown(away, [90.0, 60.0, 80.0]), shown(away, [0.0, 0.0, 0.0])
    maps = [on, on, off, off, off, on, on]
    fits = follow(maps, FitOptions(7))
    for fit, reference in zip(fits, maps, strict=True):
        assert frame_errors(fit.lobes, reference).values["r0.5"] < 0.02


def test_no_lit_lobe_jumps_where_a_frame_is_followed_well() -> None:
    for step_deg in (3.0, 9.0):
        fits = follow([sky_and_sun(step_deg * frame) for frame in range(4)], FitOptions(5))
        assert [jumps([a.lobes, b.lobes]) for a, b in itertools.pairwise(fits)] == [0, 0, 0]


def test_a_still_map_that_lobes_cannot_show_is_not_fitted_again_and_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    generator = torch.Generator().manual_seed(0)
    spots = 20 * torch.rand(HEIGHT, 2 * HEIGHT, 1, generator=generator).expand(-1, -1, 3) ** 8
    begin = follow([spots], FitOptions(2))[0]
    assert begin.loss > following.DOUBT_LOSS
    fitted: list[object] = []
    monkeypatch.setattr(following, "rearranged", lambda *args: fitted.append(args))
    monkeypatch.setattr(following, "fit_first_frame", lambda *args: fitted.append(args))
    following.fit_next_frame(1.01 * spots, begin.lobes)
    assert not fitted


def _fitted(lobes: Lobes, reference: Tensor) -> tuple[Lobes, objective.Target, Leash]:
    """Return lobes after some steps, the map on few leaves, and a leash at those lobes."""
    mean = float(reference.mean())
    flat = (reference / mean).flatten(0, 1).mT[None].contiguous()
    frame = objective.target(flat, objective.Corners(0.1, 0.005), leaves(flat, 32, 16))
    begin = Lobes(lobes.axes, lobes.sharpness, lobes.amplitude / mean)
    found = newton.minimise(begin[None], frame, 30).lobes[0]
    return found, frame, Leash(found.axis_z, torch.full((found.count,), 0.98))


def test_the_lobe_that_is_missed_least_goes_to_the_lamp_and_is_let_off_its_leash() -> None:
    two = [(0.0, 1.0, 0.1), (1.0, 0.3, 0.0)]
    reference = texels.texel_means(
        lamps([*two, at(200.0)], [1.0, 80.0, 60.0], [1.0, 12.0, 40.0]), HEIGHT, 2 * HEIGHT
    )
    start = lamps([*two, (1.0, 0.25, 0.05)], [1.0, 80.0, 80.0], [1.0, 6.0, 6.0])
    both = texels.texel_means(start, HEIGHT, 2 * HEIGHT)
    fitted, _, leash = _fitted(start, both)  # two lobes on one lamp
    _, frame, _ = _fitted(start, reference)
    there = rearranging.rearranged(fitted, frame, leash, 0.0)
    assert there is not None
    (gone,) = torch.nonzero(there.leash.cosine < 0).flatten().tolist()
    assert gone in (1, 2)
    wanted = torch.nn.functional.normalize(torch.tensor(at(200.0)), dim=0)
    assert angle_deg(there.lobes.axis_z[0, gone], wanted) < 5.0


def test_no_lobe_goes_where_the_fit_is_good() -> None:
    known = lamps([*STILL, at(100.0)], [1.0, 80.0, 120.0, 2.0, 60.0], [1.0, 12.0, 15.0, 0.4, 60.0])
    fitted, frame, leash = _fitted(known, texels.texel_means(known, HEIGHT, 2 * HEIGHT))
    assert rearranging.rearranged(fitted, frame, leash, 0.0) is None


def test_without_one_lobe_the_others_make_up_for_it() -> None:
    pair = lamps([(1, 0, 0), (1, 0.02, 0), (-1, 0, 0)], [50.0, 50.0, 30.0], [5.0, 5.0, 8.0])
    fitted, frame, _ = _fitted(pair, texels.texel_means(pair, HEIGHT, 2 * HEIGHT))
    outcome = newton.minimise(fitted[None], frame, 1)
    assert outcome.shown is not None
    _, filled = regroup.absences(outcome.shown, frame)
    rest = regroup.without(1, outcome.lobes[0], filled, 0.0)
    assert float(rest.amplitude[1].max()) == 0
    before, after = (asg.flux(lobes).sum(-1) for lobes in (outcome.lobes[0], rest))
    assert float(after[0]) == pytest.approx(float(before[:2].sum()), rel=0.1)
    assert float(after[2]) == pytest.approx(float(before[2]), rel=0.01)


def test_a_single_lobe_goes_to_the_only_lamp() -> None:
    alone = [lamps([at(degrees)], [60.0], [40.0]) for degrees in (0.0, 120.0)]
    here, there = (texels.texel_means(each, HEIGHT, 2 * HEIGHT) for each in alone)
    fits = follow([here, there], FitOptions(1))
    wanted = torch.nn.functional.normalize(torch.tensor(at(120.0)), dim=0)
    assert angle_deg(fits[1].lobes.axis_z[0], wanted) < 1.0
    assert frame_errors(fits[1].lobes, there).values["r0.5"] < 0.01
