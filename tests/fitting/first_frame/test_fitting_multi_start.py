# SPDX-License-Identifier: Apache-2.0
"""Several starts for one frame: where they are cut, which end is taken, what is reported."""

import itertools
import math
import operator
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
import torch
from lobe_cases import sky_and_sun
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.first_frame import multi_start, reweighting, seeding
from asglight.fitting.first_frame.fit import Level
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import light, newton
from asglight.judging.stress import maps as stress_maps
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import orthonormal

LEVELS = (Level(2, Corners(1.0, 1.0)), Level(4, Corners(0.1, 0.01)))


def _starts() -> tuple[list[Lobes], objective.Target, float]:
    frame = first_frame.exposed(sky_and_sun(30.0, 32))
    cells = seeding.cells(frame.radiance[0].mT.unflatten(0, (32, 64)))
    seeds = [seeding.seed_lobes(cells, 4, Form.ASG, spread) for spread in (math.inf, 4.0, 1.0)]
    return seeds, objective.target(frame.radiance), first_frame.narrowest(32)


def _finish(frame: objective.Target, width_min: float) -> multi_start.Finish:
    def finish(seed: Lobes, weights: Tensor | None, report: newton.OnStep | None) -> newton.Outcome:
        own = frame if weights is None else reweighting.with_weights(frame, weights)
        return first_frame.descend(seed[None], own, own, LEVELS, width_min, report)

    return finish


def _ahead() -> Tensor:
    """Return aims that no error misses."""
    return torch.full((5,), 1e6)


def _made(seeds: list[Lobes]) -> list[Callable[[], Lobes]]:
    """Return calls that each return a start."""
    return [partial(operator.itemgetter(index), seeds) for index in range(len(seeds))]


def test_of_ends_that_do_not_lag_behind_the_one_that_is_lit_best_is_taken() -> None:
    seeds, frame, width_min = _starts()
    finish = _finish(frame, width_min)
    ends = [finish(seed, None, None) for seed in seeds]
    wrong = [float(multi_start.lit_wrong(light.with_amplitudes(end, frame), frame)) for end in ends]
    assert len(set(wrong)) > 1
    found = multi_start.best_end(_made(seeds), finish, frame, _ahead, width_min)
    assert torch.equal(found.found.lobes.amplitude, ends[wrong.index(min(wrong))].lobes.amplitude)


def test_an_end_whose_light_lags_behind_less_comes_before_one_that_is_lit_better() -> None:
    seeds, frame, width_min = _starts()
    found = reweighting.measured(_finish(frame, width_min)(seeds[0], None, None), frame, _ahead())
    near, far = (
        multi_start.End(seeds[0], replace(found, lag=torch.tensor(lag)), wrong)
        for lag, wrong in (([1.5, 0.2, 0.2, 0.9, 0.5], 2.0), ([0.5, 0.2, 0.2, 1.1, 0.5], 1.0))
    )
    assert min(near, far, key=lambda each: each.order) is near  # the map's error can be mended
    assert min(near, far, key=lambda each: each.settled_order) is far


