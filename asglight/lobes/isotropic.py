# SPDX-License-Identifier: Apache-2.0
"""Lobes of any form as isotropic spherical Gaussians, for programs that know no others.

An asg lobe becomes one sg lobe; a bingham lobe, which is the same at d and -d, becomes two, each
with half its flux. The axis and the flux stay, channel by channel, and the mean of the two second
moments across the axis, E[x^2] and E[y^2]: the spread that all directions around the axis have in
the mean. What is lost is its difference between them.
"""

from dataclasses import replace

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Form, Lobes

SG_SHARPNESS_MAX = 4 * asg.SHARPNESS_MAX
"""Where the search ends. An sg of the width of an asg has twice its sharpness, which is at most
SHARPNESS_MAX; the factor that is left is room."""

HALVINGS = 60
"""Of the interval of log sharpness, 24 wide: leaves 2e-17, below a rounding of float64."""


def as_sg(lobes: Lobes) -> Lobes:
    """Return sg lobes of the same axes, flux and mean spread; sg lobes as they are.

    Args:
        lobes: N lobes.  [..., N, .]

    Returns:
        N lobes, or 2 N of bingham: all at axis_z, then their twins at -axis_z.  [..., N', .]
    """
    if lobes.form is Form.SG:
        return lobes
    exact = lobes.to(torch.float64)
    zeroth, _, second = asg.moments(exact)
    sharpness = _sharpness_of_spread(second[..., :2].mean(-1) / zeroth)  # [..., N]
    one = replace(exact, sharpness=sharpness[..., None].expand_as(lobes.sharpness), form=Form.SG)
    result = _with_flux_of(one, exact)
    return (_with_twins(result) if lobes.form is Form.BINGHAM else result).to(lobes.axes)


def held_between(lobes: Lobes, low: float, high: float) -> Lobes:
    """Return sg lobes whose sharpness is within limits, those beyond with the flux they had.

    Args:
        lobes: N lobes of form sg.  [..., N, .]
        low: Least sharpness, above 0.
        high: Largest sharpness.
    """
    exact = lobes.to(torch.float64)
    held = _with_flux_of(replace(exact, sharpness=exact.sharpness.clamp(low, high)), exact)
    within = (held.sharpness == exact.sharpness).all(-1, keepdim=True)  # [..., N, 1]
    return replace(
        held.to(lobes.axes),
        amplitude=torch.where(within, lobes.amplitude, held.amplitude.to(lobes.amplitude)),
    )


def _sharpness_of_spread(spread: Tensor) -> Tensor:
    """Return the sharpness of the sg with E[x^2] = E[y^2] = `spread`, by halving.

    The spread falls from 1/3, an even sphere, as the sharpness grows.  [...] -> [...].
    """
    low = torch.full_like(spread, asg.SHARPNESS_MIN).log()
    high = torch.full_like(spread, SG_SHARPNESS_MAX).log()
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        is_wide = _spread(middle.exp()) > spread
        low, high = torch.where(is_wide, middle, low), torch.where(is_wide, high, middle)
    return ((low + high) / 2).exp()


def _spread(sharpness: Tensor) -> Tensor:
    """Return E[x^2] of sg lobes.  [...] -> [...]."""
    zeroth, _, second = asg.sg_moments(sharpness)
    return second[..., 0] / zeroth


def _with_flux_of(lobes: Lobes, other: Lobes) -> Lobes:
    """Scale the light of lobes to the flux that others have.  [..., N, .]."""
    factor = asg.integral(other) / asg.integral(lobes)
    return replace(lobes, amplitude=other.amplitude * factor[..., None])


def _with_twins(lobes: Lobes) -> Lobes:
    """Return lobes with half the light, then the same turned by 180 degrees about axis_x."""
    turned = lobes.axes * lobes.axes.new_tensor([1.0, -1.0, -1.0])[:, None]
    return replace(
        lobes,
        axes=torch.cat([lobes.axes, turned], dim=-3),
        sharpness=torch.cat([lobes.sharpness] * 2, dim=-2),
        amplitude=torch.cat([lobes.amplitude / 2] * 2, dim=-2),
    )
