# SPDX-License-Identifier: Apache-2.0
"""The gradient against differences, the matrix against a dense sum; minima; the temporal term."""

import itertools
import math

import pytest
import torch
from lobe_cases import DOUBLE, lamps, random_lobes

from asglight.fitting import lobe_images, newton, objective, temporal
from asglight.fitting.coordinates import UNKNOWNS, advance
from asglight.fitting.grid import grid
from asglight.fitting.probes import probe
from asglight.lobes import Form, Lobes, texels
from asglight.sphere import latlong


def _frame(height: int = 32) -> objective.Target:
    """Return a map of noise with a few bright texels."""
    generator = torch.Generator().manual_seed(0)
    return objective.target(5 * torch.rand(height, 2 * height, 3, generator=generator) ** 4)


def _equations(lobes: Lobes, frame: objective.Target) -> tuple[torch.Tensor, torch.Tensor]:
    return newton.normal_equations(lobe_images.images(lobes.to(torch.float32), frame.grid), frame)


def _loss(lobes: Lobes, frame: objective.Target) -> float:
    radiance = lobe_images.images(lobes.to(torch.float32), frame.grid).radiance
    return float(objective.value(radiance, frame))


def _assert_gradient_is_that_of_the_loss(lobes: Lobes, frame: objective.Target) -> None:
    gradient = _equations(lobes, frame)[1].reshape(-1, UNKNOWNS)
    step = 1e-3
    for lobe, unknown in itertools.product(range(lobes.count), range(UNKNOWNS)):
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[lobe, unknown] = step
        slope = (_loss(advance(lobes, move), frame) - _loss(advance(lobes, -move), frame)) / (
            2 * step
        )
        # J near 10 is rounded at 1e-6 in float32: the difference quotient at 1e-3; lobes of a few
        # texels are sampled in one and averaged in the other, (1 / 2)^2 / 24 and more
        assert slope == pytest.approx(float(gradient[lobe, unknown]), rel=2e-2, abs=2e-3)


@pytest.mark.parametrize("form", list(Form))
def test_gradient_is_that_of_the_loss(form: Form) -> None:
    frame = objective.target(texels.texel_means(random_lobes(form, seed=1), 32, 64).float())
    _assert_gradient_is_that_of_the_loss(random_lobes(form), frame)


@pytest.mark.parametrize("form", list(Form))
def test_gradient_of_narrow_lobes_is_that_of_the_loss(form: Form) -> None:
    narrow = random_lobes(form, count=2, seed=3)
    width = torch.tensor([[0.5], [1.1]], dtype=DOUBLE) * math.pi / 128
    sharpness = torch.tensor([1.0, 1.0 if form is Form.SG else 0.3], dtype=DOUBLE) / (2 * width**2)
    frame = objective.target(texels.texel_means(random_lobes(form, seed=1), 128, 256).float())
    light = 20 * narrow.amplitude
    _assert_gradient_is_that_of_the_loss(Lobes(narrow.axes, sharpness, light, form), frame)


def test_gauss_newton_matrix_is_symmetric_and_positive() -> None:
    frame = objective.target(texels.texel_means(random_lobes(Form.ASG, seed=1), 32, 64).float())
    hessian, _ = _equations(random_lobes(Form.ASG), frame)
    torch.testing.assert_close(hessian, hessian.mT, rtol=1e-4, atol=1e-6)
    values = torch.linalg.eigvalsh((hessian + hessian.mT) / 2)
    assert float(values.min()) > -1e-5 * float(values.max())  # float32 sums


def _dense_matrix(lobes: Lobes, frame: objective.Target, finer: int) -> torch.Tensor:
    """Return the Gauss-Newton matrix summed over every texel, columns averaged over its parts."""
    rows, count = frame.height * finer, lobes.count
    directions = latlong.directions(rows, 2 * rows, dtype=DOUBLE).reshape(-1, 3)
    fine = lobe_images.local_columns(lobes, lobes.axes @ directions.mT).flatten(0, 1)
    images = latlong.reduce(fine.mT.reshape(rows, 2 * rows, -1), frame.height, 2 * frame.height)
    values, *shape = images.flatten(0, 1).mT.unflatten(0, (count, -1)).unbind(1)
    none = torch.zeros_like(values)
    # what each unknown does to the three channels  [N, 8, 3, P]
    moves = [a[:, None] * lobes.amplitude[:, :, None] for a in shape]
    moves += [torch.stack([values if c == k else none for k in range(3)], 1) for c in range(3)]
    changes = torch.stack(moves, dim=1).flatten(0, 1)
    misfit = objective.misfit(
        lobe_images.images(lobes.to(torch.float32), frame.grid).radiance, frame
    )
    total = torch.einsum("icp,p,jcp->ij", changes, misfit.env_weight.double(), changes)
    views = probe(changes.float(), frame.height)
    for view, weight in zip(views, misfit.probe_weights, strict=True):
        total += torch.einsum("icp,p,jcp->ij", view.double(), weight.double(), view.double())
    return total


