# SPDX-License-Identifier: Apache-2.0
"""Fibonacci directions: equal areas, and averages that vanish where they should."""

import math

import numpy as np
import pytest
import torch

from asglight.sphere import harmonics
from asglight.sphere.quadrature import fibonacci_directions


def _points(count: int) -> torch.Tensor:
    return fibonacci_directions(count, dtype=torch.float64)


def test_one_direction_is_plus_x_and_two_are_golden_angle_apart() -> None:
    assert _points(1).tolist() == [[1.0, 0.0, 0.0]]
    golden = 2 * math.pi / ((1 + math.sqrt(5)) / 2) ** 2
    r = math.sqrt(3) / 2
    expected = [[r, 0.5, 0.0], [r * math.cos(golden), -0.5, r * math.sin(golden)]]
    np.testing.assert_allclose(_points(2).numpy(), expected, atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 7, 768, 5000])
def test_every_direction_has_its_own_band_of_equal_area(count: int) -> None:
    points = _points(count)
    np.testing.assert_allclose(points.norm(dim=-1).numpy(), 1, atol=1e-15)
    band = torch.floor((1 - points[:, 1]) / 2 * count)
    assert band.tolist() == list(range(count)), "first is nearest +Y"


@pytest.mark.parametrize("count", [96, 768])
def test_caps_hold_their_share_of_directions(count: int) -> None:
    points = _points(count).numpy()
    axes = np.random.default_rng(0).normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    worst = 0.0
    for height in (-0.5, 0.0, 0.3, 0.7):
        share = (points @ axes.T > height).mean(axis=0)
        worst = max(worst, float(np.abs(share - (1 - height) / 2).max()))
    # random points would be off by 0.1 and 0.04; the spiral's discrepancy falls as count^-3/4
    assert worst < 1.5 * count**-0.75


@pytest.mark.parametrize("count", [96, 768])
def test_means_of_low_harmonics_vanish(count: int) -> None:
    means = harmonics.basis(6, _points(count)).mean(dim=0)
    assert means[0].item() == pytest.approx(math.sqrt(1 / (4 * math.pi)), rel=1e-14)
    # random directions give count^-1/2 / sqrt(4 pi) = 0.01 at 768; the spiral's error is 1 / count
    assert means[1:].abs().max().item() < 0.5 / count


def test_result_is_rounded_once_to_float32() -> None:
    assert torch.equal(fibonacci_directions(768), _points(768).float())
