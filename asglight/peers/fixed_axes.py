# SPDX-License-Identifier: Apache-2.0
"""Fixed isotropic lobes whose amplitudes alone are fitted, by non-negative least squares.

[Pettineo 2016, "SG Series Part 5: Approximating radiance and irradiance with SG's", and the code
that goes with it, BakingLab]: axes on a spiral, one sharpness for all, chosen so that a lobe has
fallen to 0.65^N where it meets the axis furthest from the first half way. Made for baked light of
rooms, where the same few axes serve every texel of a lightmap; a lamp between the axes is spread.
"""

import math

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import axes_around
from asglight.peers import amplitudes
from asglight.peers.approximation import LobeSum
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

FLOATS = 3
"""Of a lobe: RGB. Axes and sharpness follow from their number."""


def fit(reference: Tensor, floats: int) -> LobeSum:
    """Fit the amplitudes of as many lobes as the budget holds.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        floats: Budget, 6 or more.
    """
    height, width, _ = reference.shape
    count = floats // FLOATS
    axis_z = fibonacci_directions(count, dtype=torch.float64)
    lobes = Lobes(
        axes_around(axis_z),
        torch.full((count, 2), sharpness(axis_z), dtype=torch.float64),
        torch.ones(count, 3, dtype=torch.float64),
        Form.SG,
    )
    directions = latlong.directions(height, width, dtype=torch.float64).reshape(-1, 3)
    values = asg.unit_lobes(lobes, directions)  # [N, P]
    weighted = values * latlong.texel_solid_angles(height, width).reshape(-1)
    amplitude = amplitudes.solve(values, weighted, reference.double().reshape(-1, 3), signed=False)
    return LobeSum(Lobes(lobes.axes, lobes.sharpness, amplitude, Form.SG).to(torch.float32), FLOATS)


def sharpness(axis_z: Tensor) -> float:
    """Return the common sharpness of lobes on given axes.  axis_z: [N, 3], two or more."""
    half = torch.nn.functional.normalize(axis_z[1:] + axis_z[0], dim=-1)
    lowest = float((half @ axis_z[0]).min())
    return math.log(0.65) * len(axis_z) / (lowest - 1.0001)  # 1e-4: two equal axes divide by 0
