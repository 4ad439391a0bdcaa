# SPDX-License-Identifier: Apache-2.0
"""Dawson's function against scipy's."""

import numpy as np
import torch
from scipy.special import dawsn

from asglight.sphere.dawson import dawson


def test_it_agrees_with_scipy_from_the_least_to_the_largest_sharpness() -> None:
    """Lobes ask for 0.03 to 3,000, the root of the sharpness; the sum is exact to 5e-16 of 1."""
    x = np.concatenate([[0.0], np.logspace(-3, 4, 5000), np.linspace(0, 12, 5000)])
    found = dawson(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(found, dawsn(x), rtol=4e-15, atol=5e-16)
