# SPDX-License-Identifier: Apache-2.0
"""Direct sunlight through a clear atmosphere: level and colour.

A black body of the sun's temperature, scaled to the measured solar illuminance, is attenuated by
Rayleigh scattering, aerosol (Angstrom's law) and ozone, as Preetham, Shirley and Smits 1999 take
them from Iqbal 1983 ("An Introduction to Solar Radiation"). Water vapour and mixed gases absorb
beyond 690 nm, where the eye hardly sees, and are left out.

Symbols: m relative optical air mass, beta Angstrom's turbidity coefficient, wavelength in nm in
names and in micrometres inside the formulas.
"""

import math

import torch
from torch import Tensor

from asglight.sky.colour import colour_matching, rec709_from_xyz

SOLAR_ILLUMINANCE = 133.3
"""Klx at normal incidence outside the atmosphere (Darula, Kittler and Gueymard 2005)."""

SUN_RADIUS = math.radians(0.53 / 2)
"""Angular radius of the sun's disc, radians."""

_SUN_TEMPERATURE = 5778.0
_OZONE_CM = 0.35
_WAVELENGTHS = torch.arange(380, 781, 10, dtype=torch.float64)

# Absorption of ozone (Chappuis band), 1/cm, every 20 nm from 440 nm (Iqbal 1983, from Vigroux).
_OZONE_START, _OZONE_STEP = 440, 20
_OZONE_ABSORPTION = (
    *(0.002, 0.006, 0.014, 0.030, 0.048, 0.075, 0.103, 0.120, 0.125),  # to 600 nm
    *(0.105, 0.079, 0.057, 0.036, 0.023, 0.014, 0.010, 0.007, 0.000),  # to 780 nm
)


def air_mass(sun_zenith: float) -> float:
    """Return the relative optical air mass (Kasten 1965), 1 at the zenith, about 38 at the horizon.

    Args:
        sun_zenith: Zenith angle of the sun, radians, at most pi / 2.
    """
    return 1 / (math.cos(sun_zenith) + 0.15 * (93.885 - math.degrees(sun_zenith)) ** -1.253)


def transmittance(turbidity: float, sun_zenith: float) -> Tensor:
    """Return the share of sunlight that reaches the ground, per wavelength.

    Args:
        turbidity: 2 (very clear) to 6 (hazy).
        sun_zenith: Zenith angle of the sun, radians.

    Returns:
        In (0, 1], at 380, 390, ... 780 nm.  [41]
    """
    m = air_mass(sun_zenith)
    micrometres = _WAVELENGTHS / 1000
    beta = 0.04608 * turbidity - 0.04586
    rayleigh = torch.exp(-0.008735 * micrometres**-4.08 * m)
    aerosol = torch.exp(-beta * micrometres**-1.3 * m)
    ozone = torch.exp(-_ozone_absorption() * _OZONE_CM * m)
    return rayleigh * aerosol * ozone


def illuminance(turbidity: float, sun_zenith: float) -> Tensor:
    """Return the sun's illuminance on a surface that faces it, klx, in linear Rec.709.

    Args:
        turbidity: 2 to 6.
        sun_zenith: Zenith angle of the sun, radians.

    Returns:
        Linear RGB whose luminance is the illuminance, >= 0.  [3]
    """
    matching = colour_matching(_WAVELENGTHS)  # [41, 3]
    outside = _black_body()
    scale = SOLAR_ILLUMINANCE / (outside @ matching[:, 1])
    xyz = scale * (outside * transmittance(turbidity, sun_zenith)) @ matching
    return rec709_from_xyz(xyz)


def _black_body() -> Tensor:
    """Return Planck's law at the sun's temperature up to a factor.  [41]."""
    second_radiation_constant = 1.438777e7  # nm K (CODATA)
    exponent = second_radiation_constant / (_WAVELENGTHS * _SUN_TEMPERATURE)
    return (_WAVELENGTHS / 560) ** -5 / torch.expm1(exponent)


def _ozone_absorption() -> Tensor:
    """Interpolate the ozone table linearly; zero outside it.  [41]."""
    table = torch.tensor((0.0, *_OZONE_ABSORPTION), dtype=torch.float64)
    position = (_WAVELENGTHS - (_OZONE_START - _OZONE_STEP)) / _OZONE_STEP
    position = position.clamp(0, len(table) - 1)
    low = position.floor().long().clamp(max=len(table) - 2)
    return torch.lerp(table[low], table[low + 1], position - low)
