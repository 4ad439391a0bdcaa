# SPDX-License-Identifier: Apache-2.0
"""Flux-weighted expectation-maximisation of isotropic lobes: the strongest simple peer.

A map is a density of flux over the sphere; a mixture of von Mises-Fisher densities is fitted to it
[Banerjee et al. 2005, "Clustering on the unit hypersphere using von Mises-Fisher distributions"],
each texel weighing by its flux. The M-step is closed: with the resultant R = |sum w d| / sum w of
what a lobe took, its concentration is about R (3 - R^2) / (1 - R^2). Each amplitude is the RGB flux
that the lobe took over its integral, so the flux is kept exactly.
"""

import math

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

STEPS = 40

CONCENTRATION_MAX = 32_000.0
"""A lobe of half a texel of 256 x 512; the bound of production code (OpenPGL)."""

CONCENTRATION_MIN = 1e-2
"""An even sphere to a percent; the closed form divides by it."""


def fit(reference: Tensor, count: int) -> Lobes:
    """Fit isotropic lobes to a map.

    Starts from Fibonacci axes whose densities just overlap.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        count: N.

    Returns:
        Lobes of the sg form with the flux of the map.  [N, .]
    """
    height, width, _ = reference.shape
    directions = latlong.directions(height, width).reshape(-1, 3)
    solid_angle = latlong.texel_solid_angles(height, width).reshape(-1, 1)
    flux = reference.reshape(-1, 3) * solid_angle  # [P, 3]
    weight = flux.sum(-1)
    axis_z = fibonacci_directions(count)
    concentration = torch.full((count,), float(count))
    share = torch.full((count,), 1 / count)
    taken = torch.empty(0)
    for _ in range(STEPS):
        taken = _expectation(directions, axis_z, concentration, share)
        axis_z, concentration, share = _maximisation(directions, weight, taken)
    lobes = Lobes(
        axes_around(axis_z),
        concentration[:, None].expand(-1, 2).contiguous(),
        torch.ones(count, 3),
        Form.SG,
    )
    amplitude = (taken.mT @ flux) / asg.integral(lobes)[:, None]
    return Lobes(lobes.axes, lobes.sharpness, amplitude, Form.SG)


def _expectation(
    directions: Tensor, axis_z: Tensor, concentration: Tensor, share: Tensor
) -> Tensor:
    """Return each lobe's share of each texel.  [P, N]."""
    # log of share times density k / (2 pi (1 - exp(-2 k))) exp(k (d.z - 1))
    normaliser = torch.log(concentration / (2 * math.pi)) - torch.log(
        -torch.expm1(-2 * concentration)
    )
    exponent = concentration * (directions @ axis_z.mT - 1)
    return torch.softmax(torch.log(share.clamp(min=1e-30)) + normaliser + exponent, dim=-1)


def _maximisation(
    directions: Tensor, weight: Tensor, taken: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return axes, concentrations and shares of the flux that each lobe took."""
    mass = taken.mT @ weight  # [N]
    mean = (taken * weight[:, None]).mT @ directions / mass.clamp(min=1e-30)[:, None]
    resultant = mean.norm(dim=-1).clamp(max=1 - 1e-7)  # below 1 in float32
    concentration = resultant * (3 - resultant**2) / (1 - resultant**2)
    concentration = concentration.clamp(min=CONCENTRATION_MIN, max=CONCENTRATION_MAX)
    axis_z = torch.nn.functional.normalize(mean, dim=-1)
    return axis_z, concentration, mass / mass.sum()
