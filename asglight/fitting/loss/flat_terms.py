# SPDX-License-Identifier: Apache-2.0
"""From the three asg terms of a flat lobe (lobes/flat.py) back to the lobe's own coordinates.

A term of k times the sharpness s moves along its lobe's coordinates as along its own, but for
factors. A width coordinate moves the lobe's s by s + 1/2, and so the term's by k (s + 1/2), which
is f = k (s + 1/2) / (k s + 1/2) times what the term's own coordinate does. Of a term's own
derivative half its value is the light that it gains as it narrows (coordinates.py); the lobe gains
that too, at its own rate: the derivative along the lobe's is f (own - value / 2) + value / 2.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from asglight.fitting.loss import constants
from asglight.fitting.loss.coordinates import BROAD
from asglight.fitting.loss.footprints import turn_speed
from asglight.lobes import Lobes, flat


class Rates(NamedTuple):
    """How fast each term moves along its lobe's coordinates, of how fast along its own.

    Attributes:
        widths: Along the two widths.  [F, 3, N, 2]
        turn: Along the turn.  [F, 3, N]
    """

    widths: Tensor
    turn: Tensor


def rates(lobes: Lobes) -> Rates:
    """Return the rates of the terms of lobes of the form flat.  [F, N, .]."""
    multiple = constants.like(lobes.sharpness, *[each for each, _ in flat.TERMS])[:, None]
    own = lobes.sharpness[..., None, :, :]
    widths = multiple[..., None] * (own + BROAD) / (multiple[..., None] * own + BROAD)
    moved = turn_speed(flat.terms(lobes)).unflatten(-1, (len(flat.TERMS), -1))
    return Rates(widths, multiple * turn_speed(lobes)[..., None, :] / moved)


def slopes_of_lobes(found: Tensor, terms: Lobes, lobes: Lobes) -> Tensor:
    """Gather the slopes of a loss.

    Args:
        found: Along the coordinates of each term.  [F, 3 N, 8]
        terms: The terms.  [F, 3 N, .]
        lobes: The lobes.  [F, N, .]

    Returns:
        Along the coordinates of each lobe.  [F, N, 8]
    """
    gained = (found[..., 5:] * terms.amplitude).sum(-1, keepdim=True)
    own = torch.cat([gained, found[..., :5]], dim=-1).unflatten(1, (len(flat.TERMS), -1))
    shape = _along_lobes(own[..., None], lobes).sum(1)[..., 1:, 0]  # terms have their weights
    return torch.cat([shape, flat.summed(found[..., 5:], 1)], dim=-1)


def columns_of_lobes(found: Tensor, lobes: Lobes) -> Tensor:
    """Gather columns of the Gauss-Newton matrix.

    Args:
        found: Each term of amplitude 1 and its derivatives.  [F, 6 * 3 N, P]
        lobes: The lobes.  [F, N, .]

    Returns:
        Each lobe of amplitude 1 and its derivatives.  [F, 6 N, P]
    """
    own = found.unflatten(1, (len(flat.TERMS), lobes.count, -1))
    weight = constants.like(found, *[each for _, each in flat.TERMS])[:, None, None, None]
    return (_along_lobes(own, lobes) * weight).sum(1).flatten(1, 2)


def _along_lobes(own: Tensor, lobes: Lobes) -> Tensor:
    """Return values and derivatives of terms along the coordinates of their lobes.

    Args:
        own: Along those of the terms: value, tilts, widths, turn.  [F, 3, N, 6, P]
        lobes: The lobes.  [F, N, .]
    """
    speed = rates(lobes)
    value = own[:, :, :, :1] / 2
    widths = speed.widths[..., None] * (own[:, :, :, 3:5] - value) + value
    turn = speed.turn[..., None, None] * own[:, :, :, 5:]
    return torch.cat([own[:, :, :, :3], widths, turn], dim=3)
