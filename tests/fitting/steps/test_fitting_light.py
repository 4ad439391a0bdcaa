# SPDX-License-Identifier: Apache-2.0
"""Amplitudes alone: against scipy's non-negative least squares, and what they do to the loss."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch
from lobe_cases import DOUBLE, flat, lamps, random_lobes, shown, target
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective, probes
from asglight.fitting.loss.adaptive_cells import adaptive_cells, to_cells
from asglight.fitting.steps import light
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import joined, stack
from asglight.sphere import latlong


def _loss(lobes: Lobes, frame: objective.Target) -> float:
    return float(objective.value(lobe_images.images(lobes, frame.places).radiance, frame))


def _env_rows(
    values: Tensor, fit: Tensor, ref: Tensor, frame: objective.Target, index: int
) -> tuple[Tensor, Tensor]:
    """Return the weighted rows of the map's error, in float64, from the parts and the texels.

    Args:
        values: Each lobe on the adaptive cells.  [N, P]
        fit: What they show.  [3, P]
        ref: The map.  [H, 2 H, 3]
        frame: The target, for its scale and corner.
        index: Which of its frames.

    Returns:
        The lobes [rows, N] and what they should add to [rows, 3].
    """
    places, cells = frame.places, frame.places.count
    rows, factor = places.rows, min(2, places.fine_rows // places.rows)
    part_rows = factor * rows
    parts = latlong.reduce(ref, part_rows, 2 * part_rows).reshape(rows, factor, 2 * rows, factor, 3)
    parts = parts.permute(1, 3, 0, 2, 4).flatten(2, 3).flatten(0, 1)  # [K, C, 3]
    texel = ref.flatten(0, 1)[places.texel[index]]
    wanted = torch.cat([parts.flatten(0, 1), texel])
    of_cells = torch.arange(cells).repeat(factor**2)
    place = torch.cat([of_cells, torch.arange(cells, values.shape[-1])])
    share = places.share[index].double()[place]
    share[: len(of_cells)] /= factor**2
    scale = frame.env_scale[index].double()
    away = fit.mT[place] - wanted
    size = (away.square().sum(-1) + (frame.corners.env * scale) ** 2).sqrt()
    root = (objective.ENV_WEIGHT * share / (scale * size)).sqrt()[:, None]
    return root * values.mT[place], root * wanted


def _solved_by_scipy(lobes: Lobes, frame: objective.Target, ref: Tensor, index: int) -> np.ndarray:
    """Solve one frame's reweighted problem by its stacked rows.  [N, 3]."""
    places = frame.places
    images = lobe_images.images(lobes, places)
    values = (images.values * images.scale[..., None])[index].double()
    fit = lobes.amplitude[index].double().mT @ values
    found = objective.loss_gradient(images.radiance, frame)
    pieces = [_env_rows(values, fit, ref, frame, index)]
    on_cells = to_cells(images.values * images.scale[..., None], places)[index]
    truth = to_cells(frame.radiance, places)[index]
    root = found.view_weight[index].double().sqrt()
    shown, wanted = (probes.probe(each, places.rows).double() for each in (on_cells, truth))
    pieces.append(((root * shown).mT, (root * wanted).mT))
    rows = torch.cat([piece[0] for piece in pieces]).numpy()
    targets = torch.cat([piece[1] for piece in pieces]).numpy()
    solved = [scipy.optimize.nnls(rows, targets[:, channel])[0] for channel in range(3)]
    return np.stack(solved, axis=-1)


def with_amplitudes(lobes: Lobes, frame: objective.Target, passes: int = 3) -> Lobes:
    """Solve so many times; each weighs the errors that the one before left."""
    shown = lobe_images.images(lobes, frame.places)
    for _ in range(passes):
        shown = light.solve_amplitudes(shown, frame)
    return shown.lobes


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("case", [(16, 16, 0), (50, 50, 0), (64, 16, 6)])
def test_amplitudes_solve_the_reweighted_problem_as_scipy_does(
    form: Form, case: tuple[int, int, int]
) -> None:
    height, rows, refined = case
    lobes = stack([random_lobes(form), random_lobes(form, seed=3)]).to(torch.float32)
    scenes = [random_lobes(form, seed=2), random_lobes(form, seed=4)]
    if refined:  # narrow lobes as well, where there are texels
        narrow = torch.tensor([1.0, 1.0, 1.0, 1.0, 100.0])[:, None]
        lobes = replace(lobes, sharpness=lobes.sharpness * narrow)
        scenes = [
            replace(one, amplitude=2 * one.amplitude).to(DOUBLE) for one in (lobes[0], lobes[1])
        ]
    maps = torch.stack([texels.texel_means(scene, height, 2 * height) for scene in scenes])
    frame = target(flat(maps.float()), rows, refined)
    found = with_amplitudes(lobes, frame, passes=1)
    assert found.amplitude.dtype == torch.float32
    assert torch.equal(found.axes, lobes.axes)
    assert torch.equal(found.sharpness, lobes.sharpness)
    for index in range(2):
        expected = _solved_by_scipy(lobes, frame, maps[index].to(DOUBLE), index)
        # images in float32, and a ridge of 1e-5: lobes that stand in for each other share a little
        np.testing.assert_allclose(found.amplitude[index].numpy(), expected, rtol=2e-3, atol=2e-3)


