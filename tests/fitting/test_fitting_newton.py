# SPDX-License-Identifier: Apache-2.0
"""Columns and gradients against finite differences, steps against scipy, bounds."""

import itertools

import numpy as np
import pytest
import scipy.optimize
import torch
from lobe_cases import DOUBLE, lamps, random_lobes

from asglight.fitting import newton, objective, temporal
from asglight.lobes import Form, Lobes, asg, texels
from asglight.shading import kernels
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions


@pytest.mark.parametrize("form", list(Form))
def test_columns_are_the_derivatives_of_the_lobe_along_each_unknown(form: Form) -> None:
    lobes = random_lobes(form)
    # off the hemisphere's edge, where the asg form has a kink
    directions = fibonacci_directions(200, dtype=DOUBLE)
    directions = directions[((lobes.axis_z @ directions.mT).abs() > 1e-3).all(0)]
    columns = newton.local_columns(lobes, directions)
    step = 1e-5
    for unknown in range(5):
        move = torch.zeros(lobes.count, newton.UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ahead = asg.unit_lobes(newton.advance(lobes, move), directions)
        behind = asg.unit_lobes(newton.advance(lobes, -move), directions)
        # second order in the step: 1e-10 times third derivatives of up to 1e3
        torch.testing.assert_close(
            columns[:, unknown + 1], (ahead - behind) / (2 * step), atol=1e-6, rtol=1e-5
        )


@pytest.mark.parametrize("form", list(Form))
def test_gradient_is_that_of_the_loss(form: Form) -> None:
    lobes = random_lobes(form)
    reference = texels.texel_means(random_lobes(form, seed=1), 32, 64).float()
    frame = objective.target(reference)
    single = lobes.to(torch.float32)
    columns = newton.lobe_columns(single, frame.directions, 32)
    radiance = columns[:: newton.COLUMNS].mT @ single.amplitude
    _, gradient = newton.normal_equations(columns, radiance, single, frame)
    gradient = gradient.reshape(-1, newton.UNKNOWNS)

    def loss(step: torch.Tensor) -> float:
        moved = newton.advance(lobes, step)
        return objective.value(newton.texel_radiance(moved, frame).float(), frame)

    step = 1e-3
    for lobe in range(lobes.count):
        for unknown in range(newton.UNKNOWNS):
            move = torch.zeros(lobes.count, newton.UNKNOWNS, dtype=DOUBLE)
            move[lobe, unknown] = step
            slope = (loss(move) - loss(-move)) / (2 * step)
            # J near 10 is rounded at 1e-6 in float32: the difference quotient at 1e-3
            assert slope == pytest.approx(float(gradient[lobe, unknown]), rel=2e-2, abs=2e-3)


def test_gauss_newton_matrix_is_symmetric_and_positive() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)
    frame = objective.target(texels.texel_means(random_lobes(Form.ASG, seed=1), 32, 64).float())
    columns = newton.lobe_columns(lobes, frame.directions, 32)
    radiance = columns[:: newton.COLUMNS].mT @ lobes.amplitude
    hessian, _ = newton.normal_equations(columns, radiance, lobes, frame)
    torch.testing.assert_close(hessian, hessian.mT, rtol=1e-4, atol=1e-6)
    values = torch.linalg.eigvalsh((hessian + hessian.mT) / 2)
    assert float(values.min()) > -1e-5 * float(values.max())  # float32 sums


def test_minimise_finds_known_lobes_again() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 90.0], [1.0, 8.0, 5.0])
    frame = objective.target(texels.texel_means(truth, 64, 128))
    move = 0.15 * torch.randn(3, newton.UNKNOWNS, generator=torch.Generator().manual_seed(3))
    found = newton.minimise(newton.advance(truth, move), frame, 60, tolerance=0.0).lobes
    assert float((found.axis_z * truth.axis_z).sum(-1).min()) > 1 - 1e-6  # 0.08 degrees
    torch.testing.assert_close(found.sharpness, truth.sharpness, rtol=2e-2, atol=1e-2)
    torch.testing.assert_close(found.amplitude, truth.amplitude, rtol=1e-2, atol=1e-3)


def test_minimise_never_raises_the_loss() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)
    frame = objective.target(torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0)))
    values = [newton.minimise(lobes, frame, steps, tolerance=0.0).value for steps in range(6)]
    assert all(b <= a for a, b in itertools.pairwise(values))


def test_steps_respect_the_bounds() -> None:
    lobes = random_lobes(Form.ASG)
    step = torch.full((lobes.count, newton.UNKNOWNS), -50.0, dtype=DOUBLE)
    moved = newton.advance(lobes, step)
    assert float(moved.amplitude.min()) == 0.0
    assert float(moved.sharpness.min()) >= asg.SHARPNESS_MIN
    turned = torch.arccos((moved.axis_z * lobes.axis_z).sum(-1))
    assert float(turned.max()) < newton.TILT_MAX * 2**0.5
    identity = moved.axes @ moved.axes.mT
    torch.testing.assert_close(identity, torch.eye(3, dtype=DOUBLE).expand_as(identity))
    sharp = newton.advance(lobes, step.abs(), width_min=0.05)
    assert float(texels.lobe_width(sharp).min()) >= 0.05 * (1 - 1e-6)


