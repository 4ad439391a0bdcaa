# SPDX-License-Identifier: Apache-2.0
"""The loss against its definition in float64; its slope against autograd; its majoriser."""

from dataclasses import replace

import pytest
import torch
from lobe_cases import DOUBLE, flat
from splat_cases import of_texels
from torch import Tensor

from asglight.fitting.loss import objective, probes
from asglight.fitting.loss.adaptive_cells import (
    AdaptiveCells,
    adaptive_cells,
    on_adaptive_cells,
    to_cells,
)
from asglight.fitting.loss.grid import grid
from asglight.fitting.loss.probes import PROBES
from asglight.shading import kernels
from asglight.sphere import latlong

CORNERS = objective.Corners(env=0.3, probe=0.02)

CASES = [(24, 64, 0), (50, 64, 0), (64, 64, 9), (64, 16, 5), (64, 16, 0), (256, 64, 20)]
"""Rows of the map, rows of the cells wanted, refined cells. Parts are 128 rows, or the texels."""


def _maps(height: int, seed: int = 0, count: int = 2) -> Tensor:
    """Return maps with a few bright texels.  [F, H, 2 H, 3]."""
    generator = torch.Generator().manual_seed(seed)
    return 5 * torch.rand(count, height, 2 * height, 3, generator=generator) ** 4


def _example(case: tuple[int, int, int]) -> tuple[Tensor, AdaptiveCells, Tensor]:
    """Return two maps, their adaptive cells, and reconstructions on the adaptive cells."""
    height, rows, refined = case
    maps = _maps(height)
    places = adaptive_cells(flat(maps), rows, refined)
    return maps, places, 1.2 * on_adaptive_cells(flat(_maps(height, seed=1)), places)


def _corner(source: probes.Probe) -> float:
    return objective.EVEN_CORNER if source.kernel == kernels.EVEN else CORNERS.probe


def _term(fit: Tensor, ref: Tensor, share: Tensor, corner: float) -> Tensor:
    """Return mean phi(fit - ref) / mean |ref|, less phi's value at 0.  [P, 3]."""
    scale = (share * ref.norm(dim=-1)).sum()
    size = ((fit - ref).square().sum(-1) + (corner * scale) ** 2).sqrt()
    return (share * size).sum() / scale - corner


def _shares(height: int) -> Tensor:
    areas = latlong.texel_solid_angles(height, 2 * height, dtype=DOUBLE).reshape(height, 2 * height)
    return areas / (4 * torch.pi)


def _block(cell: int, rows: int, height: int) -> tuple[slice, slice]:
    """Return the rows and columns of a map that a cell covers."""
    factor, (row, column) = height // rows, divmod(cell, 2 * rows)
    return (
        slice(row * factor, (row + 1) * factor),
        slice(column * factor, (column + 1) * factor),
    )