def test_solving_amplitudes_shares_a_change_evenly_between_lobes_that_coincide() -> None:
    lamp = lamps([(1.0, 0.2, 0.0)] * 2 + [(0.0, 1.0, 0.0)], [50.0, 50.0, 2.0], [3.0, 1.0, 1.0])
    brighter = flat(2 * texels.texel_means(lamp, 32, 64)[None])
    amplitude = with_amplitudes(lamp[None], objective.target(brighter)).amplitude[0]
    expected = torch.tensor([5.0, 3.0, 2.0])[:, None].expand(-1, 3)  # 3 + 1 became 8
    # a footprint's image is a percent off a texel mean at the peak of the lobes two texels wide
    torch.testing.assert_close(amplitude, expected, rtol=5e-3, atol=1e-3)
    # and evenly but for the rounding of their images, which the ridge holds against the change
    rounding = (8 - 4) * 2**-24 / light.RIDGE
    assert float(amplitude[0, 0] - amplitude[1, 0]) == pytest.approx(2.0, abs=rounding)


def test_solving_amplitudes_never_raises_the_loss() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)[None]
    maps = torch.rand(1, 3, 2 * 64**2, generator=torch.Generator().manual_seed(0))
    frame = target(maps, 16, 8)
    values = [_loss(with_amplitudes(lobes, frame, passes), frame) for passes in range(5)]
    # a minimum of the majoriser, to the rounding of J
    assert all(b <= a + 1e-5 for a, b in itertools.pairwise(values))
    assert values[1] < 0.9 * values[0]


def test_solving_amplitudes_finds_known_light_again_from_black() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 900.0], [1.0, 8.0, 5.0])
    colours = truth.amplitude * torch.tensor([1.0, 0.5, 0.0])
    truth = replace(truth, amplitude=colours)[None]
    radiance = lobe_images.images(truth, adaptive_cells(torch.zeros(1, 3, 2 * 64**2))).radiance
    black = replace(truth, amplitude=torch.zeros(1, 3, 3))
    found = with_amplitudes(black, objective.target(radiance)).amplitude[0]
    # what is left of the error after a pass is that of the ridge and of float32
    torch.testing.assert_close(found, colours, rtol=2e-3, atol=2e-3)


