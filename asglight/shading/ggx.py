# SPDX-License-Identifier: Apache-2.0
"""The GGX microfacet reflectance that every picture and number here means by "roughness".

`alpha = roughness^2`; distribution of Trowbridge and Reitz 1975 and Walter et al. 2007; Smith
shadowing and masking, height-correlated (Heitz 2014); Fresnel reflectance 1; single scattering, so
a white furnace is darker than 1 for rough surfaces. For the half vector h of view v and light l

    f = D(n, h) V(n.v, n.l),    V = G2 / (4 n.v n.l).
"""

import math

import numpy as np
import torch
from torch import Tensor

_NODES = 48
"""Of each of the two quadratures of `albedo_parts`: from a roughness of 0.05 on within 1e-3 of a
fine grid over visible normals at every n.v, down to 1e-6. What is left is of the kink where a light
passes the horizon."""


def distribution(sin2_half: Tensor, alpha: float) -> Tensor:
    """Return the GGX distribution D of half vectors, per steradian.

    It takes the sine because `1 - (n.h)^2` in float32 has no digits left where a sharp
    distribution has its peak.

    Args:
        sin2_half: sin^2 of the angle between normal and half vector.  [...]
        alpha: Roughness squared.

    Returns:
        D; at its peak `1 / (pi alpha^2)`.  [...]
    """
    alpha2 = alpha * alpha
    shape = alpha2 + (1 - alpha2) * sin2_half
    return (alpha2 / math.pi) / (shape * shape)


def visibility(cos_view: Tensor, cos_light: Tensor, alpha: float | Tensor) -> Tensor:
    """Return `V = G2 / (4 n.v n.l)`, height-correlated.

    Args:
        cos_view: n.v, > 0.  [...]
        cos_light: n.l, >= 0.  [...]
        alpha: Roughness squared.

    Returns:
        Broadcast of both.  [...]
    """
    alpha2 = alpha * alpha
    view_root = (alpha2 + (1 - alpha2) * cos_view * cos_view).sqrt()
    light_root = (alpha2 + (1 - alpha2) * cos_light * cos_light).sqrt()
    return 0.5 / (cos_light * view_root + cos_view * light_root)


def albedo(cos_view: Tensor, alpha: float) -> Tensor:
    """Return what a ball shows in a white furnace: the integral of f n.l over the lights.

    Args:
        cos_view: n.v, > 0.  [P]
        alpha: Roughness squared.

    Returns:
        In (0, 1], of the dtype of the cosines.  [P]
    """
    return albedo_parts(cos_view, alpha).sum(-1)


def albedo_parts(cos_view: Tensor, alpha: float) -> Tensor:
    """Return the directional albedo of Schlick's Fresnel term in the two parts `f0 A + B`.

    With `F = f0 + (1 - f0) (1 - v.h)^5` (Schlick 1994) the integral of f F n.l over the lights is
    linear in f0 (Karis 2013). The half vector's angle is taken by the share u of D's mass inside
    it, whose inverse is `sin^2 = alpha^2 u / (1 - (1 - alpha^2) u)`; `dl = 4 v.h dh`. At grazing
    angles the integrand grows as 1 / sqrt(1 - u), so Gauss and Legendre are over r of
    `u = 1 - r^2`, `du = 2 r dr`, where it does not, and over the azimuth.

    Args:
        cos_view: n.v, > 0.  [P]
        alpha: Roughness squared.

    Returns:
        A and B, both and their sum in [0, 1], of the dtype of the cosines.  [P, 2]
    """
    nodes, weights = (torch.from_numpy(a) / 2 for a in np.polynomial.legendre.leggauss(_NODES))
    root = nodes + 0.5
    share = (1 - root * root)[:, None]
    turn = math.pi * (nodes + 0.5)  # the other half circle is the same
    n_v = cos_view.double()[:, None, None]
    sin2 = alpha * alpha * share / (1 - (1 - alpha * alpha) * share)
    n_h = (1 - sin2).sqrt()
    v_h = (sin2 * (1 - n_v * n_v)).sqrt() * torch.cos(turn) + n_h * n_v  # [P, share, turn]
    n_l = (2 * v_h * n_h - n_v).clamp(min=0)
    integrand = 4 * visibility(n_v, n_l, alpha) * n_l * v_h.clamp(min=0) / n_h
    grazing = (1 - v_h).clamp(0, 1) ** 5
    parts = torch.stack([integrand * (1 - grazing), integrand * grazing], dim=-1)
    found = torch.einsum("putk,u,t->pk", parts, 2 * root * weights, weights)
    # Near n.v = 0 nearly all is reflected, and the quadrature's error must not make it more.
    return (found / found.sum(-1, keepdim=True).clamp(min=1)).to(cos_view)
