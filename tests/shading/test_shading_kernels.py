# SPDX-License-Identifier: Apache-2.0
"""Filter kernels against the standard GGX distribution, quadrature, and plain sums in numpy."""

import math

import numpy as np
import pytest
import scipy.integrate
import torch

from asglight.shading import kernels

ROUGHNESS = [0.05, 0.1, 0.25, 0.5, 1.0]


def _directions(count: int, seed: int = 0) -> torch.Tensor:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return torch.from_numpy(points / np.linalg.norm(points, axis=1, keepdims=True))


def _constant(value: float, height: int = 32, count: int = 1) -> torch.Tensor:
    return torch.full((count, height, 2 * height, 3), value, dtype=torch.float64)


def _grid(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return directions [H, W, 3] and exact solid angles [H, 1], written out here."""
    latitude = np.pi / 2 - np.pi * (np.arange(height) + 0.5) / height
    longitude = np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width
    latitude, longitude = np.meshgrid(latitude, longitude, indexing="ij")
    d = [
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude),
        np.cos(latitude) * np.cos(longitude),
    ]
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return np.stack(d, axis=-1), (2 * np.pi / width * (edges[:-1] - edges[1:]))[:, None]


def _ggx_distribution(normal_half: np.ndarray, alpha: float) -> np.ndarray:
    """Return D of Walter et al. 2007: its cosine over the half vectors integrates to 1."""
    return alpha**2 / (np.pi * (normal_half**2 * (alpha**2 - 1) + 1) ** 2)


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_the_integral_of_ggx_is_that_of_quadrature(roughness: float) -> None:
    def value(cosine: float) -> float:
        return float(kernels.ggx(torch.tensor(cosine, dtype=torch.float64), roughness))

    peak = 1 - roughness**4  # where quadrature is to look closer
    found, _ = scipy.integrate.quad(value, 0, 1, points=[peak], limit=400, epsrel=1e-11)
    assert kernels.ggx_integral(roughness) == pytest.approx(2 * math.pi * found, rel=1e-8)


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_ggx_kernel_is_the_distribution_at_the_half_vector_times_the_cosine(
    roughness: float,
) -> None:
    alpha = roughness**2
    normal, lights = _directions(1)[0].numpy(), _directions(3000, 1).numpy()
    half = normal + lights
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    expected = _ggx_distribution(half @ normal, alpha) * np.maximum(lights @ normal, 0)
    found = kernels.ggx(torch.from_numpy(lights @ normal), roughness).numpy()
    # the kernel leaves out the constant alpha^2 / pi
    np.testing.assert_allclose(found * alpha**2 / np.pi, expected, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_ggx_kernel_at_its_peak_keeps_its_digits_in_float32(roughness: float) -> None:
    angle = np.geomspace(1e-3, 1.0, 200)
    cosine = torch.from_numpy(np.cos(angle)).float()
    half = np.sqrt((1 + cosine.double().numpy()) / 2)
    expected = _ggx_distribution(half, roughness**2) * cosine.double().numpy()
    found = kernels.ggx(cosine, roughness).double().numpy() * roughness**4 / np.pi
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_kernels_are_black_below_the_horizon() -> None:
    below = torch.linspace(-1, 0, 50, dtype=torch.float64)
    assert (kernels.lambert(below) == 0).all()
    assert (kernels.ggx(below, 0.3) == 0).all()


def test_lambert_kernel_is_the_cosine_over_pi_and_integrates_to_one() -> None:
    cosine = torch.tensor([1.0, 0.5, 0.25], dtype=torch.float64)
    expected = [1 / math.pi, 0.5 / math.pi, 0.25 / math.pi]
    assert kernels.lambert(cosine).tolist() == pytest.approx(expected, rel=1e-15)
    total, _ = scipy.integrate.quad(
        lambda c: 2 * math.pi * kernels.lambert(torch.tensor(c, dtype=torch.float64)).item(), -1, 1
    )
    assert total == pytest.approx(1, rel=1e-12)


def test_kernel_values_choose_by_name_or_roughness() -> None:
    cosine = torch.linspace(-1, 1, 21, dtype=torch.float64)
    assert torch.equal(kernels.kernel_values(kernels.LAMBERT, cosine), kernels.lambert(cosine))
    assert torch.equal(kernels.kernel_values(0.4, cosine), kernels.ggx(cosine, 0.4))


@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_a_white_furnace_stays_white_for_every_roughness(roughness: float) -> None:
    found = kernels.filtered(_constant(0.7), roughness, _directions(40))
    np.testing.assert_allclose(found.numpy(), 0.7, rtol=1e-13)


def test_irradiance_over_pi_of_a_constant_map_is_the_constant() -> None:
    found = kernels.filtered(_constant(3.0, height=64), kernels.LAMBERT, _directions(60))
    # the midpoint rule over 64 rows: the clamp's kink and exact areas cost up to 2e-4
    np.testing.assert_allclose(found.numpy(), 3.0, rtol=3e-4)
    exact = kernels.filtered(_constant(3.0), kernels.LAMBERT, _directions(60), normalised=True)
    np.testing.assert_allclose(exact.numpy(), 3.0, rtol=1e-13)


def test_ggx_without_normalisation_is_the_kernels_integral() -> None:
    roughness = 0.5
    integral, _ = scipy.integrate.quad(
        lambda c: 2 * math.pi * kernels.ggx(torch.tensor(c, dtype=torch.float64), roughness).item(),
        0,
        1,
    )
    found = kernels.filtered(_constant(1.0, 128), roughness, _directions(20), normalised=False)
    # texels of 0.025 on a peak of 0.25: second order, measured 1e-4
    np.testing.assert_allclose(found.numpy(), integral, rtol=1e-3)


@pytest.mark.parametrize("kernel", [kernels.LAMBERT, 0.25, 0.5])
def test_filtered_equals_a_plain_sum_over_texels(
    kernel: str | float, monkeypatch: pytest.MonkeyPatch
) -> None:
    height, width = 10, 20
    maps = np.random.default_rng(3).lognormal(sigma=2, size=(3, height, width, 3))
    normals = _directions(20, 4).numpy()
    monkeypatch.setattr(kernels, "BLOCK", 85 * len(normals))  # three blocks, one short
    texels, solid_angle = _grid(height, width)
    expected = np.zeros((3, len(normals), 3))
    for p, normal in enumerate(normals):
        cosine = texels @ normal
        if isinstance(kernel, str):
            weight = np.maximum(cosine, 0) / np.pi * solid_angle
        else:
            half = np.sqrt(np.maximum((1 + cosine) / 2, 0))
            weight = _ggx_distribution(half, kernel**2) * np.maximum(cosine, 0) * solid_angle
            weight = weight / weight.sum()
        expected[:, p] = np.einsum("hw,khwc->kc", weight, maps)
    found = kernels.filtered(torch.from_numpy(maps), kernel, torch.from_numpy(normals))
    assert found.shape == expected.shape
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-11)


@pytest.mark.parametrize(("degree", "factor"), [(1, 2 / 3), (2, 1 / 4), (3, 0.0), (4, -1 / 24)])
def test_lambert_scales_a_harmonic_by_its_factor(degree: int, factor: float) -> None:
    """A zonal map P_l(y) filtered with the cosine is A_l / pi times itself."""
    height = 128
    texels, _ = _grid(height, 2 * height)
    polynomial = np.polynomial.Legendre.basis(degree)
    zonal = torch.from_numpy(polynomial(texels[..., 1]))[None, ..., None].expand(1, -1, -1, 3)
    normals = _directions(40, 5)
    found = kernels.filtered(zonal, kernels.LAMBERT, normals)[0, :, 1].numpy()
    expected = factor * polynomial(normals[:, 1].numpy())
    np.testing.assert_allclose(found, expected, atol=1e-4)  # second order in texels of 0.025


def test_a_lamp_of_one_texel_shows_the_kernel_itself() -> None:
    height, width = 16, 32
    texels, solid_angle = _grid(height, width)
    image = torch.zeros(1, height, width, 3, dtype=torch.float64)
    image[0, 5, 9, 0] = 2.0
    normals = _directions(30, 6)
    found = kernels.filtered(image, 0.3, normals, normalised=False)[0]
    expected = 2 * solid_angle[5, 0] * kernels.ggx(normals @ torch.from_numpy(texels[5, 9]), 0.3)
    torch.testing.assert_close(found[:, 0], expected, rtol=1e-12, atol=1e-15)
    assert (found[:, 1:] == 0).all()


def test_filtered_keeps_float32() -> None:
    maps = torch.rand(1, 8, 16, 3, generator=torch.Generator().manual_seed(0))
    found = kernels.filtered(maps, 0.25, _directions(5).float())
    assert found.dtype == torch.float32
    wide = kernels.filtered(maps.double(), 0.25, _directions(5))
    np.testing.assert_allclose(found.numpy(), wide.numpy(), rtol=1e-5)
