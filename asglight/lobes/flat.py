# SPDX-License-Identifier: Apache-2.0
"""The flat-topped form as what it is: a signed sum of three asg lobes on one frame.

With E = exp(-sx x^2 - sy y^2) the form is z (1 - (1 - E)^3) where z > 0. The binomial theorem
turns it into z (3 E - 3 E^2 + E^3), and E^k is the Gaussian of k times the sharpness: so every
closed form of the asg lobe holds, term by term. Where a Gaussian has fallen to 80 %, the form of
its sharpness stands at 99 %. From 90 % to 10 % it falls within 0.83 of its radius at half the peak,
a Gaussian within 1.43.
"""

from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes.data import Form, Lobes

TERMS = ((1.0, 3.0), (2.0, -3.0), (3.0, 1.0))
"""Multiples of the sharpness, and amplitudes. One term more gains little on real maps, and costs a
third more wherever terms are summed (docs/method/fewer-lobes.md)."""

INTEGRAL = sum(weight / multiple for multiple, weight in TERMS)
"""Of a narrow lobe, of that of an asg lobe of its sharpness: a plane Gaussian's falls as 1 / s."""

VARIANCE = sum(weight / multiple**2 for multiple, weight in TERMS) / INTEGRAL
"""Mean x^2 of a narrow lobe, of that of an asg lobe of its sharpness."""


def values(gaussian: Tensor) -> Tensor:
    """Return 1 - (1 - E)^3 for E in [0, 1].  [...]."""
    return gaussian * (3 - gaussian * (3 - gaussian))


def terms(lobes: Lobes) -> Lobes:
    """Return the asg lobes whose sum the flat-topped lobes are; some amplitudes are negative.

    Args:
        lobes: N lobes of the form flat.  [..., N, .]

    Returns:
        3 N lobes of the form asg: term k of lobe i is lobe k N + i.  [..., 3 N, .]
    """
    return replace(
        lobes,
        axes=torch.cat([lobes.axes] * len(TERMS), dim=-3),
        sharpness=torch.cat([multiple * lobes.sharpness for multiple, _ in TERMS], dim=-2),
        amplitude=torch.cat([weight * lobes.amplitude for _, weight in TERMS], dim=-2),
        form=Form.ASG,
    )


def summed(parts: Tensor, dim: int) -> Tensor:
    """Add up what the terms of each lobe give at amplitude 1.

    Args:
        parts: In the order of `terms`.  [..., 3 N, ...]
        dim: That of the terms.
    """
    each = parts.unflatten(dim, (len(TERMS), -1)).unbind(dim if dim >= 0 else dim - 1)
    return sum(
        (weight * part for (_, weight), part in zip(TERMS[1:], each[1:], strict=True)),
        TERMS[0][1] * each[0],
    )


def as_flat(lobes: Lobes) -> Lobes:
    """Return flat lobes in place of asg ones, narrow ones of the same flux and variances.

    Args:
        lobes: N lobes of the form asg.  [..., N, .]
    """
    return replace(
        lobes,
        sharpness=VARIANCE * lobes.sharpness,
        amplitude=VARIANCE / INTEGRAL * lobes.amplitude,
        form=Form.FLAT,
    )
