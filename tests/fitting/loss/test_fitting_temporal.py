# SPDX-License-Identifier: Apache-2.0
"""The temporal term and what it holds; dark lobes."""

import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import DOUBLE, lamps, noise, random_lobes
from torch import Tensor

from asglight.fitting.loss import objective, temporal
from asglight.fitting.loss.adaptive_cells import adaptive_cells
from asglight.fitting.loss.coordinates import UNKNOWNS, advance, is_round
from asglight.fitting.steps import newton
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import stack

PLACES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def test_dark_is_a_share_of_the_flux_of_the_frame() -> None:
    one = lamps(PLACES, [20.0] * 3, [1.0, 1.5e-4, 0.5e-4])
    assert temporal.is_dark(one).tolist() == [False, False, True]
    brighter = Lobes(one.axes, one.sharpness, 1e6 * one.amplitude)
    assert temporal.is_dark(brighter).tolist() == [False, False, True]


def test_blackened_takes_the_light_of_dark_lobes_alone() -> None:
    one = lamps(PLACES, [20.0] * 3, [1.0, 1.5e-4, 0.5e-4])
    found = temporal.blackened(one)
    assert torch.equal(found.amplitude[:2], one.amplitude[:2])
    assert float(found.amplitude[2].max()) == 0.0
    assert torch.equal(found.axes, one.axes)


def _way(lobes: Lobes, held: temporal.Prior) -> Tensor:
    """Return how far each lobe went, in units of itself.  [F, N]."""
    return temporal.displacement(lobes, held).norm(dim=-1)


def test_a_strong_temporal_term_holds_the_lobes() -> None:
    lobes, frame = random_lobes(Form.ASG).to(torch.float32)[None], objective.target(noise())
    free = newton.minimise(lobes, frame, 8).lobes
    held = newton.minimise(lobes, frame, 8, priors=[temporal.prior(lobes, gamma=1e4)]).lobes
    still = temporal.prior(lobes)
    # J of 10 against a spring of 1e4: the ratio, but for how far a lobe's share is from all
    assert float(_way(held, still).max()) < 0.01 < 0.3 < float(_way(free, still).max())


def test_a_strong_temporal_term_draws_lobes_to_where_they_were() -> None:
    before, frame = random_lobes(Form.ASG).to(torch.float32)[None], objective.target(noise())
    held = temporal.prior(before, gamma=1e4)
    away = torch.zeros(1, 5, UNKNOWNS)
    away[..., :2], away[..., 5:] = 0.03, 0.1
    start = advance(before, away)
    found = newton.minimise(start, frame, 15, priors=[held]).lobes
    assert float(_way(start, held).min()) > 0.3
    assert float(_way(found, held).max()) < 0.03


@pytest.mark.parametrize("form", list(Form))
def test_value_is_the_sum_over_lobes_of_share_times_way(form: Form) -> None:
    before = stack([random_lobes(form), random_lobes(form, seed=1)])
    held = temporal.prior(before, gamma=0.7)
    turned = 0.01 * torch.randn(
        2, 5, UNKNOWNS, generator=torch.Generator().manual_seed(5), dtype=DOUBLE
    )
    turned[..., 2:5] = 0
    lobes = advance(before, turned)
    factor = {Form.SG: 1.0, Form.FLAT: 2 * 66 / 85}.get(form, 2.0)
    found = temporal.value(lobes, held)
    for frame in range(2):
        flux = asg.flux(before)[frame].sum(-1)
        expected = 0.0
        for lobe in range(5):
            width = (factor * before.sharpness[frame, lobe]) ** -0.5
            unit = width.clamp(max=temporal.TILT_UNIT_MAX)
            axes = before.axes[frame, lobe]
            tilt = axes[:2] @ lobes.axis_z[frame, lobe] / unit
            light = lobes.amplitude[frame, lobe] - before.amplitude[frame, lobe]
            light = light / before.amplitude[frame, lobe].max()
            square = float(tilt.square().sum() + light.square().sum())
            share = 0.7 * float(flux[lobe] / flux.sum())
            expected += share * math.sqrt(square + temporal.CORNER**2)
        # a tilt turns x by the product of both tilts: 1e-4 of a way of one
        assert float(found[frame]) == pytest.approx(expected, rel=1e-4)


def test_gradient_is_that_of_the_value() -> None:
    held = temporal.prior(stack([random_lobes(Form.ASG), random_lobes(Form.ASG, seed=2)]))
    generator = torch.Generator().manual_seed(5)
    away = 0.05 * torch.randn(2, 5, UNKNOWNS, generator=generator, dtype=DOUBLE)
    away[..., 4] = 0  # a frame that has rolled sees the prior's coordinates rolled
    lobes = advance(held.lobes, away)
    step, found = 1e-5, temporal.slopes(lobes, held)[1].reshape(2, 5, 8)
    assert not bool(is_round(held.lobes)[:, 1].any())  # a round lobe's widths are a shear's
    for unknown in (0, 1, 2, 3, 5, 6, 7):  # their coordinates are the displacement's own
        move = torch.zeros(2, 5, UNKNOWNS, dtype=DOUBLE)
        move[:, 1, unknown] = step
        change = temporal.value(advance(lobes, move), held)
        change = change - temporal.value(advance(lobes, -move), held)
        # second order in the tilt of 0.03 so far: coordinates agree to a percent
        torch.testing.assert_close(change / (2 * step), found[:, 1, unknown], rtol=0.02, atol=2e-5)


