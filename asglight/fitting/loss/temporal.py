# SPDX-License-Identifier: Apache-2.0
"""The temporal term of the fast fit: lobes stay where they are unless the map moves them.

    T = gamma sum over lobes i of p_i sqrt(|delta_i|^2 + eps^2)

p_i is the lobe's share of the flux and delta_i its way from the frame before in units of itself:
tilts in lobe widths, sharpnesses s + 1/2 in factors e, the turn in radians of a long lobe, light at
the width before in parts of its brightest channel. It is the L_T of Clausen et al. 2024, a norm and
not a square: noise of the map is held back, a real motion is not dragged behind.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting.loss.coordinates import BROAD, concentration
from asglight.lobes import Lobes, asg

GAMMA = 0.003
"""Weight of T against J. Moving every lobe by its own width costs as much as 0.3 % of map error:
with 1 % lobes lag behind, with 0.1 % nothing more is gained."""

CORNER = 0.02
"""eps: motions below two percent of a lobe's own size count by their square."""

TILT_UNIT_MAX = 0.1
"""Radians. A broad lobe's way counts in these, 6 degrees, for it is seen to move long before it
has moved by its own width."""


DARK_SHARE = 1e-4
"""Share of the flux below which a lobe counts as dark: nobody sees it move."""

DARK_UNIT = 1e-6
"""Unit of the light of a black lobe, in mean radiances of the map: its share is 0, and its way must
stay finite."""


@dataclass(frozen=True)
class Prior:
    """Where the lobes were, and how much each unknown's motion weighs.

    Attributes:
        lobes: The frame before.  [F, N, .]
        share: gamma times the lobes' flux shares.  [F, N]
        scale: Size of one unit of each unknown: tilt 2, widths 2, turn 1, light 3.  [F, N, 8]
    """

    lobes: Lobes
    share: Tensor
    scale: Tensor


def prior(lobes: Lobes, gamma: float = GAMMA) -> Prior:
    """Hold lobes where they are.  [F, N, .]."""
    flux = asg.flux(lobes).sum(-1)
    share = gamma * flux / flux.sum(-1, keepdim=True).clamp(min=1e-37)
    factor = asg.per_variance(lobes.form)
    width = (factor * lobes.sharpness).rsqrt().clamp(max=TILT_UNIT_MAX)  # [F, N, 2]
    shifted = lobes.sharpness + BROAD
    long = (shifted.amax(-1) / shifted.amin(-1)).sqrt() - shifted.amin(-1) / shifted.amax(-1)
    light = lobes.amplitude.amax(-1, keepdim=True).clamp(min=DARK_UNIT).expand_as(lobes.amplitude)
    ones = torch.ones_like(width)
    # a round lobe's turn is no motion: it gets a large unit
    scale = torch.cat([width, ones, 1 / long.clamp(min=0.1)[..., None], light], dim=-1)
    return Prior(lobes, share, scale)


def displacement(lobes: Lobes, held: Prior) -> Tensor:
    """Return delta of each lobe.  [F, N, 8]."""
    before = held.lobes
    tilt = torch.stack(
        [(lobes.axis_z * before.axis_x).sum(-1), (lobes.axis_z * before.axis_y).sum(-1)], dim=-1
    )
    widths = ((lobes.sharpness + BROAD) / (before.sharpness + BROAD)).log()
    turn = (lobes.axis_x * before.axis_y).sum(-1, keepdim=True)
    light = lobes.amplitude * concentration(lobes, before.sharpness) - before.amplitude
    return torch.cat([tilt, widths, turn, light], dim=-1) / held.scale


def value(lobes: Lobes, held: Prior) -> Tensor:
    """Return T.  [F]."""
    delta = displacement(lobes, held)
    return (held.share * (delta.square().sum(-1) + CORNER**2).sqrt()).sum(-1)


def slopes(lobes: Lobes, held: Prior) -> tuple[Tensor, Tensor]:
    """Return the diagonal of T's majoriser and T's gradient, in float64.  Two [F, 8 N]."""
    delta = displacement(lobes, held)
    weight = (held.share / (delta.square().sum(-1) + CORNER**2).sqrt())[..., None]
    unit = held.scale.clone()
    unit[..., 5:] /= concentration(lobes, held.lobes.sharpness)
    curvature, slope = weight / unit.square(), weight * delta / unit
    return curvature.double().flatten(1), slope.double().flatten(1)


def is_dark(lobes: Lobes) -> Tensor:
    """Tell which lobes hold so small a share of their frame's flux that nobody sees them.

    [..., N, .] -> [..., N].
    """
    flux = asg.flux(lobes).sum(-1)
    return flux <= DARK_SHARE * flux.sum(-1, keepdim=True)


def blackened(lobes: Lobes) -> Lobes:
    """Return lobes of which the dark ones are black, so that they may be placed anywhere."""
    dark = is_dark(lobes)[..., None]
    return replace(lobes, amplitude=torch.where(dark, 0.0, lobes.amplitude))
