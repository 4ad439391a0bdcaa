# SPDX-License-Identifier: Apache-2.0
"""Real spherical harmonics, and the Lambertian light map they give.

Y_lm for m > 0 is sqrt(2) Re, for m < 0 sqrt(2) Im of the complex harmonic, without the
Condon-Shortley phase, orthonormal over the sphere; the polar axis is +Z.
Coefficient index: l (l + 1) + m.
"""

import math

import torch
from torch import Tensor


def basis(degree: int, directions: Tensor) -> Tensor:
    """Evaluate all real harmonics up to a degree.

    Associated Legendre functions divided by sin^m are built by the three-term recurrence
    [Press et al., "Numerical Recipes", section 6.8], azimuths by the angle-sum recurrence.

    Args:
        degree: Highest l.
        directions: Unit directions.  [P, 3]

    Returns:
        Basis values.  [P, (degree + 1)^2]
    """
    x, y, z = directions.unbind(-1)
    cos_m, sin_m = torch.ones_like(x), torch.zeros_like(x)  # sin^m(theta) times cos, sin of m phi
    columns: dict[int, Tensor] = {}
    diagonal = 1.0  # (2 m - 1)!!
    for m in range(degree + 1):
        previous, legendre = torch.zeros_like(z), torch.full_like(z, diagonal)
        for l in range(m, degree + 1):  # noqa: E741
            norm = math.sqrt(
                (2 * l + 1) / (4 * math.pi) * math.factorial(l - m) / math.factorial(l + m)
            )
            norm *= math.sqrt(2) if m else 1.0
            columns[l * (l + 1) + m] = norm * legendre * cos_m
            if m:
                columns[l * (l + 1) - m] = norm * legendre * sin_m
            ahead = ((2 * l + 1) * z * legendre - (l + m) * previous) / (l + 1 - m)
            previous, legendre = legendre, ahead
        cos_m, sin_m = x * cos_m - y * sin_m, x * sin_m + y * cos_m
        diagonal *= 2 * m + 1
    return torch.stack([columns[i] for i in range((degree + 1) ** 2)], dim=-1)


def lambert_factors(degree: int) -> Tensor:
    """Return what the clamped cosine multiplies each coefficient by, in float64.

    A_0 = pi, A_1 = 2 pi / 3, A_2 = pi / 4, A_3 = 0: odd degrees above 1 vanish
    [Ramamoorthi and Hanrahan 2001, "An efficient representation for irradiance environment maps"].

    Returns:
        One factor a coefficient.  [(degree + 1)^2]
    """
    factors: list[float] = []
    for l in range(degree + 1):  # noqa: E741
        if l == 1:
            value = 2 * math.pi / 3
        elif l % 2:
            value = 0.0
        else:
            half = l // 2
            binomial = math.factorial(l) / (2.0**l * math.factorial(half) ** 2)
            value = 2 * math.pi * (-1.0) ** (half + 1) / ((l + 2) * (l - 1)) * binomial
        factors += [value] * (2 * l + 1)
    return torch.tensor(factors, dtype=torch.float64)