def test_term_counts_a_way_as_its_norm() -> None:
    lobes = random_lobes(Form.ASG)[None]
    held = temporal.prior(lobes, gamma=1.0)
    near, far = (replace(lobes, amplitude=lobes.amplitude * grown) for grown in (1.5, 2.0))
    assert float(temporal.value(lobes, held)) == pytest.approx(temporal.CORNER)  # shares sum to 1
    ratio = temporal.value(far, held) / temporal.value(near, held)
    assert float(ratio) == pytest.approx(2.0, rel=2e-3)  # less the corner's square, (0.02 / 0.5)^2


def test_curvature_makes_a_quadratic_above_the_value() -> None:
    held = temporal.prior(stack([random_lobes(Form.BINGHAM), random_lobes(Form.BINGHAM, seed=1)]))
    lobes = advance(held.lobes, torch.full((2, 5, UNKNOWNS), 0.02, dtype=DOUBLE))
    curvature, gradient = temporal.slopes(lobes, held)
    start = temporal.value(lobes, held)
    generator = torch.Generator().manual_seed(1)
    for _ in range(20):
        light = torch.zeros(2, 5, UNKNOWNS, dtype=DOUBLE)
        light[..., 5:] = 0.1 * torch.randn(2, 5, 3, generator=generator, dtype=DOUBLE)
        move = light.flatten(1)
        change = temporal.value(advance(lobes, light), held) - start
        above = (move * gradient).sum(-1)
        above = above + 0.5 * (curvature * move.square()).sum(-1)
        assert bool((change <= above + 1e-12).all())  # float64


def test_the_term_of_a_batch_is_that_of_each_frame_alone() -> None:
    before = stack([random_lobes(Form.SG), random_lobes(Form.SG, seed=1)])
    brighter = replace(
        before, amplitude=before.amplitude * torch.tensor([1.0, 50.0])[:, None, None]
    )
    lobes = advance(brighter, torch.full((2, 5, UNKNOWNS), 0.01, dtype=DOUBLE))
    both = temporal.value(lobes, temporal.prior(brighter))
    for index in range(2):
        one = slice(index, index + 1)
        alone = temporal.value(lobes[one], temporal.prior(brighter[one]))
        torch.testing.assert_close(both[one], alone, rtol=1e-12, atol=0)  # float64


def test_the_term_of_black_lobes_is_finite_and_nothing() -> None:
    black = lamps(PLACES, [20.0] * 3, [0.0] * 3)[None]
    held = temporal.prior(black)
    lit = replace(black, amplitude=torch.ones(1, 3, 3))
    assert float(temporal.value(lit, held)) == 0.0  # of no flux, no share
    curvature, gradient = temporal.slopes(lit, held)
    assert bool(curvature.isfinite().all())
    assert bool(gradient.isfinite().all())


@pytest.mark.parametrize(
    ("form", "exposure"),
    [
        *((Form.ASG, each) for each in (1e-6, 1.0, 1e9)),
        (Form.BINGHAM, 1e-6),
        (Form.SG, 1e9),
        (Form.FLAT, 1.0),
    ],
)
def test_steps_from_any_start_stay_finite_with_the_term(form: Form, exposure: float) -> None:
    sharpness = torch.tensor([1e-3, 0.3, 40.0, 1e4, 1e7])
    light = torch.tensor([0.0, 1e-6, 1.0, 1e4, 1e9])
    pairs = torch.cartesian_prod(sharpness, sharpness, light)  # [F, 3]
    axes = stack([random_lobes(form, 2, seed) for seed in range(len(pairs))]).axes.float()
    widths = pairs[:, None, :1] if form is Form.SG else pairs[:, None, :2]
    lobes = Lobes(axes, widths.expand(-1, 2, 2), pairs[:, None, 2:].expand(-1, 2, 3), form)
    lobes = replace(lobes, amplitude=lobes.amplitude * torch.tensor([[1.0], [0.3]]))
    maps = exposure * noise(32)
    frame = objective.target(maps, places=adaptive_cells(maps, 16, 4)).repeated(len(pairs))
    found = newton.minimise(lobes, frame, 4, priors=[temporal.prior(lobes)])
    everything = (found.value, found.damping, found.lobes.axes)
    for tensor in (*everything, found.lobes.sharpness, found.lobes.amplitude):
        assert bool(tensor.isfinite().all())
    before = newton.minimise(lobes, frame, 0, priors=[temporal.prior(lobes)]).value
    assert bool((found.value <= before).all())