def _unit_diagonal(found: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """Scale by the roots of another matrix's diagonal."""
    root = torch.diagonal(like).clamp(min=1e-12).rsqrt()
    return found * root[:, None] * root[None, :]


@pytest.mark.parametrize("form", list(Form))
def test_matrix_summed_on_cells_is_the_one_summed_on_texels(form: Form) -> None:
    frame, lobes = _frame(128), random_lobes(form, seed=2)
    lobes = lobes.select(~texels.is_narrow(lobes, newton.CELL_ROWS, lobe_images.NARROW_CELLS))
    assert lobes.count >= 4
    expected = _dense_matrix(lobes, frame, finer=1)
    difference = _unit_diagonal(_equations(lobes, frame)[0] - expected, expected)
    # weights are rough: their sum over a cell is met by the column at its centre, off by
    # (texel / sigma)^2 / 24 and more towards its sides
    assert float(difference.abs().max()) < 0.035


@pytest.mark.parametrize("form", list(Form))
def test_matrix_of_lobes_narrower_than_a_cell_is_the_one_summed_on_texels(form: Form) -> None:
    frame, pair = _frame(128), random_lobes(form, count=1)
    pair = pair.select(torch.tensor([0, 0]))
    sharpness = torch.tensor([[900.0, 900.0 if form is Form.SG else 400.0]] * 2, dtype=DOUBLE)
    away = torch.zeros(2, UNKNOWNS, dtype=DOUBLE)
    away[1, :2] = 0.02  # so that they overlap
    lobes = advance(Lobes(pair.axes, sharpness, pair.amplitude, form), away)
    assert texels.is_narrow(lobes, newton.CELL_ROWS, 1.0).all()
    expected = _dense_matrix(lobes, frame, finer=5)
    difference = _unit_diagonal(_equations(lobes, frame)[0] - expected, expected)
    # two nodes a texel: 1 / 1440 times 15 for derivatives, twice for squares
    assert float(difference.abs().max()) < 0.05


def _found_again(truth: Lobes, frame: objective.Target) -> Lobes:
    """Fit lobes that start 0.15 of every coordinate away."""
    move = 0.15 * torch.randn(3, UNKNOWNS, generator=torch.Generator().manual_seed(3))
    return newton.minimise(advance(truth, move), frame, 40, tolerance=0.0).lobes


def test_minimise_finds_known_lobes_again() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 90.0], [1.0, 8.0, 5.0])
    drawn = lobe_images.images(truth, grid(64)).radiance
    found = _found_again(truth, objective.target(drawn.mT.reshape(64, 128, 3)))
    assert float((found.axis_z * truth.axis_z).sum(-1).min()) > 1 - 1e-6  # 0.08 degrees
    # J is rounded at 1e-7 and quadratic about the minimum: the root of that
    torch.testing.assert_close(found.sharpness, truth.sharpness, rtol=5e-4, atol=5e-4)
    torch.testing.assert_close(found.amplitude, truth.amplitude, rtol=5e-4, atol=5e-4)


def test_minimise_finds_lobes_again_from_their_texel_means() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 90.0], [1.0, 8.0, 5.0])
    found = _found_again(truth, objective.target(texels.texel_means(truth, 64, 128)))
    assert float((found.axis_z * truth.axis_z).sum(-1).min()) > 1 - 1e-6  # 0.08 degrees
    # the fit samples the second, 2.6 texels wide: (1 / 2.6)^2 / 24 an axis off the map's mean
    torch.testing.assert_close(found.sharpness, truth.sharpness, rtol=2e-2, atol=1e-2)
    torch.testing.assert_close(found.amplitude, truth.amplitude, rtol=1.5e-2, atol=1e-3)


def test_minimise_never_raises_the_loss() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)
    frame = objective.target(torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0)))
    values = [newton.minimise(lobes, frame, steps, tolerance=0.0).value for steps in range(5)]
    assert all(b <= a for a, b in itertools.pairwise(values))
    assert values[-1] < 0.9 * values[0]


def test_minimise_reports_the_loss_of_the_lobes_it_returns() -> None:
    lobes, frame = random_lobes(Form.SG).to(torch.float32), _frame()
    held = temporal.prior(lobes, gamma=0.3)
    alone = newton.minimise(lobes, frame, 3)
    assert alone.value == pytest.approx(_loss(alone.lobes, frame), rel=1e-6)
    followed = newton.minimise(lobes, frame, 3, priors=[held, held])
    total = _loss(followed.lobes, frame) + 2 * temporal.value(followed.lobes, held)
    assert followed.value == pytest.approx(total, rel=1e-6)


def test_minimise_leaves_light_at_zero_where_the_map_wants_none() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0)], [3.0, 3.0], [1.0, 0.0])
    frame = objective.target(texels.texel_means(truth, 32, 64))
    start = Lobes(truth.axes, truth.sharpness, truth.amplitude + torch.tensor([[-0.5], [0.0]]))
    found = newton.minimise(start, frame, 20, tolerance=1e-6).lobes
    torch.testing.assert_close(found.amplitude[1], torch.zeros(3), rtol=0, atol=1e-3)
    torch.testing.assert_close(found.amplitude[0], torch.ones(3), rtol=1e-2, atol=0)
    assert float(found.amplitude.min()) >= 0.0


