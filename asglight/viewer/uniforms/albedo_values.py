# SPDX-License-Identifier: Apache-2.0
"""The GGX layer's directional albedo, at the places that shaders interpolate between."""

import functools

import numpy as np
import torch

from asglight.shading import ggx

SIZE = 49
"""Samples of n.v and of roughness, ends included, even in their roots: the albedo of sharp layers
changes near n.v = 0 and near the mirror. Between them linear interpolation is within 3e-3 above
n.v = 0.02, and within 0.01 below, from a roughness of 0.05 on
(tests/viewer/gl/test_viewer_albedo.py)."""

_COS_VIEW_MIN = 1e-6
"""Stands for n.v = 0, where the quadrature has 0/0. There the albedo is 1 for every roughness but
0; here it is within 2e-4 of that from a roughness of 0.05 on."""

_ROUGHNESS_MIN = 1e-3
"""Stands for a roughness of 0, a perfect mirror."""


@functools.cache
def albedo_values() -> np.ndarray:
    """Return A and B of `f0 A + B`.  [root of roughness, root of n.v, 2]."""
    place = torch.linspace(0, 1, SIZE, dtype=torch.float64)
    cos_view = place.square().clamp(min=_COS_VIEW_MIN)
    roughness = place.square().clamp(min=_ROUGHNESS_MIN)
    rows = [ggx.albedo_parts(cos_view, r * r) for r in roughness.tolist()]
    return torch.stack(rows).float().numpy()
