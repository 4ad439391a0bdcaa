# SPDX-License-Identifier: Apache-2.0
"""Split and merge finds the share of lobes that each lamp needs."""

import pytest
import torch
from lobe_cases import DOUBLE, lamps, random_lobes
from torch import Tensor

from asglight.fitting.first_frame import split_merge
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.adaptive_cells import adaptive_cells
from asglight.fitting.steps import equations, newton
from asglight.lobes import Form, Lobes, asg, texels

TWO = [(1.0, 0.0, 0.2), (1.0, 0.0, -0.5)]
ALONE = (-1.0, 0.3, 0.0)


def three_lamps() -> Lobes:
    return lamps([*TWO, ALONE], [80.0, 60.0, 40.0], [5.0, 6.0, 3.0])


def _map(truth: Lobes, height: int = 64) -> Tensor:
    return texels.texel_means(truth, height, 2 * height).flatten(0, 1).mT[None].contiguous()


def misplaced() -> tuple[Lobes, objective.Target]:
    """Return two lobes on one lamp and one between two lamps, and the map."""
    truth = three_lamps()
    start = lamps([(1.0, 0.0, -0.15), ALONE, (-1.0, 0.32, 0.02)], [20.0, 40.0, 40.0], [5, 1.5, 1.5])
    return start[None], objective.target(_map(truth))


def _nearest(lobes: Lobes, wanted: list[tuple[float, float, float]]) -> float:
    """Return the cosine between the worst served lamp and the lobe nearest to it."""
    lamp = torch.nn.functional.normalize(torch.tensor(wanted), dim=-1)
    return float((lobes.axis_z[0] @ lamp.mT).amax(0).min())


@pytest.mark.parametrize("few", [False, True])
def test_a_lobe_goes_from_where_two_stand_to_where_one_stands_for_two(few: bool) -> None:
    start, frame = misplaced()
    stuck = newton.minimise(start, frame, 40)
    coarse = objective.trial_target(_map(three_lamps())) if few else frame
    assert (coarse.radiance.shape[-1] < frame.radiance.shape[-1] / 3) == few
    found = split_merge.split_and_merge(stuck, frame, coarse, 6, 0.0)
    assert float(found.value) < 0.05 * float(stuck.value)
    assert _nearest(stuck.lobes, [*TWO, ALONE]) < 0.99
    assert _nearest(found.lobes, [*TWO, ALONE]) > 0.999  # 2.5 degrees


def test_a_useless_lobe_is_put_to_use() -> None:
    _, frame = misplaced()
    # the third is black and below the horizon, out of sight of every lamp
    start = lamps([(1.0, 0.0, -0.15), ALONE, (0.0, -1.0, 0.0)], [20.0, 40.0, 500.0], [5, 3, 0])
    stuck = newton.minimise(start[None], frame, 40)
    assert float(asg.flux(stuck.lobes)[0, 2].sum()) < 1e-3 * float(asg.flux(stuck.lobes).sum())
    found = split_merge.split_and_merge(stuck, frame, frame, 6, 0.0)
    assert float(found.value) < 0.05 * float(stuck.value)
    assert _nearest(found.lobes, [*TWO, ALONE]) > 0.999  # 2.5 degrees


def test_it_never_gives_back_a_worse_fit() -> None:
    start, frame = misplaced()
    state = newton.minimise(start, frame, 3)
    values = [
        float(split_merge.split_and_merge(state, frame, frame, rounds, 0.0).value)
        for rounds in (0, 1, 2)
    ]
    assert values[0] <= float(state.value)
    assert values[2] <= values[1] <= values[0]


def test_it_reports_every_state_that_it_keeps_the_last_one_is_its_result() -> None:
    start, frame = misplaced()
    seen: list[Lobes] = []
    found = split_merge.split_and_merge(
        newton.minimise(start, frame, 3), frame, frame, 6, 0.0, seen.append
    )
    images = [lobe_images.images(lobes, frame.places).radiance for lobes in seen]
    values = [float(objective.value(image, frame)) for image in images]
    assert len(values) > split_merge.SETTLING_STEPS  # rounds were kept as well
    assert values == sorted(values, reverse=True)
    assert torch.equal(seen[-1].axes, found.lobes.axes)
    assert torch.equal(seen[-1].amplitude, found.lobes.amplitude)


@pytest.mark.parametrize("form", list(Form))
def test_it_never_gives_back_a_worse_fit_of_noise(form: Form) -> None:
    maps = torch.rand(1, 3, 2 * 64**2, generator=torch.Generator().manual_seed(0)) ** 4
    frame = objective.target(maps, places=adaptive_cells(maps, 32, 16))
    state = newton.minimise(random_lobes(form, 4).to(torch.float32)[None], frame, 5)
    found = split_merge.split_and_merge(state, frame, frame, 2, 0.02)
    assert float(found.value) <= float(state.value)
    shown = lobe_images.images(found.lobes, frame.places).radiance
    # what it reports is the loss of what it returns: the same sums, another batch
    assert float(objective.value(shown, frame)) == pytest.approx(float(found.value), rel=1e-5)
    assert found.lobes.axes.shape == (1, 4, 3, 3)
    assert float(texels.lobe_width(found.lobes).min()) >= 0.02 * (1 - 1e-6)


