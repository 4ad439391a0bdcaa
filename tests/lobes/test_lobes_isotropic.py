# SPDX-License-Identifier: Apache-2.0
"""Lobes as sg lobes: flux and spread against quadrature in numpy, limits against closed forms."""

import math

import numpy as np
import pytest
import torch
from lobe_cases import random_lobes
from numpy.typing import NDArray
from scipy.optimize import brentq

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.isotropic import as_sg, held_between

SHAPES = [(0.01, 0.01), (3.0, 1.0), (20.0, 2.0), (50.0, 50.0), (200.0, 20.0)]


def single(sharpness: tuple[float, float], form: Form) -> Lobes:
    return Lobes(
        torch.eye(3, dtype=torch.float64)[None],
        torch.tensor([sharpness], dtype=torch.float64),
        torch.tensor([[3.0, 2.0, 0.0]], dtype=torch.float64),
        form,
    )


def upper_moments(lobes: Lobes) -> NDArray[np.float64]:
    """Integrate one lobe of +Z, and x^2 + y^2 times it, over z > 0, by a product rule.

    400 nodes in sin^2 of half the angle, crowded to the pole by a square, and 256 around: far
    beyond what sharpness 200 at a ratio of 10 needs for 1e-9.
    """
    nodes, weights = np.polynomial.legendre.leggauss(400)
    t = (nodes + 1) / 2
    z = 1 - t**2  # dz = 2 t dt
    phi = (np.arange(256) + 0.5) * (2 * np.pi / 256)
    rho = np.sqrt(1 - z**2)[:, None]
    x, y = rho * np.cos(phi), rho * np.sin(phi)
    (sx, sy), form = lobes.sharpness[0].tolist(), lobes.form
    if form is Form.SG:
        values = np.exp(sx * (z[:, None] - 1)) + 0 * x
    else:
        window = z[:, None] if form is Form.ASG else 1.0
        values = window * np.exp(-sx * x**2 - sy * y**2)
    measure = (weights * t * (2 * np.pi / 256))[:, None]
    return np.array([(measure * values).sum(), (measure * values * rho**2).sum()])


def sg_flux_and_spread(sharpness: float) -> tuple[float, float]:
    """Return the integral of an sg and E[x^2 + y^2], in closed form."""
    langevin = 1 / math.tanh(sharpness) - 1 / sharpness
    return 2 * math.pi * -math.expm1(-2 * sharpness) / sharpness, 2 * langevin / sharpness


@pytest.mark.parametrize("sharpness", SHAPES)
def test_an_asg_keeps_flux_and_spread(sharpness: tuple[float, float]) -> None:
    lobes = single(sharpness, Form.ASG)
    found = as_sg(lobes)
    assert found.form is Form.SG
    assert torch.equal(found.axes, lobes.axes)
    zeroth, across = upper_moments(lobes)
    flux, spread = sg_flux_and_spread(float(found.sharpness[0, 0]))
    # rtol: the quadratures of both sides
    np.testing.assert_allclose(spread, across / zeroth, rtol=1e-9)
    np.testing.assert_allclose(found.amplitude[0] * flux, lobes.amplitude[0] * zeroth, rtol=1e-9)
    assert float(found.sharpness[0, 1]) == float(found.sharpness[0, 0])


@pytest.mark.parametrize("sharpness", SHAPES)
def test_a_bingham_is_two_of_half_the_flux(sharpness: tuple[float, float]) -> None:
    lobes = single(sharpness, Form.BINGHAM)
    found = as_sg(lobes)
    assert found.axis_z.tolist() == [[0, 0, 1], [0, 0, -1]]
    torch.testing.assert_close(torch.linalg.det(found.axes), torch.ones(2).double())
    zeroth, across = upper_moments(lobes)  # of one half
    flux, spread = sg_flux_and_spread(float(found.sharpness[0, 0]))
    np.testing.assert_allclose(found.amplitude * flux, lobes.amplitude.repeat(2, 1) * zeroth, 1e-9)
    # An even sphere has the spread 2/3 and sharpness 0; lobes end at 1e-3.
    np.testing.assert_allclose(spread, across / zeroth, rtol=2e-3 if sharpness[0] < 1 else 1e-9)


def test_the_broadest_asg_is_the_sg_of_a_cosine() -> None:
    # E[x^2] of a cosine over the hemisphere is 1/4
    expected = brentq(lambda s: sg_flux_and_spread(s)[1] - 0.5, 1, 5)
    found = float(as_sg(single((1e-3, 1e-3), Form.ASG)).sharpness[0, 0])
    assert found == pytest.approx(expected, rel=1e-3)  # first order in the sharpness


def test_the_narrowest_asg_has_the_harmonic_mean_twice() -> None:
    # E[x^2] is 1 / (2 sx) of an asg and 1 / s of an sg, up to 1 / s of it
    found = float(as_sg(single((1e7, 1e5), Form.ASG)).sharpness[0, 0])
    assert found == pytest.approx(2 * 2 / (1e-7 + 1e-5), rel=1e-5)


def test_an_sg_is_left_as_it_is() -> None:
    lobes = random_lobes(Form.SG)
    assert as_sg(lobes) is lobes


def test_lobes_beyond_limits_keep_their_flux_and_others_every_bit() -> None:
    sharpness = torch.tensor([0.1, 0.5, 7.0, 30.0, 1e5])
    lobes = Lobes(
        torch.eye(3).expand(5, 3, 3),
        sharpness[:, None].expand(5, 2),
        torch.tensor([[0.1, 0.3, 900.0]]).expand(5, 3),
        Form.SG,
    )
    found = held_between(lobes, 0.5, 30.0)
    assert found.sharpness[:, 0].tolist() == [0.5, 0.5, 7.0, 30.0, 30.0]
    assert torch.equal(found.amplitude[1:4], lobes.amplitude[1:4])
    for index in (0, 4):
        was, _ = sg_flux_and_spread(float(sharpness[index]))
        now, _ = sg_flux_and_spread(float(found.sharpness[index, 0]))
        ratio = found.amplitude[index] / lobes.amplitude[index]
        np.testing.assert_allclose(ratio, was / now, rtol=3e-7)  # two roundings of float32


def test_any_batch_and_dtype_comes_back() -> None:
    lobes = random_lobes(Form.ASG, 6).to(torch.float32)
    shot = Lobes(
        lobes.axes.reshape(2, 3, 3, 3),
        lobes.sharpness.reshape(2, 3, 2),
        lobes.amplitude.reshape(2, 3, 3),
    )
    found = as_sg(shot)
    assert found.axes.shape == (2, 3, 3, 3)
    assert found.sharpness.dtype is torch.float32
    torch.testing.assert_close(found.sharpness.reshape(6, 2), as_sg(lobes).sharpness)
    torch.testing.assert_close(asg.flux(found), asg.flux(shot), rtol=1e-6, atol=0)
