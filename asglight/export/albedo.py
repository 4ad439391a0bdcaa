# SPDX-License-Identifier: Apache-2.0
"""The GGX layer's directional albedo `f0 A + B` as two polynomials, for shaders without a table.

    A + B = P(n.v (1 + alpha) / (n.v + alpha), alpha)
    B     = (A + B) Q(sqrt(n.v), roughness)

alpha is roughness squared. The first variable of P follows from how smooth layers look: near
grazing their albedo depends on n.v / alpha alone. The root in Q spreads out what happens there.
"""

import functools

import numpy as np
import torch
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from asglight.shading import ggx
from asglight.shading.ggx_layer import ROUGHNESS_MAX, ROUGHNESS_MIN

TERMS = 7
"""Of each polynomial in each variable: degree 6. With 6 the error is twice as large."""

COS_VIEW_MIN = 0.01
"""Least n.v of the fit; below, its value is taken. The quadrature has 0/0 at 0."""

F0_MIN = 0.04
"""Least f0 that the errors are promised for: glass and plastics."""

ERROR_MAX = 0.02
"""Largest relative error of `f0 A + B` from F0_MIN to 1, from COS_VIEW_MIN and ROUGHNESS_MIN on
(tests/export/test_export_albedo.py); a fifth of what closed-form shading leaves such a layer."""

_SAMPLES = 60, 30
"""Of n.v and roughness: eight and four for each term, so that nothing is left between them."""

_ROUNDS, _POWER, _WEIGHT_MIN = 12, 0.4, 0.01
"""Least squares weighted anew with the error: towards the least largest error. More rounds change
the error by less than 1e-3; the power and the least weight keep the weights from jumping."""


@functools.cache
def polynomials() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit P and Q, each to the least relative error: of Q that at F0_MIN, where B counts most.

    Returns:
        For each the coefficients of (2 x - 1)^i (2 y - 1)^j.  [TERMS, TERMS], [TERMS, TERMS]
    """
    # Denser near grazing and near the mirror, where the albedo changes.
    cos_view = np.linspace(COS_VIEW_MIN**0.5, 1, _SAMPLES[0]) ** 2
    roughness = np.linspace(ROUGHNESS_MIN**0.5, ROUGHNESS_MAX**0.5, _SAMPLES[1]) ** 2
    parts = np.stack([ggx.albedo_parts(torch.from_numpy(cos_view), r * r) for r in roughness])
    white = parts.sum(-1)
    least = F0_MIN * parts[..., 0] + parts[..., 1]
    v, r = np.meshgrid(cos_view, roughness)
    alpha = r * r
    return (
        _fitted(v * (1 + alpha) / (v + alpha), alpha, np.ones_like(white), 1 / white),
        _fitted(v**0.5, r, parts[..., 1] / least, white / least),
    )


def _fitted(x: NDArray, y: NDArray, values: NDArray, factor: NDArray) -> NDArray[np.float64]:
    """Fit `factor` times a polynomial to values."""
    basis = chebyshev.chebvander2d(2 * x.ravel() - 1, 2 * y.ravel() - 1, [TERMS - 1, TERMS - 1])
    basis *= factor.ravel()[:, None]
    weight = np.ones(values.size)
    for _ in range(_ROUNDS):
        found = np.linalg.lstsq(basis * weight[:, None], values.ravel() * weight, rcond=None)[0]
        error = np.abs(basis @ found - values.ravel())
        weight *= (error / error.max() + _WEIGHT_MIN) ** _POWER
        weight /= weight.max()
    to_powers = np.stack(
        [np.pad(p, (0, TERMS - len(p))) for p in map(chebyshev.cheb2poly, np.eye(TERMS))]
    )
    return to_powers.T @ found.reshape(TERMS, TERMS) @ to_powers