def _loss_by_definition(fit: Tensor, ref: Tensor, rows: int, refined: list[int]) -> Tensor:
    """Return J in float64.

    Args:
        fit: On cells, then on the texels of the refined ones.  [3, P]
        ref: The map.  [H, 2 H, 3]
        rows: Rows of the grid of cells.
        refined: The refined cells.
    """
    height, count = ref.shape[0], 2 * rows**2
    factor = min(2, height // rows)
    part_rows = factor * rows
    parts = latlong.reduce(ref, part_rows, 2 * part_rows).reshape(rows, factor, 2 * rows, factor, 3)
    parts = parts.permute(0, 2, 1, 3, 4).reshape(count, factor**2, 3)
    plain = [cell for cell in range(count) if cell not in set(refined)]
    # every part of a cell weighs the same
    weight = (_shares(rows).reshape(-1, 1) / factor**2).expand(-1, factor**2)[plain]
    cells = fit[:, :count].mT.clone()
    fits, refs = [cells[plain][:, None].expand(-1, factor**2, 3).flatten(0, 1)], [parts[plain]]
    areas = [weight.flatten()]
    wanted = latlong.reduce(ref, rows, 2 * rows).flatten(0, 1)
    plain_only = torch.ones(count, 1, dtype=DOUBLE)
    plain_only[refined] = 0.0
    seen = [plain_only * cells, plain_only * wanted]
    texels = fit[:, count:].mT.reshape(len(refined), (height // rows) ** 2, 3)
    for index, cell in enumerate(refined):
        block = _block(cell, rows, height)
        area = _shares(height)[block].flatten()
        fits.append(texels[index])
        refs.append(ref[block].reshape(1, -1, 3))
        areas.append(area)
        texel = torch.arange(2 * height**2).reshape(height, -1)[block].flatten()
        brought = of_texels(texel, height, rows)
        seen = [seen[0] + brought @ texels[index], seen[1] + brought @ ref[block].flatten(0, 1)]
    env = _term(
        torch.cat(fits),
        torch.cat([one.reshape(-1, 3) for one in refs]),
        torch.cat(areas),
        CORNERS.env,
    )
    total = objective.ENV_WEIGHT * env
    maps = torch.stack(seen).unflatten(1, (rows, -1))
    for source, share in zip(PROBES, probes.split(probes.shares(rows, "cpu"), rows), strict=True):
        directions = probes.directions(source, rows).double()
        views = kernels.filtered(maps, source.kernel, directions, normalised=True)
        total = total + source.weight * _term(views[0], views[1], share.double(), _corner(source))
    return total


@pytest.mark.parametrize("case", CASES)
def test_value_and_slope_are_those_of_the_definition(case: tuple[int, int, int]) -> None:
    maps, places, fit = _example(case)
    frame = objective.target(flat(maps), CORNERS, places)
    value, found = objective.value(fit, frame), objective.loss_gradient(fit, frame)
    for index in range(2):
        exact = fit[index].double().requires_grad_()
        refined = places.refined[index].tolist()
        loss = _loss_by_definition(exact, maps[index].double(), places.rows, refined)
        (expected,) = torch.autograd.grad(loss, exact)
        # sums in float32
        assert float(value[index]) == pytest.approx(float(loss.detach()), rel=1e-5)
        slope = found.slope[index].double()
        # the even probe alone gives nearly the whole of it: float32 transforms of what is left
        bound = 1e-5 * float(expected.abs().max())
        torch.testing.assert_close(slope, expected, rtol=1e-4, atol=bound)


def test_a_refined_cell_has_no_say_of_its_own() -> None:
    maps, places, fit = _example((64, 16, 5))
    frame = objective.target(flat(maps), CORNERS, places)
    other = fit.scatter(-1, places.refined[:, None].expand(-1, 3, -1), 1e3)
    assert torch.equal(objective.value(other, frame), objective.value(fit, frame))
    slope = objective.loss_gradient(other, frame).slope
    at_cells = slope.gather(-1, places.refined[:, None].expand(-1, 3, -1))
    assert torch.equal(at_cells, torch.zeros_like(at_cells))


def _majoriser(
    away: Tensor, loss_gradient: objective.LossGradient, places: AdaptiveCells
) -> Tensor:
    """Return slope times `away` and half the weighted squares of what it shows.  [F]."""
    squares = (loss_gradient.env_weight[:, None] * away.square()).sum((1, 2))
    views = probes.probe(to_cells(away, places), places.rows)
    squares += (loss_gradient.view_weight[:, None] * views.square()).sum((1, 2))
    return (loss_gradient.slope * away).double().sum((1, 2)) + 0.5 * squares


@pytest.mark.parametrize("case", [(32, 32, 0), (64, 16, 5)])
def test_weights_make_a_quadratic_that_lies_above_the_loss(case: tuple[int, int, int]) -> None:
    maps, places, fit = _example(case)
    frame = objective.target(flat(maps), places=places)
    loss_gradient, start = objective.loss_gradient(fit, frame), objective.value(fit, frame)
    noise = torch.randn(fit.shape, generator=torch.Generator().manual_seed(2))
    ref = frame.radiance
    for direction in (noise, noise.abs(), -fit, ref - fit, ref, torch.ones_like(fit)):
        for size in (-3.0, -1.0, -0.1, 0.1, 1.0, 3.0):
            change = objective.value(fit + size * direction, frame) - start
            above = _majoriser(size * direction, loss_gradient, places)
            assert bool((change <= above + 1e-5).all())  # J in float32


def test_quadratic_touches_the_loss_where_the_error_is_and_at_its_mirror_image() -> None:
    # without parts, whose errors differ from the cell's
    maps, places, fit = _example((32, 32, 0))
    frame = objective.target(flat(maps), places=places)
    loss_gradient, start = objective.loss_gradient(fit, frame), objective.value(fit, frame)
    # phi is even, and so is its majoriser: at minus the error both are what they were
    mirrored = 2 * (frame.radiance - fit)
    # float32
    torch.testing.assert_close(objective.value(fit + mirrored, frame), start, rtol=1e-5, atol=0)
    assert float(_majoriser(mirrored, loss_gradient, places).abs().max()) < 1e-5 * float(
        start.min()
    )


@pytest.mark.parametrize("case", [(32, 32, 0), (64, 16, 5)])
def test_quadratic_and_loss_agree_near_the_error(case: tuple[int, int, int]) -> None:
    maps, places, fit = _example(case)
    frame = objective.target(flat(maps), places=places)
    near = 1e-2 * (frame.radiance - fit)
    change = objective.value(fit + near, frame) - objective.value(fit, frame)
    above = _majoriser(near, objective.loss_gradient(fit, frame), places)
    # they differ by the square of the way
    torch.testing.assert_close(change.double(), above, rtol=2e-2, atol=0)


def _flat_over_cells(case: tuple[int, int, int]) -> tuple[objective.Target, AdaptiveCells]:
    """Return maps with detail in the refined cells alone, and their adaptive cells."""
    height, rows, refined = case
    factor = height // rows
    maps = _maps(rows).repeat_interleave(factor, 1).repeat_interleave(factor, 2)
    detail = 10 * _maps(height, seed=3)  # and so the cells that are refined
    for index, cell in enumerate(range(7, 7 + 90 * refined, 90)):
        row, column = _block(cell + index, rows, height)
        maps[:, row, column] += detail[:, row, column]
    places = adaptive_cells(flat(maps), rows, refined)
    return objective.target(flat(maps), CORNERS, places), places


@pytest.mark.parametrize("case", [(32, 32, 0), (64, 16, 5)])
def test_perfect_fit_has_no_loss_no_slope_and_finite_weights(case: tuple[int, int, int]) -> None:
    frame, _ = _flat_over_cells(case)
    found = objective.loss_gradient(frame.radiance, frame)
    # phi at 0 is its corner, taken off: what is left is float32 sums
    assert float(objective.value(frame.radiance, frame).abs().max()) < 1e-5
    # a mean of equal parts is one of them to float32; slopes elsewhere are of the size of a share
    away = objective.loss_gradient(1.1 * frame.radiance, frame).slope.abs().max()
    assert float(found.slope.abs().max()) < 1e-5 * float(away)
    for weight in (found.env_weight, found.view_weight):
        assert bool(weight.isfinite().all())
        assert float(weight.min()) >= 0


def test_black_has_all_of_the_loss() -> None:
    maps = torch.rand(2, 32, 64, 3, generator=torch.Generator().manual_seed(0))
    frame = objective.target(flat(maps))
    black = objective.value(torch.zeros(2, 3, 32 * 64), frame)
    most = objective.ENV_WEIGHT + sum(source.weight for source in PROBES)
    # less the rounded corners: 2 of the even probe's 10 and a tenth of the map's
    assert bool((0.8 * most < black).all())
    assert bool((black < most).all())


def test_loss_does_not_depend_on_the_exposure() -> None:
    maps, places, fit = _example((64, 16, 5))
    value = objective.value(fit, objective.target(flat(maps), places=places))
    for exposure in (1e-6, 1e6):
        frame = objective.target(exposure * flat(maps), places=places)
        brighter = objective.value(exposure * fit, frame)
        torch.testing.assert_close(brighter, value, rtol=1e-5, atol=0)  # float32


def test_going_dark_costs_more_flux_than_everything_else_can_gain() -> None:
    others = [p.weight for p in PROBES if p.kernel != kernels.EVEN]
    (even,) = (p for p in PROBES if p.kernel == kernels.EVEN)
    dark = even.weight * ((1 + objective.EVEN_CORNER**2) ** 0.5 - objective.EVEN_CORNER)
    assert dark > objective.ENV_WEIGHT + sum(others)


def test_black_maps_have_a_finite_loss() -> None:
    frame = objective.target(torch.zeros(1, 3, 32 * 64))
    assert float(objective.value(torch.zeros(1, 3, 32 * 64), frame)) == pytest.approx(0, abs=1e-5)
    white = torch.ones(1, 3, 32 * 64)
    value, found = objective.value(white, frame), objective.loss_gradient(white, frame)
    everything = (value, found.slope, found.env_weight, found.view_weight)
    assert all(bool(tensor.isfinite().all()) for tensor in everything)
    assert float(value) > 1e6


def test_frames_of_a_batch_do_not_see_each_other() -> None:
    maps, _, _ = _example((64, 16, 5))
    maps = torch.stack([maps[0], 1e3 * maps[1]])
    places = adaptive_cells(flat(maps), 16, 5)
    assert not torch.equal(places.refined[0], places.refined[1])
    fit = on_adaptive_cells(flat(_maps(64, seed=1)), places)
    frames = objective.target(flat(maps), places=places)
    values, both = objective.value(fit, frames), objective.loss_gradient(fit, frames)
    for index in range(2):
        one = slice(index, index + 1)
        alone = adaptive_cells(flat(maps[one]), 16, 5)
        assert torch.equal(alone.refined[0], places.refined[index])
        frame = objective.target(flat(maps[one]), places=alone)
        value, found = objective.value(fit[one], frame), objective.loss_gradient(fit[one], frame)
        # float32 sums in another order
        torch.testing.assert_close(values[one], value, rtol=1e-5, atol=0)
        bound = 1e-6 * float(found.slope.abs().max())
        torch.testing.assert_close(both.slope[one], found.slope, rtol=1e-4, atol=bound)
        torch.testing.assert_close(both.env_weight[one], found.env_weight, rtol=1e-5, atol=0)


def test_a_repeated_target_judges_each_reconstruction_as_the_one_does() -> None:
    maps, places, fit = _example((64, 16, 5))
    one = objective.target(flat(maps[:1]), CORNERS, adaptive_cells(flat(maps[:1]), 16, 5))
    many = one.repeated(3)
    fits = torch.cat([fit[:1], 0.5 * fit[:1], 2 * fit[:1]])
    values, found = objective.value(fits, many), objective.loss_gradient(fits, many)
    for index in range(3):
        fit = fits[index : index + 1]
        value, alone = objective.value(fit, one), objective.loss_gradient(fit, one)
        # float32 sums in another order
        torch.testing.assert_close(values[index], value[0], rtol=1e-5, atol=0)
        bound = 1e-6 * float(alone.slope.abs().max())
        torch.testing.assert_close(found.slope[index], alone.slope[0], rtol=1e-4, atol=bound)
    assert len(many.places.refined) == 3
    assert replace(many, corners=CORNERS).env_corner.shape == (3,)
    assert places.rows == many.places.rows == 16


@pytest.mark.parametrize("case", CASES)
def test_the_loss_laid_out_on_the_leaves_is_the_loss(case: tuple[int, int, int]) -> None:
    maps, places, fit = _example(case)
    frame = objective.target(flat(maps), CORNERS, places)
    # parts of a cell that are alike: what is laid out takes a cell's mean for all of them
    even = replace(frame, parts=frame.radiance[:, None, :, : places.count].expand_as(frame.parts))
    laid = objective.per_cell_loss(fit, even).double().sum(-1)
    value = objective.value(fit, even).double()
    # float32 sums; the corner of the map counts adaptive cell by adaptive cell
    torch.testing.assert_close(laid, value, rtol=2e-4, atol=0)


def test_a_lamp_that_is_missing_has_its_part_of_the_loss_near_itself() -> None:
    maps = torch.full((1, 64, 128, 3), 0.1)
    maps[0, 20, 31] = 300.0
    places = adaptive_cells(flat(maps), 16, 4)
    frame = objective.target(flat(maps), CORNERS, places)
    dark = on_adaptive_cells(flat(torch.full_like(maps, 0.1)), places)
    laid = objective.per_cell_loss(dark, frame)[0]
    lamp = grid(64).directions[20 * 128 + 31]
    near = (places.directions[0].mT @ lamp) > 0.87  # 30 degrees: all but the broad probes
    far = (places.directions[0].mT @ lamp) < -0.5
    dense = laid / places.share[0].clamp(min=1e-12)  # a refined cell has no share of its own
    seen = places.share[0] > 0
    assert float(dense[near & seen].mean()) > 5 * float(dense[far & seen].mean())


def test_the_loss_of_some_lobes_on_what_others_leave_is_that_of_all() -> None:
    maps, places, others = _example((64, 16, 5))
    frame = objective.target(flat(maps), CORNERS, places)
    some = 0.3 * on_adaptive_cells(flat(_maps(64, seed=2)), places)
    left = objective.less(frame, others)
    whole = objective.loss_terms(some + others, frame)
    rest = objective.loss_terms(some, left)
    torch.testing.assert_close(rest.value, whole.value, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(rest.seen, whole.seen, rtol=1e-4, atol=1e-5)
    slope, wanted = (
        objective.loss_gradient(*each).slope for each in ((some, left), (some + others, frame))
    )
    torch.testing.assert_close(slope, wanted, rtol=1e-3, atol=1e-6)
