# SPDX-License-Identifier: Apache-2.0
"""The GGX layer's directional albedo, at the places that shaders interpolate between."""

import functools

import numpy as np
import torch

from asglight.shading import ggx

SIZE = 33
"""Samples of n.v and of roughness, ends included; between them linear interpolation is within
3e-3 above n.v = 0.06 and a roughness of 0.05 (tests/viewer/gl/test_viewer_albedo.py)."""

_COS_VIEW_MIN = 1e-3
"""Stands for n.v = 0, where the quadrature has 0/0; the albedo changes by 2e-3 between them."""

_ROUGHNESS_MIN = 1e-3
"""Stands for a roughness of 0, a perfect mirror."""


@functools.cache
def albedo_values() -> np.ndarray:
    """Return A and B of `f0 A + B`.  [roughness, n.v, 2]."""
    cos_view = torch.linspace(0, 1, SIZE, dtype=torch.float64).clamp(min=_COS_VIEW_MIN)
    rows = [
        ggx.albedo_parts(cos_view, max(i / (SIZE - 1), _ROUGHNESS_MIN) ** 2) for i in range(SIZE)
    ]
    return torch.stack(rows).float().numpy()
