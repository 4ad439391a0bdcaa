# SPDX-License-Identifier: Apache-2.0
"""Which lobe a click means, what each lobe sends from a direction, and how much light it has."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg
from asglight.luminance import luminance
from asglight.viewer.uniforms.outlines import HALF_PEAK, half_angles


def pick(lobes: Lobes, direction: Sequence[float], tolerance: float) -> int | None:
    """Return the lobe that a click means.

    A lobe that is smaller than the tolerance counts as a disc of that radius, and wins over the
    outlines around it: else a sun could not be picked out of its sky. Otherwise the smallest
    outline that holds the direction; otherwise the nearest centre within the tolerance.

    Args:
        lobes: N lobes of one frame.  [N, .]
        direction: Of any length.  [3]
        tolerance: Radians; that of a marker on the screen.

    Returns:
        Index of the lobe, or None.
    """
    lobes = lobes.to("cpu", torch.float64)
    unit = _unit(direction)
    distance = _angles(lobes, unit)
    near = distance <= tolerance
    small = near & (half_angles(lobes).amax(-1) < tolerance)
    inside = _holds(lobes, unit)
    for candidates, key in ((small, distance), (inside, asg.integral(lobes)), (near, distance)):
        if bool(candidates.any()):
            return int(torch.where(candidates, key, math.inf).argmin())
    return None


def contributions(lobes: Lobes, direction: Sequence[float]) -> Tensor:
    """Return the radiance that each lobe sends from a direction.

    Args:
        lobes: N lobes of one frame.  [N, .]
        direction: Of any length.  [3]

    Returns:
        Linear RGB, float64.  [N, 3]
    """
    lobes = lobes.to("cpu", torch.float64)
    unit = _unit(direction)
    return asg.unit_lobes(lobes, unit[None]) * lobes.amplitude


def brightest_first(radiance: Tensor) -> list[int]:
    """Return indices by falling luminance; of equals, the lower index first.

    Args:
        radiance: Linear RGB of N lobes.  [N, 3]
    """
    return torch.argsort(luminance(radiance), descending=True, stable=True).tolist()


def energies(lobes: Lobes) -> Tensor:
    """Return the flux of each lobe, channels summed as in every share, float64.  [..., N]."""
    return asg.flux(lobes.to("cpu", torch.float64)).sum(-1)


def _holds(lobes: Lobes, direction: Tensor) -> Tensor:
    """Tell which outlines hold a direction.  [N]."""
    values = asg.unit_lobes(lobes, direction[None])[:, 0]
    if lobes.form is Form.SG:  # one that never falls to the level is drawn as its hemisphere
        drawn_whole = lobes.sharpness[:, 0] * 2 <= -math.log(HALF_PEAK)
        return torch.where(drawn_whole, lobes.axis_z @ direction >= 0, values >= HALF_PEAK)
    return values >= HALF_PEAK


def _angles(lobes: Lobes, direction: Tensor) -> Tensor:
    """Return the angles between a direction and the nearer centre of each lobe.  [N]."""
    sine = torch.linalg.cross(lobes.axis_z, direction.expand_as(lobes.axis_z)).norm(dim=-1)
    cosine = lobes.axis_z @ direction
    return torch.atan2(sine, cosine.abs() if lobes.form is Form.BINGHAM else cosine)


def _unit(direction: Sequence[float]) -> Tensor:
    return torch.nn.functional.normalize(torch.as_tensor(direction, dtype=torch.float64), dim=0)
