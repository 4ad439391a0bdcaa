# SPDX-License-Identifier: Apache-2.0
"""The gradient against differences, the matrix against a dense sum; minima."""

import itertools
import math
from dataclasses import replace

import pytest
import torch
from lobe_cases import DOUBLE, KNOWN, alike, flat, lamps, noise, random_lobes, shown, target
from torch import Tensor

from asglight.fitting.loss import adaptive_cells as cells_module
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.adaptive_cells import adaptive_cells
from asglight.fitting.loss.coordinates import UNKNOWNS, advance
from asglight.fitting.loss.footprints import footprint
from asglight.fitting.loss.grid import POWERS, Grid, coarser, grid
from asglight.fitting.loss.probes import probe
from asglight.fitting.steps import equations, newton
from asglight.lobes import Form, Lobes, texels
from asglight.lobes import flat as flat_form
from asglight.sphere import latlong


def _equations(lobes: Lobes, frame: objective.Target) -> tuple[Tensor, Tensor]:
    shown = lobe_images.images(lobes.to(torch.float32), frame.places)
    return equations.normal_equations(shown, objective.loss_gradient(shown.radiance, frame), frame)


def _loss(lobes: Lobes, frame: objective.Target) -> Tensor:
    radiance = lobe_images.images(lobes.to(torch.float32), frame.places).radiance
    return objective.value(radiance, frame)