def test_a_dark_lobe_that_the_map_does_not_want_leaves_the_step_to_the_others() -> None:
    both = lamps([(0, 1, 0.2), (0.2, 1, 0.2)], [9.0, 20.0], [1.5, 0.0])
    alone = both.select(torch.tensor([0]))
    darker = lamps([(0, 1, 0.2)], [9.0], [1.0])
    frame = objective.target(texels.texel_means(darker, 32, 64))
    stepped = newton.minimise(both, frame, 1).lobes
    expected = newton.minimise(alone, frame, 1).lobes
    assert float(expected.amplitude.max()) < 1.4
    assert torch.equal(stepped.amplitude[1], torch.zeros(3))
    torch.testing.assert_close(stepped.amplitude[:1], expected.amplitude, rtol=1e-4, atol=0)
    torch.testing.assert_close(stepped.sharpness[:1], expected.sharpness, rtol=1e-4, atol=0)


def test_minimise_keeps_to_the_narrowest_width_allowed() -> None:
    truth = lamps([(1, 0.2, 0)], [400.0], [50.0])
    frame = objective.target(texels.texel_means(truth, 64, 128))
    start = lamps([(1, 0.2, 0)], [20.0], [5.0])
    free = newton.minimise(start, frame, 20).lobes
    held = newton.minimise(start, frame, 20, width_min=0.07).lobes
    assert float(texels.lobe_width(free)) < 0.05
    assert float(texels.lobe_width(held)) == pytest.approx(0.07, rel=0.02)  # pressed against it
    assert float(texels.lobe_width(held)) >= 0.07 * (1 - 1e-6)


def test_a_strong_temporal_term_holds_the_lobes() -> None:
    lobes, frame = random_lobes(Form.ASG).to(torch.float32), _frame()
    free = newton.minimise(lobes, frame, 8).lobes
    held = newton.minimise(lobes, frame, 8, priors=[temporal.prior(lobes, gamma=1e4)]).lobes

    def way(moved: Lobes) -> float:
        return (
            float((temporal.displacement(moved, temporal.prior(lobes)) ** 2).sum(-1).max()) ** 0.5
        )

    assert way(held) < 0.01 < 0.3 < way(free)


def test_a_strong_temporal_term_draws_lobes_to_where_they_were() -> None:
    before, frame = random_lobes(Form.ASG).to(torch.float32), _frame()
    held = temporal.prior(before, gamma=1e4)
    away = torch.zeros(5, UNKNOWNS)
    away[:, :2], away[:, 5:] = 0.03, 0.1
    start = advance(before, away)
    found = newton.minimise(start, frame, 15, priors=[held]).lobes
    assert temporal.displacement(start, held).norm(dim=-1).min() > 0.3
    assert temporal.displacement(found, held).norm(dim=-1).max() < 0.03


def test_temporal_gradient_is_that_of_its_value() -> None:
    held = temporal.prior(random_lobes(Form.ASG))
    generator = torch.Generator().manual_seed(5)
    away = 0.05 * torch.randn(5, UNKNOWNS, generator=generator, dtype=DOUBLE)
    away[:, 4] = 0  # a frame that has rolled sees the prior's coordinates rolled
    lobes = advance(held.lobes, away)
    gradient = torch.zeros(40, dtype=DOUBLE)
    temporal.add_curvature(torch.zeros(40, 40, dtype=DOUBLE), gradient, lobes, held)
    step = 1e-5
    for unknown in (0, 1, 5, 6, 7):  # tilt and light: their coordinates are the displacement's own
        move = torch.zeros(5, UNKNOWNS, dtype=DOUBLE)
        move[2, unknown] = step
        ahead = temporal.value(advance(lobes, move), held)
        behind = temporal.value(advance(lobes, -move), held)
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


def test_temporal_curvature_makes_a_quadratic_above_its_value() -> None:
    held = temporal.prior(random_lobes(Form.BINGHAM))
    lobes = advance(held.lobes, torch.full((5, UNKNOWNS), 0.02, dtype=DOUBLE))
    hessian, gradient = torch.zeros(40, 40, dtype=DOUBLE), torch.zeros(40, dtype=DOUBLE)
    temporal.add_curvature(hessian, gradient, lobes, held)
    start = temporal.value(lobes, held)
    generator = torch.Generator().manual_seed(1)
    for _ in range(20):
        light = torch.zeros(5, UNKNOWNS, dtype=DOUBLE)
        light[:, 5:] = 0.1 * torch.randn(5, 3, generator=generator, dtype=DOUBLE)
        move = light.reshape(-1)
        change = temporal.value(advance(lobes, light), held) - start
        above = float(move @ gradient + 0.5 * move @ hessian @ move)
        assert change <= above + 1e-12
