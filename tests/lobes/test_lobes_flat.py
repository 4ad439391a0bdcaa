# SPDX-License-Identifier: Apache-2.0
"""The flat-topped form against its definition and against the sum of its terms."""

import math

import numpy as np
import pytest
import scipy.integrate
import torch
from lobe_samples import random_directions, random_lobes, value_of

from asglight.lobes import Form, Lobes, asg, flat
from asglight.lobes.data import stack


def test_the_terms_add_up_to_the_lobes() -> None:
    lobes = random_lobes(5, Form.FLAT, seed=3)
    directions = random_directions(200, seed=4)
    terms = flat.terms(lobes)
    assert terms.form is Form.ASG
    assert terms.count == 15
    found = asg.evaluate(terms, directions).numpy()
    expected = np.zeros((200, 3))
    for axes, s, amplitude in zip(lobes.axes, lobes.sharpness, lobes.amplitude, strict=True):
        value = value_of(Form.FLAT, axes.numpy(), s.numpy(), directions.numpy())
        expected += value[:, None] * amplitude.numpy()
    # terms of up to three times the value cancel
    np.testing.assert_allclose(found, expected, atol=1e-13 * expected.max())


def test_terms_of_frames_are_those_of_each_frame() -> None:
    frames = [random_lobes(3, Form.FLAT, seed) for seed in range(2)]
    together = flat.terms(stack(frames))
    for index, lobes in enumerate(frames):
        alone = flat.terms(lobes)
        assert torch.equal(together[index].sharpness, alone.sharpness)
        assert torch.equal(together[index].amplitude, alone.amplitude)


def test_summed_goes_by_the_order_of_the_terms() -> None:
    lobes = random_lobes(4, Form.FLAT, seed=8)
    directions = random_directions(30, seed=9)
    each = asg.unit_lobes(flat.terms(lobes), directions)  # [12, P]
    expected = asg.unit_lobes(lobes, directions)
    torch.testing.assert_close(flat.summed(each, 0), expected, rtol=1e-12, atol=1e-14)
    torch.testing.assert_close(flat.summed(each.mT, -1), expected.mT, rtol=1e-12, atol=1e-14)


def test_narrow_lobes_have_the_plane_integral_and_variance() -> None:
    def over_plane(power: int) -> float:
        """Integrate r^power 2 pi r (1 - (1 - exp(-r^2))^3) dr."""
        return scipy.integrate.quad(
            lambda r: 2 * math.pi * r ** (power + 1) * (1 - (1 - math.exp(-r * r)) ** 3), 0, 8
        )[0]

    integral, square = over_plane(0), over_plane(2)
    assert pytest.approx(integral / math.pi, rel=1e-9) == flat.INTEGRAL
    assert pytest.approx(square / integral, rel=1e-9) == flat.VARIANCE  # x^2 + y^2, twice 1 / 2
    lobes = random_lobes(1, Form.FLAT)
    narrow = Lobes(
        lobes.axes, torch.tensor([[4e4, 1e4]], dtype=torch.float64), lobes.amplitude, Form.FLAT
    )
    zeroth, _, second = asg.moments(narrow)
    # the sphere departs from its plane by a share of the variance, 1e-4
    assert zeroth.item() == pytest.approx(flat.INTEGRAL * math.pi / 2e4, rel=2e-4)
    per_variance = asg.per_variance(Form.FLAT)
    expected = [1 / (per_variance * 4e4), 1 / (per_variance * 1e4)]
    assert (second[0, :2] / zeroth).tolist() == pytest.approx(expected, rel=5e-4)


def test_the_top_is_flat_and_the_edge_steep() -> None:
    gaussian = torch.linspace(0, 1, 101, dtype=torch.float64)
    found = flat.values(gaussian)
    np.testing.assert_allclose(found.numpy(), 1 - (1 - gaussian.numpy()) ** 3, atol=1e-15)
    assert bool((found.diff() > 0).all())

    def radius(share: float) -> float:
        """Return where the form of sharpness 1 has a share of its peak."""
        return math.sqrt(-math.log(1 - (1 - share) ** (1 / 3)))

    assert (radius(0.1) - radius(0.9)) / radius(0.5) == pytest.approx(0.83, abs=0.005)
    assert pytest.approx(0.99, abs=0.003) == 1 - (1 - 0.8) ** 3


def test_as_flat_keeps_flux_and_spread_of_narrow_lobes() -> None:
    lobes = random_lobes(6, Form.ASG, seed=2)
    narrow = Lobes(lobes.axes, 50 * lobes.sharpness + 1000, lobes.amplitude)
    found = flat.as_flat(narrow)
    assert found.form is Form.FLAT
    one, other = asg.moments(narrow), asg.moments(found)
    # exact in a plane; on the sphere both depart from it by the variance, 5e-4 at most
    torch.testing.assert_close(asg.flux(found), asg.flux(narrow), rtol=1e-3, atol=0)
    expected = one.second[:, :2] / one.zeroth[:, None]
    torch.testing.assert_close(
        other.second[:, :2] / other.zeroth[:, None], expected, rtol=2e-3, atol=0
    )
