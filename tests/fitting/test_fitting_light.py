# SPDX-License-Identifier: Apache-2.0
"""Amplitudes alone: against scipy's non-negative least squares, and what they do to the loss."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch
from lobe_cases import lamps, random_lobes

from asglight.fitting import light, lobe_images, objective
from asglight.fitting.grid import grid
from asglight.fitting.probes import probe
from asglight.lobes import Form, Lobes, texels


def _loss(lobes: Lobes, frame: objective.Target) -> float:
    return float(objective.value(lobe_images.images(lobes, frame.grid).radiance, frame))


@pytest.mark.parametrize("form", list(Form))
@pytest.mark.parametrize("height", [16, 50])
def test_relight_solves_the_reweighted_problem_as_scipy_does(form: Form, height: int) -> None:
    lobes = random_lobes(form).to(torch.float32)
    reference = texels.texel_means(random_lobes(form, seed=2), height, 2 * height).float()
    frame = objective.target(reference)
    found = light.relight(lobes, frame, passes=1)
    assert found.amplitude.dtype == torch.float32
    assert torch.equal(found.axes, lobes.axes)
    assert torch.equal(found.sharpness, lobes.sharpness)

    values = lobe_images.images(lobes, grid(height)).values
    misfit = objective.misfit(lobes.amplitude.mT @ values, frame)
    rows, targets = [], []
    for view, truth, weight in zip(
        (values, *probe(values, height)),
        (frame.radiance, *probe(frame.radiance, height)),
        (misfit.env_weight, *misfit.probe_weights),
        strict=True,
    ):
        root = weight.sqrt()
        rows.append((root * view).mT.double().numpy())
        targets.append((root * truth).mT.double().numpy())
    expected = np.stack(
        [
            scipy.optimize.nnls(np.concatenate(rows), np.concatenate(targets)[:, channel])[0]
            for channel in range(3)
        ],
        axis=-1,
    )
    # the Gram matrix in float32 loses half the digits of the least squares problem
    np.testing.assert_allclose(found.amplitude.numpy(), expected, rtol=2e-3, atol=2e-3)


def test_relight_shares_a_change_evenly_between_lobes_that_coincide() -> None:
    lamp = lamps([(1, 0.2, 0)] * 2 + [(0, 1, 0)], [50.0, 50.0, 2.0], [3.0, 1.0, 1.0])
    frame = objective.target(2 * texels.texel_means(lamp, 32, 64))
    amplitude = light.relight(lamp, frame).amplitude
    expected = torch.tensor([5.0, 3.0, 2.0])[:, None].expand(-1, 3)  # 3 + 1 became 8
    # the Gram matrix is summed in float32, and lobe 2 can stand in for a little of both
    torch.testing.assert_close(amplitude, expected, rtol=5e-3, atol=1e-3)


def test_relight_never_raises_the_loss() -> None:
    lobes = random_lobes(Form.ASG).to(torch.float32)
    frame = objective.target(torch.rand(32, 64, 3, generator=torch.Generator().manual_seed(0)))
    values = [_loss(light.relight(lobes, frame, passes), frame) for passes in range(5)]
    # a minimum of the majoriser, to the rounding of J
    assert all(b <= a + 1e-5 for a, b in itertools.pairwise(values))
    assert values[1] < 0.9 * values[0]


def test_relight_finds_known_light_again_from_black() -> None:
    truth = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 900.0], [1.0, 8.0, 5.0])
    colours = truth.amplitude * torch.tensor([1.0, 0.5, 0.0])
    truth = replace(truth, amplitude=colours)
    frame = objective.target(lobe_images.images(truth, grid(64)).radiance.mT.reshape(64, 128, 3))
    black = replace(truth, amplitude=torch.zeros(3, 3))
    # what is left of the error after a pass is that of the ridge and of float32
    torch.testing.assert_close(light.relight(black, frame).amplitude, colours, rtol=2e-3, atol=2e-3)


def test_relight_leaves_a_lobe_dark_where_the_map_is() -> None:
    truth = lamps([(0, 1, 0.2), (1, -0.3, 0)], [40.0, 40.0], [2.0, 0.0])
    frame = objective.target(texels.texel_means(truth, 32, 64))
    lit = replace(truth, amplitude=torch.ones(2, 3))
    amplitude = light.relight(lit, frame).amplitude
    assert float(amplitude.min()) >= 0.0
    # the reference is of means, the lobe sampled: its ring would take a little of either sign
    torch.testing.assert_close(amplitude, truth.amplitude, rtol=1e-2, atol=1e-3)