def test_solving_amplitudes_leaves_a_lobe_dark_where_the_map_is() -> None:
    truth = lamps([(0.0, 1.0, 0.2), (1.0, -0.3, 0.0)], [40.0, 40.0], [2.0, 0.0])
    lit = replace(truth, amplitude=torch.ones(2, 3))[None]
    amplitude = with_amplitudes(lit, shown(truth, 32)).amplitude[0]
    assert float(amplitude.min()) >= 0.0
    # the reference is of means, the image a footprint: its ring would take a little of either sign
    torch.testing.assert_close(amplitude, truth.amplitude, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize(("height_rad", "seen_as"), [(0.0, 1.16), (0.024, 0.91)])
def test_light_by_texel_means_finds_that_of_a_streak_thinner_than_a_row(
    height_rad: float, seen_as: float
) -> None:
    axis_z = torch.tensor([0.0, math.sin(height_rad), math.cos(height_rad)])
    up = torch.tensor([0.0, math.cos(height_rad), -math.sin(height_rad)])
    axes = torch.stack([up, torch.linalg.cross(axis_z, up), axis_z])[None]
    streak = Lobes(axes, torch.tensor([[4000.0, 1.6]]), torch.full((1, 3), 20.0))
    truth = joined(streak, lamps([(0.0, 1.0, 0.2), (0.3, -1.0, 0.0)], [2.0, 1.0], [1.0, 0.5]))
    frame = shown(truth, 64)
    seen = light.last(lobe_images.images(truth[None], frame.places), frame)
    # between two rows of centres it looks darker than it is, on one brighter
    assert float(seen.lobes.amplitude[0, 0, 0]) == pytest.approx(20 * seen_as, rel=0.02)
    found = light.last_by_texel_means(seen, frame).lobes.amplitude[0]
    torch.testing.assert_close(found, truth.amplitude, rtol=1e-3, atol=1e-3)


def test_light_of_wide_lobes_alone_is_not_solved_again() -> None:
    truth = lamps([(0.0, 1.0, 0.2), (0.3, -1.0, 0.0)], [2.0, 1.0], [1.0, 0.5])
    frame = shown(truth, 64)
    seen = lobe_images.images(truth[None], frame.places)
    assert light.last_by_texel_means(seen, frame) is seen


@pytest.mark.parametrize("form", list(Form))
def test_frames_of_a_batch_do_not_see_each_other(form: Form) -> None:
    lobes = stack([random_lobes(form), random_lobes(form, seed=3)]).to(torch.float32)
    maps = torch.rand(2, 3, 2 * 64**2, generator=torch.Generator().manual_seed(0)) ** 4
    maps = maps * torch.tensor([1.0, 50.0])[:, None, None]
    both = with_amplitudes(lobes, target(maps, 16, 8)).amplitude
    for index in range(2):
        one = slice(index, index + 1)
        frame = target(maps[one], 16, 8)
        alone = with_amplitudes(lobes[one], frame).amplitude
        # float32 sums in another order, times the condition of the normal equations
        torch.testing.assert_close(both[one], alone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("form", list(Form))
def test_light_of_any_lobes_is_finite(form: Form) -> None:
    widths = torch.tensor([1e-3, 1.0, 1e3, 1e7])
    axes = random_lobes(form, 4).to(torch.float32).axes
    one = Lobes(axes, widths[:, None].expand(-1, 2), torch.full((4, 3), 1e-6), form)
    bright = replace(one, amplitude=torch.full((4, 3), 1e9))
    lobes = stack([one, bright, one, bright, one, bright])
    exposures = torch.tensor([1e-6, 1e-6, 1e9, 1e9, 0.0, 0.0])
    maps = torch.rand(1, 3, 2 * 32**2, generator=torch.Generator().manual_seed(0))
    maps = maps * exposures[:, None, None]
    found = with_amplitudes(lobes, target(maps, 16, 4)).amplitude
    assert bool(found.isfinite().all())
    assert float(found.min()) >= 0.0
    assert math.isfinite(float(found.sum()))


def test_lobes_that_stay_keep_their_light_and_the_others_make_up_for_it() -> None:
    """As the same problem with what they show taken off the map."""
    lobes = lamps([(0, 0, 1), (0.5, 0, 1), (0, 1, 0)], [20.0, 20.0, 2.0], [3.0, 2.0, 0.5])
    maps = texels.texel_means(lobes, 32, 64)[None]
    begun = replace(lobes, amplitude=lobes.amplitude * torch.tensor([[0.5], [1.3], [0.8]]))
    frame = target(flat(maps))
    still = torch.tensor([[True, False, False]])
    begun_shown = lobe_images.images(begun[None], frame.places)
    found = light.solve_amplitudes(begun_shown, frame, still).lobes.amplitude[0]
    assert torch.equal(found[0], begun.amplitude[0])
    own = begun_shown.light[:, :1].mT @ begun_shown.values[:, :1]
    others = lobe_images.images(begun.select(torch.tensor([1, 2]))[None], frame.places)
    alone = light.solve_amplitudes(others, objective.less(frame, own)).lobes.amplitude[0]
    torch.testing.assert_close(found[1:], alone, rtol=2e-4, atol=1e-5)
    all_still = torch.ones(1, 3, dtype=torch.bool)
    kept = light.solve_amplitudes(begun_shown, frame, all_still).lobes.amplitude[0]
    assert torch.equal(kept, begun.amplitude)


def test_a_matrix_that_no_ridge_makes_definite_leaves_the_light() -> None:
    gram = torch.tensor([[1.0, 9.0], [9.0, 1.0]], dtype=DOUBLE)  # no sum of squares
    near = torch.tensor([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], dtype=DOUBLE)
    assert torch.equal(light._non_negative(gram, 2 * near, near), near)