@pytest.fixture
def double(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let grids be float64, and with them all that is computed of float64 lobes."""

    def fine(height: int, device: str) -> Grid:
        found = grid(height, device)
        x, y, z = latlong.directions(height, 2 * height, dtype=DOUBLE).reshape(-1, 3).unbind(-1)
        monomials = torch.stack([x**i * y**j * z**k for i, j, k in POWERS])
        return replace(found, monomials=monomials, share=found.share.double())

    monkeypatch.setattr(cells_module, "grid", fine)
    monkeypatch.setattr(equations, "grid", fine)


def _gradient(lobes: Lobes, frame: objective.Target) -> Tensor:
    shown = lobe_images.images(lobes, frame.places)
    found = objective.loss_gradient(shown.radiance, frame)
    return equations.normal_equations(shown, found, frame)[1].reshape(-1, UNKNOWNS)


def _differences(lobes: Lobes, frame: objective.Target) -> Tensor:
    """Return central differences of J.  [1, N, .] -> [N, 8]."""

    def loss(moved: Lobes) -> float:
        return float(objective.value(lobe_images.images(moved, frame.places).radiance, frame))

    found, step = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE), 1e-5
    for lobe, unknown in itertools.product(range(lobes.count), range(UNKNOWNS)):
        move = torch.zeros(1, lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[0, lobe, unknown] = step
        change = loss(advance(lobes, move)) - loss(advance(lobes, -move))
        found[lobe, unknown] = change / (2 * step)
    return found


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.usefixtures("double")
def test_gradient_is_that_of_the_loss(form: Form) -> None:
    lobes = random_lobes(form)[None]
    frame = objective.target(flat(texels.texel_means(random_lobes(form, seed=1), 32, 64)[None]))
    # the footprint is held: for a lobe 1.3 cells wide (1 / 1.3)^2 / 12 of the width's slope, times
    # how much a cell narrows on the way
    torch.testing.assert_close(
        _gradient(lobes, frame), _differences(lobes, frame), rtol=2e-3, atol=3e-3
    )


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.usefixtures("double")
def test_gradient_of_narrow_lobes_on_texels_is_that_of_the_loss(form: Form) -> None:
    narrow, sigma = random_lobes(form, count=2, seed=3), torch.tensor([[0.5], [1.1]], dtype=DOUBLE)
    ratio = torch.tensor([1.0, 1.0 if form is Form.SG else 0.3], dtype=DOUBLE)
    factor = 1.0 if form is Form.SG else 2.0
    sharpness = ratio / (factor * (sigma * math.pi / 128) ** 2)
    lobes = Lobes(narrow.axes, sharpness, 20 * narrow.amplitude, form)
    near = advance(lobes, torch.full((2, UNKNOWNS), 0.005, dtype=DOUBLE))
    brighter = replace(near, amplitude=1.3 * near.amplitude)
    frame = target(flat(texels.texel_means(brighter, 128, 256)[None]), 64, 64)
    # slopes of up to 8; the footprint is held
    torch.testing.assert_close(
        _gradient(lobes[None], frame), _differences(lobes[None], frame), rtol=2e-3, atol=1e-2
    )


def test_gauss_newton_matrix_is_symmetric_and_positive() -> None:
    hessian, _ = _equations(alike(Form.ASG, seeds=(0, 4)), target(noise(64, 2), 32, 8))
    torch.testing.assert_close(hessian, hessian.mT, rtol=1e-4, atol=1e-6)  # float32 sums
    values = torch.linalg.eigvalsh((hessian + hessian.mT) / 2)
    assert bool((values.amin(-1) > -1e-5 * values.amax(-1)).all())  # float32 sums


def _dense_matrix(lobes: Lobes, frame: objective.Target, rows: int) -> Tensor:
    """Return the Gauss-Newton matrix in float64, summed over cells of `rows` rows and texels.

    Lobes are in float64, [F, N, .]; the cells carry the weights of the frame's cells.
    """
    shown = lobe_images.images(lobes.to(torch.float32), frame.places)
    loss_gradient, places = objective.loss_gradient(shown.radiance, frame), frame.places
    of_adaptive = footprint(lobes.to(torch.float32), [size for size, *_ in places.levels])
    of_scale = lobe_images.scale_slopes(shown, of_adaptive, places).double()
    exact = replace(shown, lobes=lobes, scale=shown.scale.double())
    if shown.terms is not None:
        own = replace(shown.terms, lobes=flat_form.terms(lobes), scale=shown.terms.scale.double())
        exact = replace(exact, terms=own)
    seen = footprint(lobes, [rows, *(size for size, *_ in places.levels[1:])])
    coarse = grid(rows)
    coarse = replace(coarse, monomials=coarse.monomials.double(), share=coarse.share.double())
    levels = [lobe_images.grid_columns(lobes, seen, 0, coarse)]
    for level, (_, each, _) in list(enumerate(places.levels))[1:]:
        levels.append(lobe_images.adaptive_columns(exact, seen, of_scale, level, each.double()))
    fewer = places.rows // rows
    cells = loss_gradient.env_weight[:, : places.count].double()
    cells = cells.reshape(-1, rows, fewer, 2 * rows, fewer).sum((2, 4)).flatten(1)
    weights = [cells, loss_gradient.env_weight[:, places.count :].double()]
    total = torch.zeros(len(cells), lobes.count * UNKNOWNS, lobes.count * UNKNOWNS, dtype=DOUBLE)
    for level, images in enumerate(levels):
        changes = _changes(images.unflatten(1, (lobes.count, -1)), lobes.amplitude)
        total += torch.einsum("ficp,fp,fjcp->fij", changes, weights[level], changes)
        if level == 0:
            views, weight = (
                probe(changes.float(), rows).double(),
                loss_gradient.view_weight.double(),
            )
            total += torch.einsum("ficp,fp,fjcp->fij", views, weight, views)
    return total


def _changes(images: Tensor, amplitude: Tensor) -> Tensor:
    """Return what each unknown does to the three channels.  [F, N, 6, P] -> [F, 8 N, 3, P]."""
    values, *shape = images.unbind(2)
    none = torch.zeros_like(values)
    moves = [a[:, :, None] * amplitude[..., None] for a in shape]
    moves += [torch.stack([values if c == k else none for k in range(3)], 2) for c in range(3)]
    return torch.stack(moves, dim=2).flatten(1, 2)


def _off_by(found: Tensor, expected: Tensor) -> float:
    """Return the largest difference after scaling to unit diagonal."""
    root = torch.diagonal(expected, dim1=-2, dim2=-1).clamp(min=1e-12).rsqrt()
    return float(((found - expected) * root[:, :, None] * root[:, None, :]).abs().max())


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("case", [(24, 24, 0), (64, 64, 0), (128, 64, 16)])
def test_matrix_is_the_dense_sum_over_its_cells(form: Form, case: tuple[int, int, int]) -> None:
    height, rows, refined = case
    lobes, maps = alike(form, seeds=(2, 5)), noise(height, 2)
    if refined:  # narrow ones, where there are texels
        lobes = replace(lobes, sharpness=300 * lobes.sharpness)
        means = [texels.texel_means(lobes[one], height, 2 * height) for one in (0, 1)]
        maps = maps + 10 * flat(torch.stack(means))
    frame = target(maps, rows, refined)
    expected = _dense_matrix(lobes.to(DOUBLE), frame, coarser(rows, equations.CURVATURE_ROWS))
    # float32 sums over thousands of cells; exponents as large as the sharpness of narrow lobes
    assert _off_by(_equations(lobes, frame)[0], expected) < (2e-3 if refined else 2e-5)


@pytest.mark.parametrize("form", list(Form))
def test_matrix_of_wide_lobes_is_the_one_summed_over_every_leaf(form: Form) -> None:
    lobes, frame = alike(form, seeds=(2,)), target(noise(128), 64, 16)
    wide = texels.lobe_width(lobes[0]) >= 1.5 * math.pi / equations.CURVATURE_ROWS
    lobes = lobes.select(wide)
    assert lobes.count >= 3
    expected = _dense_matrix(lobes.to(DOUBLE), frame, 64)
    # weights are rough: their sum over a cell is met by the column's mean over it; columns at
    # cells 1.5 widths apart differ by (1 / 1.5)^2 / 12 within one
    assert _off_by(_equations(lobes, frame)[0], expected) < 0.05


def _found_again(truth: Lobes, frame: objective.Target) -> Lobes:
    """Fit lobes that start 0.15 of every coordinate away."""
    move = 0.15 * torch.randn(3, UNKNOWNS, generator=torch.Generator().manual_seed(3))
    return newton.minimise(advance(truth, move)[None], frame, 60, tolerance=0.0).lobes[0]


def test_minimise_finds_known_lobes_again() -> None:
    places = adaptive_cells(torch.zeros(1, 3, 2 * 64**2))
    frame = objective.target(lobe_images.images(KNOWN[None], places).radiance)
    found = _found_again(KNOWN, frame)
    assert float((found.axis_z * KNOWN.axis_z).sum(-1).min()) > 1 - 1e-6  # 0.08 degrees
    # J is rounded at 1e-7 and quadratic about the minimum: the root of that
    torch.testing.assert_close(found.sharpness, KNOWN.sharpness, rtol=5e-4, atol=5e-4)
    torch.testing.assert_close(found.amplitude, KNOWN.amplitude, rtol=5e-4, atol=5e-4)


def test_minimise_finds_lobes_again_from_their_texel_means() -> None:
    found = _found_again(KNOWN, shown(KNOWN, 128))
    assert float((found.axis_z * KNOWN.axis_z).sum(-1).min()) > 1 - 1e-6  # 0.08 degrees
    # an adaptive cell's footprint is its second moment: the fourth is left, (cell / sigma)^4 / 240
    # at 1.5
    torch.testing.assert_close(found.sharpness, KNOWN.sharpness, rtol=5e-3, atol=5e-3)
    torch.testing.assert_close(found.amplitude, KNOWN.amplitude, rtol=5e-3, atol=5e-3)


def test_minimise_never_raises_the_loss_of_a_frame() -> None:
    lobes, frame = alike(Form.ASG, seeds=(0, 1, 10)), target(noise(64, 3), 32, 8)
    values = [newton.minimise(lobes, frame, steps, tolerance=0.0).value for steps in range(6)]
    assert all(bool((b <= a).all()) for a, b in itertools.pairwise(values))
    assert bool((values[-1] < 0.9 * values[0]).all())


def test_minimise_reports_the_loss_of_the_lobes_it_returns() -> None:
    lobes, frame = alike(Form.SG, seeds=(0, 1)), target(noise(32, 2))
    held = temporal.prior(lobes, gamma=0.3)
    alone = newton.minimise(lobes, frame, 3)
    # the same sums
    torch.testing.assert_close(alone.value, _loss(alone.lobes, frame), rtol=1e-6, atol=0)
    followed = newton.minimise(lobes, frame, 3, priors=[held, held])
    total = _loss(followed.lobes, frame) + 2 * temporal.value(followed.lobes, held)
    torch.testing.assert_close(followed.value, total, rtol=1e-6, atol=0)


def test_minimise_counts_steps_tried_and_tells_of_each() -> None:
    lobes, frame = alike(Form.ASG, seeds=(59,)), target(noise())
    seen: list[Lobes] = []
    found = newton.minimise(lobes, frame, 4, damping=1e-6, tolerance=0.0, on_step=seen.append)
    assert len(seen) == 4
    assert torch.equal(seen[0].axes, lobes.axes)  # the first step of this start fails
    assert torch.equal(seen[-1].axes, found.lobes.axes)
    none = newton.minimise(lobes, frame, 0)
    assert torch.equal(none.lobes.axes, lobes.axes)
    assert none.damping.tolist() == [newton.DAMPING_START]


def test_minimise_stops_when_no_frame_gains_any_more() -> None:
    frame = target(noise(32, 2))
    start = newton.minimise(alike(Form.ASG, seeds=(0, 3)), frame, 5)
    # no step from here halves J, so that the first that lowers both is the last
    seen: list[Lobes] = []
    newton.minimise(start.lobes, frame, 30, tolerance=0.5, on_step=seen.append)
    patient: list[Lobes] = []
    newton.minimise(start.lobes, frame, 30, tolerance=0.0, on_step=patient.append)
    assert 0 < len(seen) < len(patient) == 30


def test_minimise_leaves_light_at_zero_where_the_map_wants_none() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0)], [3.0, 3.0], [1.0, 0.0])
    start = replace(truth, amplitude=truth.amplitude + torch.tensor([[-0.5], [0.0]]))
    found = newton.minimise(start[None], shown(truth, 32), 20, tolerance=1e-6).lobes[0]
    torch.testing.assert_close(found.amplitude[1], torch.zeros(3), rtol=0, atol=1e-3)
    # the wrong light of the other is lost at the corner of its bound: a percent
    torch.testing.assert_close(found.amplitude[0], torch.ones(3), rtol=1e-2, atol=0)
    assert float(found.amplitude.min()) >= 0.0


def test_a_dark_lobe_that_the_map_does_not_want_leaves_the_step_to_the_others() -> None:
    both = lamps([(0, 1, 0.2), (0.2, 1, 0.2)], [9.0, 20.0], [1.5, 0.0])[None]
    alone = both.select(torch.tensor([0]))
    frame = shown(lamps([(0, 1, 0.2)], [9.0], [1.0]), 32)
    stepped = newton.minimise(both, frame, 1).lobes
    expected = newton.minimise(alone, frame, 1).lobes
    assert float(expected.amplitude.max()) < 1.4
    assert torch.equal(stepped.amplitude[0, 1], torch.zeros(3))
    # float32 sums of other shapes
    torch.testing.assert_close(stepped.amplitude[:, :1], expected.amplitude, rtol=1e-4, atol=0)
    torch.testing.assert_close(stepped.sharpness[:, :1], expected.sharpness, rtol=1e-4, atol=0)


def test_lobes_that_stay_leave_the_steps_to_the_others() -> None:
    """As if the map were what they leave of it, a dark one among them."""
    frame = shown(KNOWN, 64)
    start = advance(KNOWN[None], 0.1 * torch.ones(1, 3, UNKNOWNS))
    start.amplitude[0, 1] = 0.0
    still = torch.tensor([[True, True, False]])
    found = newton.minimise(start, frame, 12, still=still).lobes
    for name in ("axes", "sharpness", "amplitude"):
        own, before = (getattr(each, name)[:, :2] for each in (found, start))
        torch.testing.assert_close(own, before, rtol=1e-5, atol=1e-6)  # made orthonormal again
    held = lobe_images.images(start.select(torch.tensor([0, 1])), frame.places).radiance
    alone = newton.minimise(start.select(torch.tensor([2])), objective.less(frame, held), 12).lobes
    torch.testing.assert_close(found.axis_z[:, 2:], alone.axis_z, rtol=0, atol=1e-3)
    torch.testing.assert_close(found.sharpness[:, 2:], alone.sharpness, rtol=0.02, atol=0)
    assert float((found.axis_z[0, 2] - start.axis_z[0, 2]).norm()) > 0.01


@pytest.mark.parametrize("form", [Form.ASG, Form.SG])
def test_minimise_keeps_to_the_narrowest_width_allowed(form: Form) -> None:
    frame = shown(replace(lamps([(1, 0.2, 0)], [400.0], [50.0]), form=form), 64)
    start = replace(lamps([(1, 0.2, 0)], [20.0], [5.0]), form=form)[None]
    free = newton.minimise(start, frame, 20).lobes
    held = newton.minimise(start, frame, 20, width_min=0.07).lobes
    assert float(texels.lobe_width(free)) < 0.055  # 0.05 for sg, 0.035 for asg
    # pressed against it, to float32
    assert float(texels.lobe_width(held)) == pytest.approx(0.07, rel=0.02)
    assert float(texels.lobe_width(held)) >= 0.07 * (1 - 1e-6)