def test_an_end_that_needs_no_mending_comes_before_one_that_is_mended_at_the_cost_of_light(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds, frame, width_min = _starts()
    lit_best = torch.tensor([1.06, 0.2, 0.2, 0.5, 0.5]), 1.0
    keeps_to_all = torch.tensor([0.98, 0.3, 0.3, 0.7, 0.7]), 1.1
    mended = torch.tensor([1.02, 0.5, 0.5, 0.9, 0.9]), 1.5
    told = iter([lit_best, keeps_to_all, mended])
    ends: list[multi_start.End] = []

    def ended(seed: Lobes, end: reweighting.Measured, _: objective.Target) -> multi_start.End:
        lag, wrong = next(told)
        ends.append(multi_start.End(seed, replace(end, lag=lag), wrong))
        return ends[-1]

    monkeypatch.setattr(multi_start, "ended", ended)
    found = multi_start.best_end(
        _made(seeds[:2]), _finish(frame, width_min), frame, _ahead, width_min
    )
    assert len(ends) == 3
    assert found is ends[1].end


def test_of_a_shot_the_nearest_end_is_taken_as_it_is() -> None:
    seeds, frame, width_min = _starts()
    finish = _finish(frame, width_min)
    beyond = torch.tensor([1e6, 1e6, 1e6, 1e-9, 1e6])
    given = _made(seeds), finish, frame, lambda: beyond, width_min
    found = multi_start.best_end(*given, again=2, mends=False)
    ends = [finish(seed, None, None) for seed in seeds]
    lags = [float(reweighting.measured(end, frame, beyond).lag[3]) for end in ends]
    nearest = ends[lags.index(min(lags))]
    assert torch.equal(found.found.lobes.amplitude, nearest.lobes.amplitude)
    mended = multi_start.best_end(*given, again=2)
    assert float(mended.lag[3]) < float(found.lag[3])


def test_the_starts_that_came_nearest_go_once_more_with_what_lags_behind_raised() -> None:
    seeds, frame, width_min = _starts()
    asked: list[tuple[Lobes, Tensor | None]] = []
    usual = _finish(frame, width_min)

    def finish(seed: Lobes, weights: Tensor | None, report: newton.OnStep | None) -> newton.Outcome:
        asked.append((seed, weights))
        return usual(seed, weights, report)

    beyond = torch.tensor([1e6, 1e6, 1e6, 1e-9, 1e6])  # an r0.5 that none comes to
    found = multi_start.best_end(_made(seeds), finish, frame, lambda: beyond, width_min, again=2)
    again = asked[len(seeds) :]
    assert len(again) == 2
    expected = torch.tensor([1.0, 1.0, 1.0, reweighting.FACTOR_MAX, 1.0])
    assert all(torch.equal(weights, expected) for _, weights in again if weights is not None)
    ends = [usual(seed, None, None) for seed in seeds]
    wrong = [float(reweighting.measured(end, frame, beyond).lag[3]) for end in ends]
    assert again[0][0] is seeds[wrong.index(min(wrong))]
    assert float(found.lag[3]) < min(wrong)


def test_no_start_goes_once_more_where_none_shall() -> None:
    seeds, frame, width_min = _starts()
    asked: list[Lobes] = []
    usual = _finish(frame, width_min)

    def finish(seed: Lobes, weights: Tensor | None, report: newton.OnStep | None) -> newton.Outcome:
        assert weights is None
        asked.append(seed)
        return usual(seed, weights, report)

    beyond = torch.tensor([1e6, 1e6, 1e6, 1e-9, 1e6])
    multi_start.best_end(iter(_made(seeds)), finish, frame, lambda: beyond, width_min)
    assert [id(each) for each in asked] == [id(each) for each in seeds]


def test_fits_end_on_finer_leaves() -> None:
    frame = first_frame.exposed(sky_and_sun(30.0, 256))
    fine = first_frame.on_fine_cells(frame)
    usual = objective.target(frame.radiance)
    assert fine.places.share.shape[-1] > 3 * usual.places.share.shape[-1]
    assert first_frame.FAST.again == 0 < first_frame.BEST.again


def test_finer_leaves_see_the_light_of_a_streak_better() -> None:
    generator = torch.Generator().manual_seed(0)
    frame = first_frame.exposed(torch.rand(256, 512, 3, generator=generator))
    axes = orthonormal(torch.randn(40, 3, 3, generator=generator))
    sharpness = torch.tensor([8e4, 2.0]).expand(40, 2)
    streaks = Lobes(axes, sharpness, torch.ones(40, 3), Form.ASG)[None]
    flux = asg.flux(streaks.to(torch.float64))[0, :, 0] / (4 * math.pi)

    def missed(places: AdaptiveCells) -> Tensor:
        shown = lobe_images.images(streaks, places)
        seen = (shown.values * shown.scale[..., None])[0].double() @ places.share[0].double()
        return (seen / flux - 1).abs().mean()

    usual, fine = objective.target(frame.radiance), first_frame.on_fine_cells(frame)
    assert missed(usual.places) > 0.01
    assert missed(fine.places) < 0.7 * missed(usual.places)


def test_an_end_is_judged_with_its_light_solved_as_it_will_be() -> None:
    seeds, frame, width_min = _starts()
    end = first_frame.descend(seeds[0][None], frame, frame, LEVELS, width_min)
    assert end.shown is not None
    lobes = replace(end.lobes, amplitude=1.3 * end.lobes.amplitude)
    brighter = replace(end, lobes=lobes, shown=replace(end.shown, lobes=lobes))
    assert brighter.shown is not None
    sharp = replace(frame, corners=light.CORNERS)
    seen = objective.loss_terms(brighter.shown.radiance, sharp).seen
    # of the thirty percent too much hardly any is left, wherever the solution starts
    unsolved = float(objective.of_materials(seen, sharp))
    wrong = [
        float(multi_start.lit_wrong(light.with_amplitudes(each, frame), frame))
        for each in (end, brighter)
    ]
    assert abs(wrong[1] - wrong[0]) < 0.05 * (unsolved - wrong[0])


def test_the_first_start_alone_reports_its_steps() -> None:
    seeds, frame, width_min = _starts()
    seen: list[Lobes] = []
    finish = _finish(frame, width_min)
    multi_start.best_end(_made(seeds), finish, frame, _ahead, width_min, seen.append)
    alone: list[Lobes] = []
    first_frame.descend(seeds[0][None], frame, frame, LEVELS, width_min, alone.append)
    assert len(seen) == len(alone) > 0
    for reported, expected in zip(seen, alone, strict=True):
        assert torch.equal(reported.axes, expected.axes)


@pytest.mark.parametrize("threads", [2, 5])
def test_the_end_does_not_depend_on_how_many_starts_run_at_once(threads: int) -> None:
    seeds, frame, width_min = _starts()
    beyond = torch.tensor([1e6, 1e6, 1e6, 1e-9, 1e6])  # so that starts go once more
    given = _made(seeds), _finish(frame, width_min), frame, lambda: beyond, width_min
    alone = multi_start.best_end(*given, again=2)
    found = multi_start.best_end(*given, again=2, threads=threads)
    assert torch.equal(found.lit.lobes.axes, alone.lit.lobes.axes)
    assert torch.equal(found.lit.lobes.amplitude, alone.lit.lobes.amplitude)


def test_what_materials_show_wrong_is_j_without_the_map() -> None:
    seeds, frame, _ = _starts()
    shown = newton.minimise(seeds[0][None], frame, 1).shown
    assert shown is not None
    sharp = replace(frame, corners=light.CORNERS)
    found = objective.loss_terms(shown.radiance, sharp)
    # the map's own: the mean of phi over the sphere, cell by cell and texel by texel
    errors = torch.cat([found.parts.mean(1), found.texels], dim=-1)
    own = (sharp.places.share * errors).sum(-1) / sharp.env_scale - light.CORNERS.env
    expected = found.value - objective.ENV_WEIGHT * own
    torch.testing.assert_close(
        objective.of_materials(found.seen, sharp), expected, rtol=0, atol=1e-6
    )


@pytest.mark.parametrize(("spread", "halved"), [(math.inf, "wide"), (1.0, "narrow")])
def test_a_wide_dim_pair_is_cut_before_a_narrow_bright_one_where_spread_counts_in_full(
    spread: float, halved: str
) -> None:
    degrees = torch.tensor([0.0, 4.0, 150.0, 210.0], dtype=torch.float64).deg2rad()
    zero = torch.zeros_like(degrees)
    mean = torch.stack([degrees.cos(), zero, degrees.sin()], dim=-1)
    weight = torch.tensor([0.45, 0.45, 0.05, 0.05], dtype=torch.float64)
    source = seeding.Cells(
        weight[:, None].expand(4, 3), weight, mean, mean[:, :, None] * mean[:, None], 1e-6
    )
    # the first cut parts the pairs; flux times variance is .9 (2 deg)^2 beside .1 (30 deg)^2
    labels = seeding.split(source, 3, spread).tolist()
    assert (labels[2] != labels[3]) == (halved == "wide")
    assert (labels[0] != labels[1]) == (halved == "narrow")


PHI = (1 + math.sqrt(5)) / 2


def _ring(count: int, elevation_deg: float) -> list[tuple[float, float, float]]:
    return [stress_maps.toward(360 * k / count, elevation_deg) for k in range(count)]


@pytest.mark.parametrize(
    "places",
    [
        pytest.param([*torch.eye(3).tolist(), *(-torch.eye(3)).tolist()], id="axes"),
        pytest.param(list(itertools.product((1.0, -1.0), repeat=3)), id="cube"),
        pytest.param(
            [
                place
                for a, b in itertools.product((1.0, -1.0), (PHI, -PHI))
                for place in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))
            ],
            id="icosahedron",
        ),
        pytest.param(_ring(4, 0.0), id="four-around"),
        pytest.param(_ring(8, 17.0), id="eight-around"),
        pytest.param([*_ring(4, 30.0), *_ring(4, -30.0)], id="two-rings"),
    ],
)
def test_lamps_that_stand_alike_start_with_a_lobe_each(
    places: list[tuple[float, float, float]],
) -> None:
    known = stress_maps.lamps(places, 2e3)
    source = seeding.cells(stress_maps.render(known, 128))
    seeds = seeding.seed_lobes(source, len(places), Form.ASG, math.inf)
    cosine = seeds.axis_z.double() @ known.axis_z.double().T
    assert sorted(cosine.argmax(-1).tolist()) == list(range(len(places)))
    assert float(cosine.amax(-1).min()) > math.cos(math.radians(0.5))


def test_a_map_of_one_lit_texel_is_not_cut() -> None:
    one = torch.zeros(8, 16, 3)
    one[2, 5] = 1.0
    assert seeding.split(seeding.cells(one), 3, math.inf).unique().tolist() == [0]
