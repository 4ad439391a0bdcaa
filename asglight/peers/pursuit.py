# SPDX-License-Identifier: Apache-2.0
"""Where lobes start: one after the other, each where it takes most of the squared error.

Orthogonal matching pursuit [Pati, Rezaiifar and Krishnaprasad 1993, "Orthogonal matching pursuit:
recursive function approximation with applications to wavelet decomposition", Asilomar] over round
lobes at every texel of a coarse grid, in seven widths; all amplitudes are solved anew after each.
"""

import math

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.peers import amplitudes
from asglight.sphere import latlong

ROWS = 32
"""Of the grid: 2,048 axes, 5.6 degrees apart."""

WIDTHS = tuple(0.6 * math.pi / ROWS * 1.6**i for i in range(7))
"""Sigmas in radians, 3.4 to 57 degrees: from the narrowest that texel centres can hold to a lobe as
wide as the sky."""


def start(reference: Tensor, count: int, *, signed: bool) -> Lobes:
    """Choose lobes of the sg form.

    Args:
        reference: Radiance.  [H, W, 3]
        count: N.
        signed: Whether amplitudes may be negative.

    Returns:
        Lobes of amplitude 1.  [N, .]
    """
    rows = min(ROWS, reference.shape[0])
    # over a power of two, which rounds nothing: squares of 1e20 are beyond float32
    unit = 2.0 ** (math.frexp(float(reference.max()))[1] - 1)
    radiance = latlong.reduce(reference / unit, rows, 2 * rows).reshape(-1, 3)
    directions = latlong.directions(rows, 2 * rows).reshape(-1, 3)
    solid_angle = latlong.texel_solid_angles(rows, 2 * rows).reshape(-1)
    choices = _choices(directions)
    values = asg.unit_lobes(choices, directions)  # [7 P, P]
    norms = values.square() @ solid_angle
    chosen: list[int] = []
    residual = radiance
    for _ in range(count):
        product = values @ (residual * solid_angle[:, None])  # [7 P, 3]
        taken = (product if signed else product.clamp(min=0)).square().sum(-1) / norms
        taken[chosen] = -1  # a lobe that is there already would take nothing more
        chosen.append(int(taken.argmax()))
        picked = values[chosen]
        amplitude = amplitudes.solve(picked, picked * solid_angle, radiance, signed=signed)
        residual = radiance - picked.mT @ amplitude
    return choices.select(torch.tensor(chosen))


def _choices(directions: Tensor) -> Lobes:
    """Return lobes of every width at every direction.  [7 P, .]."""
    axes = axes_around(directions).repeat(len(WIDTHS), 1, 1)
    sharpness = torch.tensor(WIDTHS).square().reciprocal().repeat_interleave(len(directions))
    ones = torch.ones(len(axes), 3)
    return Lobes(axes, sharpness[:, None].expand(-1, 2).contiguous(), ones, Form.SG)
