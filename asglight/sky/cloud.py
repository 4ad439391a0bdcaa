# SPDX-License-Identifier: Apache-2.0
"""One soft cloud on a level plane: its optical depth, and what it does to sun and sky.

The cloud lies on a plane at unit height, an ellipse with a ragged edge that drifts with the wind
and slowly changes its shape. Light through it: what is not scattered (Beer's law), what is
scattered once (the phase function of Henyey and Greenstein 1941), and the rest, diffuse, so that
all three add up to the two-stream transmittance of a cloud that absorbs nothing (Bohren 1987,
"Multiple scattering of light and some of its observable consequences").

Symbols: tau optical depth along the view, g asymmetry of the phase function, gamma angle from the
sun, mu sine of the sun's elevation.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.sky.noise import fractal

_ASYMMETRY = 0.8
"""g of water droplets is 0.85; 0.8 keeps the aureole within a few times the clear sky's."""

_RAGGEDNESS = 1.1
_EDGE = 1.8
"""Width of the edge in units of the ellipse's own profile, which is 1 at the centre: soft."""

_FEATURE = 0.4
"""Largest noise feature in plane heights, about 15 degrees overhead."""

_CHURN = 0.7
"""Noise features that the cloud evolves through over a whole shot."""


@dataclass(frozen=True)
class Cloud:
    """A cloud at one moment.

    Attributes:
        centre: Position on the plane at unit height, (x, z), plane heights.
        size: Semi-axes along x and z, plane heights.
        depth: Optical depth at the thickest, >= 0.
        age: 0 at the first frame, 1 at the last.
        seed: Seed of the shape.
    """

    centre: tuple[float, float]
    size: tuple[float, float]
    depth: float
    age: float
    seed: int


def optical_depth(cloud: Cloud, directions: Tensor) -> Tensor:
    """Return the optical depth of the cloud along each direction, 0 below the horizon.

    Args:
        cloud: The cloud.
        directions: Unit directions, float64.  [..., 3]

    Returns:
        Dimensionless, >= 0, continuous.  [...]
    """
    up = directions[..., 1]
    inside = up > 0.05  # below 3 degrees the plane is 20 heights away: no cloud of ours reaches it
    plane = directions[..., (0, 2)] / torch.where(inside, up, 1.0)[..., None]
    offset = plane - torch.tensor(cloud.centre, dtype=directions.dtype)
    profile = 1 - (offset / torch.tensor(cloud.size, dtype=directions.dtype)).square().sum(-1)
    near = inside & (profile > -2 * _RAGGEDNESS)  # five octaves of noise stay within +-2
    depth = torch.zeros_like(up)
    age = torch.full((int(near.sum()), 1), cloud.age * _CHURN, dtype=directions.dtype)
    shape = fractal(torch.cat([offset[near] / _FEATURE, age], dim=-1), cloud.seed)
    edge = ((profile[near] + _RAGGEDNESS * shape) / _EDGE).clamp(0, 1)
    depth[near] = cloud.depth * edge * edge * (3 - 2 * edge)
    return depth


def scattered(tau: Tensor, cos_gamma: Tensor, sun_illuminance: Tensor, mu: float) -> Tensor:
    """Return the sunlight that the cloud scatters towards the viewer, kcd/m^2.

    Args:
        tau: Optical depth along the view.  [...]
        cos_gamma: Cosine of the angle from the sun.  [...]
        sun_illuminance: Of a surface that faces the sun, klx.  [3]
        mu: Sine of the sun's elevation.

    Returns:
        Linear RGB.  [..., 3]
    """
    g = _ASYMMETRY
    direct = torch.exp(-tau)
    phase = (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cos_gamma) ** 1.5)
    forward_share = (1 + g) / 2
    diffuse = two_stream_transmittance(tau) - direct * (1 + forward_share * tau)
    return (phase * tau * direct + diffuse * mu / math.pi)[..., None] * sun_illuminance


def two_stream_transmittance(tau: Tensor) -> Tensor:
    """Return direct plus diffuse transmittance of a cloud that absorbs nothing (Bohren 1987)."""
    return 2 / (2 + (1 - _ASYMMETRY) * tau)