def test_the_lobe_that_costs_nothing_is_the_one_that_stands_in_for_another() -> None:
    start, frame = misplaced()
    lobes = newton.minimise(start, frame, 40).lobes
    costs, _ = split_merge.leave_one_out_costs(lobe_images.images(lobes, frame.places), frame)
    assert float(costs[1:].min()) < 0.1 * float(costs[0])


def test_each_lobe_is_halved_for_each_of_the_cheapest_worst_ones_first() -> None:
    lobes = random_lobes(Form.ASG, 7).to(torch.float32)[None]
    frame = objective.target(_map(three_lamps()))
    shown = lobe_images.images(lobes, frame.places)
    costs = torch.tensor([6.0, 1.0, 5.0, 2.0, torch.inf, 3.0, 4.0])
    splits = split_merge.ordered(shown, frame, costs)
    assert len(set(splits)) == len(splits) == 7 * split_merge.GONE_MAX * 2
    ascending = [1, 3, 5, 6, 2, 0]
    for lobe in range(7):
        own = [split for split in splits if split.lobe == lobe]
        expected = [index for index in ascending if index != lobe][: split_merge.GONE_MAX]
        assert [split.gone for split in own[::2]] == expected
        assert [split.axis for split in own] == [0, 1] * split_merge.GONE_MAX
    early = splits[: 2 * split_merge.GONE_STEP]
    assert all(s.gone == (1 if s.lobe != 1 else 3) for s in early)
    assert len({s.lobe for s in early}) == split_merge.GONE_STEP
    # how much of J lies on each: its share of the light at an adaptive cell, of all that lies there
    error = objective.per_cell_loss(shown.radiance, frame)[0].double()
    light = (shown.values[0] * lobes.amplitude[0].sum(-1, keepdim=True)).double()
    lies = (light / light.sum(0) * error).nansum(-1)
    assert [s.lobe for s in early[::2]] == lies.argsort(descending=True)[: len(early) // 2].tolist()


def test_absence_costs_are_those_of_the_quadratic_without_the_lobe() -> None:
    start, frame = misplaced()
    shown = lobe_images.images(start, frame.places)
    found = objective.loss_gradient(shown.radiance, frame)
    hessian = equations.normal_equations(shown, found, frame)[0][0]
    root = torch.diagonal(hessian).clamp(min=1e-12 * float(torch.diagonal(hessian).max())).sqrt()
    hessian = hessian + split_merge.RIDGE * torch.diag(root.square())
    costs, filled = split_merge.leave_one_out_costs(shown, frame)
    for lobe in range(3):
        dark = torch.arange(8 * lobe + 5, 8 * lobe + 8)
        others = torch.tensor([i for i in range(24) if i not in set(dark.tolist())])
        # -a for the lobe's light, and of all other unknowns the best: least squares in float64
        step = torch.zeros(24, dtype=DOUBLE)
        step[dark] = -start.amplitude[0, lobe].double()
        pull = hessian[others][:, dark] @ step[dark]
        step[others] = -torch.linalg.lstsq(hessian[others][:, others], pull).solution
        expected = float(step @ hessian @ step) / 2
        # H is symmetric to float32 alone, and conditioned to a thousand by the ridge
        assert float(costs[lobe]) == pytest.approx(expected, rel=2e-3)
        torch.testing.assert_close(filled[lobe].flatten()[dark], step[dark], rtol=1e-9, atol=1e-12)
        missed = (filled[lobe].flatten() - step) * root
        assert float(missed.norm()) < 2e-3 * float((step * root).norm())


def test_a_single_lobe_is_left_alone() -> None:
    _, frame = misplaced()
    alone = newton.minimise(lamps([ALONE], [40.0], [3.0])[None], frame, 3)
    assert split_merge.split_and_merge(alone, frame, frame, 5, 0.0) is alone


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("axis", [0, 1])
def test_halves_of_a_narrow_lobe_keep_its_flux_and_middle(form: Form, axis: int) -> None:
    lobes = random_lobes(form, count=3)
    narrow = Lobes(lobes.axes, lobes.sharpness + 300, lobes.amplitude, form)
    halves = split_merge.halved(narrow, 0, 2, axis)
    before, after = asg.flux(narrow)[0], asg.flux(halves)[[0, 2]].sum(0)
    # an sg half is narrower along both axes, and loses 1 - sqrt(1 - 0.36) of the flux; for all,
    # the sphere bends by a percent within so narrow a lobe
    kept = 0.8 if form is Form.SG else 1.0
    assert after.tolist() == pytest.approx((kept * before).tolist(), rel=0.01)
    middle = torch.nn.functional.normalize(halves.axis_z[[0, 2]].sum(0), dim=0)
    assert float(middle @ narrow.axis_z[0]) > 1 - 1e-9
    apart = halves.axis_z[0] - halves.axis_z[2]
    apart = torch.nn.functional.normalize(apart, dim=0)
    # they lie along the axis
    assert float(apart @ narrow.axes[0, axis]) == pytest.approx(1.0, abs=1e-9)
    assert torch.equal(halves.axes[1], narrow.axes[1])
