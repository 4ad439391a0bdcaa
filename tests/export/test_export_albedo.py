# SPDX-License-Identifier: Apache-2.0
"""The polynomials that stand for the albedo are as near as they promise."""

import numpy as np
import torch
from numpy.polynomial.polynomial import polyval2d

from asglight.export import albedo
from asglight.shading import ggx


def test_albedo_is_within_its_error_at_every_f0() -> None:
    white_terms, grazing_terms = albedo.polynomials()
    cos_view = np.linspace(albedo.COS_VIEW_MIN, 1, 150)
    worst = 0.0
    for roughness in np.linspace(0.05, 1, 40):
        parts = ggx.albedo_parts(torch.from_numpy(cos_view), roughness**2).numpy()
        alpha = roughness**2
        x = cos_view * (1 + alpha) / (cos_view + alpha)
        white = polyval2d(2 * x - 1, np.full_like(x, 2 * alpha - 1), white_terms)
        y = np.full_like(x, 2 * roughness - 1)
        grazing = white * polyval2d(2 * np.sqrt(cos_view) - 1, y, grazing_terms)
        for f0 in (albedo.F0_MIN, 0.1, 0.3, 1.0):
            exact = parts @ [f0, 1.0]
            worst = max(worst, np.abs((f0 * (white - grazing) + grazing) / exact - 1).max())
    # Far below, the promise would be needlessly weak.
    assert 0.5 * albedo.ERROR_MAX < worst < albedo.ERROR_MAX