def test_relight_solves_the_reweighted_problem_as_scipy_does() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)
    reference = texels.texel_means(random_lobes(Form.ASG, seed=2), 16, 32).float()
    frame = objective.target(reference)
    found = newton.relight(lobes, frame, passes=1).amplitude

    values = texels.unit_texel_means(lobes, 16, 32)
    views = objective.probe(values, 16)
    rows, targets = [], []
    for view, truth, weight, corner in [
        (values, frame.radiance, frame.env_weight, frame.env_corner),
        *zip(views, frame.probed, frame.probe_weight, frame.probe_corner, strict=True),
    ]:
        residual = view.mT @ lobes.amplitude - truth
        root = (torch.as_tensor(weight) / objective.phi(residual, corner)).sqrt()[:, None]
        rows.append((root * view.mT).double().numpy())
        targets.append((root * truth).double().numpy())
    expected = np.stack(
        [
            scipy.optimize.nnls(np.concatenate(rows), np.concatenate(targets)[:, channel])[0]
            for channel in range(3)
        ],
        axis=-1,
    )
    # the Gram matrix in float32 loses half the digits of the least squares problem
    np.testing.assert_allclose(found.numpy(), expected, rtol=2e-3, atol=2e-3)


def test_relight_shares_a_change_evenly_between_lobes_that_coincide() -> None:
    lamp = lamps([(1, 0.2, 0)] * 2 + [(0, 1, 0)], [50.0, 50.0, 2.0], [3.0, 1.0, 1.0])
    frame = objective.target(2 * texels.texel_means(lamp, 32, 64))
    amplitude = newton.relight(lamp, frame).amplitude
    expected = torch.tensor([5.0, 3.0, 2.0])[:, None].expand(-1, 3)  # 3 + 1 became 8
    # the Gram matrix is summed in float32, and lobe 2 can stand in for a little of both
    torch.testing.assert_close(amplitude, expected, rtol=5e-3, atol=1e-3)


def test_temporal_gradient_is_that_of_its_value() -> None:
    held = temporal.prior(random_lobes(Form.ASG))
    generator = torch.Generator().manual_seed(5)
    away = 0.05 * torch.randn(5, newton.UNKNOWNS, generator=generator, dtype=DOUBLE)
    away[:, 4] = 0  # a frame that has rolled sees the prior's coordinates rolled
    lobes = newton.advance(held.lobes, away)
    gradient = torch.zeros(40, dtype=DOUBLE)
    temporal.add_curvature(torch.zeros(40, 40, dtype=DOUBLE), gradient, lobes, held)
    step = 1e-5
    for unknown in (0, 1, 5, 6, 7):  # tilt and light: their coordinates are the displacement's own
        move = torch.zeros(5, newton.UNKNOWNS, dtype=DOUBLE)
        move[2, unknown] = step
        ahead = temporal.value(newton.advance(lobes, move), held)
        behind = temporal.value(newton.advance(lobes, -move), held)
        slope = (ahead - behind) / (2 * step)
        # second order in the tilt of 0.03 so far: coordinates agree to a percent
        assert slope == pytest.approx(float(gradient.reshape(5, 8)[2, unknown]), rel=0.02, abs=2e-5)


def test_temporal_term_counts_a_way_as_its_norm() -> None:
    lobes = random_lobes(Form.ASG)
    held = temporal.prior(lobes, gamma=1.0)
    near = Lobes(lobes.axes, lobes.sharpness, lobes.amplitude * 1.5, lobes.form)
    far = Lobes(lobes.axes, lobes.sharpness, lobes.amplitude * 2.0, lobes.form)
    rest = temporal.value(lobes, held)
    assert rest == pytest.approx(temporal.CORNER)  # shares sum to 1
    assert temporal.value(far, held) / temporal.value(near, held) == pytest.approx(2.0, rel=2e-3)


def test_perfect_fit_has_no_loss_and_black_has_all_of_it() -> None:
    reference = torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0))
    frame = objective.target(reference)
    assert objective.value(reference.reshape(-1, 3), frame) == pytest.approx(0.0, abs=1e-5)
    black = objective.value(torch.zeros(32 * 64, 3), frame)
    most = objective.ENV_WEIGHT + sum(probe.weight for probe in objective.PROBES)
    assert 0.8 * most < black < most  # less the rounded corners


def test_going_dark_costs_more_flux_than_everything_else_can_gain() -> None:
    others = [p.weight for p in objective.PROBES if p.kernel != kernels.EVEN]
    (even,) = (p for p in objective.PROBES if p.kernel == kernels.EVEN)
    dark = even.weight * ((1 + even.corner**2) ** 0.5 - even.corner)
    assert dark > objective.ENV_WEIGHT + sum(others)


def test_probe_is_the_kernel_filter_of_the_map() -> None:
    reference = torch.rand(64, 128, 3, generator=torch.Generator().manual_seed(0)) ** 4
    views = objective.probe(reference.reshape(-1, 3).mT, 64)
    for probe, view in zip(objective.PROBES, views, strict=True):
        coarse = latlong.reduce(reference, probe.height, 2 * probe.height)
        directions = fibonacci_directions(probe.directions)
        expected = kernels.filtered(coarse[None], probe.kernel, directions, normalised=True)[0]
        torch.testing.assert_close(view.mT, expected, rtol=1e-4, atol=1e-5)
