# SPDX-License-Identifier: Apache-2.0
"""The clear sky in closed form, after Preetham, Shirley and Smits 1999.

"A Practical Analytic Model for Daylight": luminance and chromaticity of the sky are Perez functions
of the view zenith angle and of the angle to the sun, scaled to their values at the zenith; all
depend on turbidity and the sun's zenith angle.
Zotti, Wilkie and Purgathofer 2007 ("A Critical Review of the Preetham Skylight Model") show where
it leaves reality: turbidity below 2 and the sun near or below the horizon. `asglight.sky` stays
inside turbidity 2 to 6 and sun elevations of 5 degrees or more.

Symbols: theta zenith angle of the view, gamma angle between view and sun, T turbidity,
Y luminance in kcd/m^2, x and y CIE 1931 chromaticity.
"""

import math

import torch
from torch import Tensor

from asglight.sky.colour import rec709_from_xyz

# Rows A to E of the Perez function; each (slope, offset) is linear in turbidity.
_PEREZ_Y = (
    (0.1787, -1.4630),
    (-0.3554, 0.4275),
    (-0.0227, 5.3251),
    (0.1206, -2.5771),
    (-0.0670, 0.3703),
)
_PEREZ_X_CHROMA = (
    (-0.0193, -0.2592),
    (-0.0665, 0.0008),
    (-0.0004, 0.2125),
    (-0.0641, -0.8989),
    (-0.0033, 0.0452),
)
_PEREZ_Y_CHROMA = (
    (-0.0167, -0.2608),
    (-0.0950, 0.0092),
    (-0.0079, 0.2102),
    (-0.0441, -1.6537),
    (-0.0109, 0.0529),
)
# Zenith chromaticity: rows T^2, T, 1; columns theta^3, theta^2, theta, 1 of the sun.
_ZENITH_X_CHROMA = (
    (0.00166, -0.00375, 0.00209, 0.0),
    (-0.02903, 0.06377, -0.03202, 0.00394),
    (0.11693, -0.21196, 0.06052, 0.25886),
)
_ZENITH_Y_CHROMA = (
    (0.00275, -0.00610, 0.00317, 0.0),
    (-0.04214, 0.08970, -0.04153, 0.00516),
    (0.15346, -0.26756, 0.06670, 0.26688),
)

_COS_HORIZON = 0.01
"""The Perez function divides by the cosine of the view zenith angle. Held from 89.4 degrees down,
its exponential is already within 1e-6 of its limit for every turbidity that is allowed."""


def zenith_luminance(turbidity: float, sun_zenith: float) -> float:
    """Return the luminance of the zenith in kcd/m^2 (Preetham et al. 1999).

    Args:
        turbidity: 2 (very clear) to 6 (hazy).
        sun_zenith: Zenith angle of the sun, radians.
    """
    chi = (4 / 9 - turbidity / 120) * (math.pi - 2 * sun_zenith)
    return (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192


def zenith_chromaticity(turbidity: float, sun_zenith: float) -> tuple[float, float]:
    """Return CIE 1931 (x, y) of the zenith; arguments as `zenith_luminance`."""

    def polynomial(rows: tuple[tuple[float, ...], ...]) -> float:
        """Return the polynomial in turbidity and zenith angle that has these coefficients."""
        t_powers = (turbidity**2, turbidity, 1.0)
        angle_powers = (sun_zenith**3, sun_zenith**2, sun_zenith, 1.0)
        return sum(
            t * sum(c * a for c, a in zip(row, angle_powers, strict=True))
            for t, row in zip(t_powers, rows, strict=True)
        )

    return polynomial(_ZENITH_X_CHROMA), polynomial(_ZENITH_Y_CHROMA)


def radiance(directions: Tensor, sun: Tensor, turbidity: float) -> Tensor:
    """Return the clear sky in linear Rec.709, kcd/m^2, without the sun's disc.

    Below the horizon the value at the horizon is held; the caller puts the ground there.

    Args:
        directions: Unit directions, float64.  [..., 3]
        sun: Unit direction of the sun, above the horizon.  [3]
        turbidity: 2 to 6.

    Returns:
        Linear RGB, >= 0.  [..., 3]
    """
    sun_zenith = math.acos(float(sun[1]))
    cos_theta = directions[..., 1].clamp(min=_COS_HORIZON)
    cos_gamma = (directions @ sun).clamp(-1, 1)
    x_zenith, y_zenith = zenith_chromaticity(turbidity, sun_zenith)

    def relative(rows: tuple[tuple[float, float], ...]) -> Tensor:
        coefficients = [slope * turbidity + offset for slope, offset in rows]
        at_zenith = _perez(torch.tensor(1.0), torch.tensor(math.cos(sun_zenith)), coefficients)
        return _perez(cos_theta, cos_gamma, coefficients) / at_zenith

    luminance = zenith_luminance(turbidity, sun_zenith) * relative(_PEREZ_Y)
    x = x_zenith * relative(_PEREZ_X_CHROMA)
    y = y_zenith * relative(_PEREZ_Y_CHROMA)
    scale = luminance / y
    return rec709_from_xyz(torch.stack([x * scale, luminance, (1 - x - y) * scale], dim=-1))


def _perez(cos_theta: Tensor, cos_gamma: Tensor, coefficients: list[float]) -> Tensor:
    """Evaluate the five-parameter function of Perez, Seals and Michalsky 1993."""
    a, b, c, d, e = coefficients
    gradation = 1 + a * torch.exp(b / cos_theta)
    indicatrix = 1 + c * torch.exp(d * torch.acos(cos_gamma)) + e * cos_gamma * cos_gamma
    return gradation * indicatrix
