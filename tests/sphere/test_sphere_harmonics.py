# SPDX-License-Identifier: Apache-2.0
"""Real harmonics against scipy's complex ones, and the cosine's factors against quadrature."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.special
import torch

from asglight.sphere import harmonics

DEGREE = 8


def _random_directions(count: int) -> np.ndarray:
    points = np.random.default_rng(3).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def _quadrature(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights exact for all polynomials below degree 2 * order."""
    z, weight = np.polynomial.legendre.leggauss(order)
    phi = 2 * np.pi * np.arange(2 * order) / (2 * order)
    z, phi = (a.ravel() for a in np.meshgrid(z, phi, indexing="ij"))
    r = np.sqrt(1 - z * z)
    weights = np.repeat(weight, 2 * order) * (2 * np.pi / (2 * order))
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1), weights


def _scipy_harmonic(degree: int, order: int, directions: np.ndarray) -> np.ndarray:
    x, y, z = directions.T
    theta, phi = np.arccos(z), np.arctan2(y, x)
    value = scipy.special.sph_harm_y(degree, abs(order), theta, phi)
    value = value * (-1.0) ** order  # scipy has the Condon-Shortley phase
    if order == 0:
        return value.real
    return math.sqrt(2) * (value.real if order > 0 else value.imag)


@pytest.mark.skipif(
    not hasattr(scipy.special, "sph_harm_y"), reason="scipy older than 1.15 has no sph_harm_y"
)
@pytest.mark.parametrize("degree", range(DEGREE + 1))
def test_basis_equals_scipy(degree: int) -> None:
    directions = _random_directions(200)
    found = harmonics.basis(degree, torch.from_numpy(directions)).numpy()
    for order in range(-degree, degree + 1):
        expected = _scipy_harmonic(degree, order, directions)
        column = found[:, degree * (degree + 1) + order]
        # arccos of z near 1 costs scipy's side eight digits of theta at the worst node
        np.testing.assert_allclose(column, expected, atol=1e-12, err_msg=f"l={degree} m={order}")


def test_basis_is_orthonormal() -> None:
    directions, weights = _quadrature(DEGREE + 1)
    values = harmonics.basis(DEGREE, torch.from_numpy(directions)).numpy()
    gram = values.T @ (weights[:, None] * values)
    np.testing.assert_allclose(gram, np.eye((DEGREE + 1) ** 2), atol=1e-13)


def test_low_degrees_are_the_textbook_polynomials() -> None:
    x, y, z = (d := _random_directions(20)).T
    one, three = math.sqrt(1 / (4 * math.pi)), math.sqrt(3 / (4 * math.pi))
    fifteen, five = math.sqrt(15 / (4 * math.pi)), math.sqrt(5 / (16 * math.pi))
    expected = [one + 0 * x, three * y, three * z, three * x]
    expected += [fifteen * x * y, fifteen * y * z, five * (3 * z * z - 1), fifteen * x * z]
    expected += [fifteen / 2 * (x * x - y * y)]
    found = harmonics.basis(2, torch.from_numpy(d)).numpy()
    np.testing.assert_allclose(found, np.stack(expected, axis=1), atol=1e-15)


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_basis_and_its_gradient_are_finite_at_the_poles(pole: float) -> None:
    direction = torch.tensor([[0.0, 0.0, pole]], dtype=torch.float64, requires_grad=True)
    values = harmonics.basis(DEGREE, direction)
    values.sum().backward()
    for degree in range(DEGREE + 1):
        expected = math.sqrt((2 * degree + 1) / (4 * math.pi)) * pole**degree
        assert values[0, degree * (degree + 1)].item() == pytest.approx(expected, rel=1e-14)
    off_axis = values[0, [4, 5, 7, 8]]
    assert off_axis.abs().max().item() == 0
    assert direction.grad is not None
    assert torch.isfinite(direction.grad).all()


@pytest.mark.parametrize("degree", range(13))
def test_lambert_factors_are_the_cosines_legendre_coefficients(degree: int) -> None:
    polynomial = scipy.special.legendre(degree)
    expected, _ = scipy.integrate.quad(
        lambda c: 2 * math.pi * c * polynomial(c), 0, 1, epsabs=1e-12
    )
    found = harmonics.lambert_factors(degree)[degree * degree :]
    assert found.shape == (2 * degree + 1,)
    assert found.dtype == torch.float64
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-12)


def test_lambert_factors_begin_with_the_known_constants() -> None:
    found = harmonics.lambert_factors(4)
    for index, value in {
        0: math.pi,
        2: 2 * math.pi / 3,
        6: math.pi / 4,
        12: 0,
        20: -math.pi / 24,
    }.items():
        assert found[index].item() == pytest.approx(value, abs=1e-15)


def test_factors_turn_radiance_into_irradiance() -> None:
    """Irradiance of a degree-2 radiance from its coefficients equals the cosine integral."""
    nodes, weights = _quadrature(60)
    rng = np.random.default_rng(5)
    coefficients = rng.normal(size=9)
    radiance = harmonics.basis(2, torch.from_numpy(nodes)).numpy() @ coefficients
    normals = _random_directions(6)
    brute = [(weights * radiance * np.clip(nodes @ n, 0, None)).sum() for n in normals]
    factors = harmonics.lambert_factors(2).numpy()
    exact = harmonics.basis(2, torch.from_numpy(normals)).numpy() @ (factors * coefficients)
    # the clamp's kink leaves the product rule of 60 x 120 nodes 2.5e-5
    np.testing.assert_allclose(exact, brute, atol=1e-4)
