# SPDX-License-Identifier: Apache-2.0
"""The projection on harmonics against scipy's."""

import math

import numpy as np
import pytest
import scipy.special
import torch

from asglight.peers import spherical_harmonics
from asglight.sphere import latlong


def test_coefficients_are_the_projection_on_the_harmonics_of_scipy() -> None:
    reference = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(0)).double()
    found = spherical_harmonics.fit(reference, 48)
    assert found.degree == 3
    x, y, z = latlong.directions(16, 32, dtype=torch.float64).numpy().reshape(-1, 3).T
    flux = (latlong.texel_solid_angles(16, 32, dtype=torch.float64)[..., None] * reference).numpy()
    flux = flux.reshape(-1, 3)
    for l in range(4):  # noqa: E741
        for m in range(-l, l + 1):
            harmonic = scipy.special.sph_harm_y(l, abs(m), np.arccos(z), np.arctan2(y, x))
            harmonic = harmonic * (-1.0) ** m  # scipy has the Condon-Shortley phase, ours has not
            part = harmonic.real if m >= 0 else harmonic.imag
            real = part * (math.sqrt(2) if m else 1.0)
            np.testing.assert_allclose(
                found.coefficients[l * (l + 1) + m].numpy(), real @ flux, atol=1e-12
            )


@pytest.mark.parametrize(("floats", "degree"), [(3, 0), (11, 0), (12, 1), (48, 3), (120, 5)])
def test_a_budget_buys_whole_degrees(floats: int, degree: int) -> None:
    found = spherical_harmonics.fit(torch.ones(8, 16, 3), floats)
    assert found.degree == degree
    assert found.floats == 3 * (degree + 1) ** 2


def test_a_linear_map_is_reproduced() -> None:
    """Degree 1 holds a + b.d exactly; the grid's sums of products of harmonics hold it nearly."""
    directions = latlong.directions(64, 128)
    reference = 2 + directions @ torch.tensor([[0.5, 1, 0], [0, 1, 0.2], [0.3, 0, 1]])
    fit = spherical_harmonics.fit(reference, 12).texel_means(64, 128)
    # the midpoint rule misses (2 pi / 64)^2 / 24 = 4e-4 of a product of two of degree 1
    torch.testing.assert_close(fit, reference, rtol=0, atol=2e-3)
