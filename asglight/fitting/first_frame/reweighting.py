# SPDX-License-Identifier: Apache-2.0
"""No error of a first frame lags behind the others.

J adds up errors, so a fit may be far ahead in one and behind in another: in a room with two hard
lamps J lies on the map, and in a forest on the light. What a map's errors can come to differs by
a hundred from map to map, so each is measured against that of a yardstick, the same number of
isotropic lobes after expectation-maximisation, of which a fit is to leave a share. Where one is
above its aim, its weight in J grows until it is not or nothing is gained: the largest ratio goes
down, the Chebyshev scalarisation of several aims [Miettinen 1999, Nonlinear Multiobjective
Optimization]. No weight goes below that of J: an error with room to spare is not spent.
"""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting.loss import adaptive_cells, lobe_images, objective
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.loss.objective import Target
from asglight.fitting.loss.probes import probe, shares, split
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes

ERRORS = ("env", "irr", "irrMax", "r0.5", "r0.25")
"""Of `errors`, as asglight.judging names them."""

ENOUGH = (1e-2, 2e-4, 1e-3, 5e-4, 1e-3)
"""Errors that need not be less, whatever the yardstick's: no picture shows them."""

ROUNDS, STEPS = 8, 8
"""Of new weights, and steps with each: what these gain comes early."""

FACTOR, FACTOR_LEAST = 2.0, 1.05
"""By which the weight of an error that lags behind grows in a round, and its root after one that
brought another error as far behind, down to the least that steps tell from nothing."""

POWER, FACTOR_MAX = 3.0, 10.0
"""By which power of its lag a weight grows for a start that goes once more, and how much at most:
which lamps get the lobes changes only where weights change by much."""


@dataclass(frozen=True)
class Measured:
    """Lobes that took steps, and what they come to.

    Attributes:
        found: The lobes.  F = 1
        lit: The same with the last solution for their light, by which they are measured.
        lag: Each error over what it is to come to: above 1 it lags behind.  [5]
    """

    found: newton.Outcome
    lit: Images
    lag: Tensor


def errors(radiance: Tensor, frame: Target) -> Tensor:
    """Return the errors of a reconstruction as asglight.judging defines them, in their order.

    They are taken on the adaptive cells and at the probes' views.

    Args:
        radiance: On the adaptive cells.  [F, 3, P]
        frame: The maps.

    Returns:
        [F, 5]
    """
    places, rows = frame.places, frame.places.rows
    cells = (radiance[:, None, :, : places.count] - frame.parts).abs().mean(1).sum(1)
    texels = (radiance - frame.radiance)[..., places.count :].abs().sum(1)
    sent = (places.share * frame.radiance.sum(1)).sum(-1)
    env = (places.cell_share * cells).sum(-1) + (places.texel_share * texels).sum(-1)
    views = frame.views, probe(adaptive_cells.to_cells(radiance, places), rows)
    share = split(shares(rows, str(radiance.device)), rows)
    found = [env / sent]
    for own, wanted, shown in zip(
        share[1:], *(split(each, rows)[1:] for each in views), strict=True
    ):
        mean = (own * wanted.sum(1)).sum(-1)
        missed = (shown - wanted).abs()
        found.append((own * missed.sum(1)).sum(-1) / mean)
        if len(found) == 2:  # Lambert's
            found.append(3 * missed.amax((-2, -1)) / mean)
    return torch.stack(found, dim=-1)


def aims(yardstick: Lobes, frame: Target, left: tuple[float, ...]) -> Tensor:
    """Return `aims_of_each` of one map, whose yardstick is [N, .].  [5]."""
    return aims_of_each(yardstick[None], frame, left)[0]


def aims_of_each(yardstick: Lobes, frame: Target, left: tuple[float, ...]) -> Tensor:
    """Return the errors that fits are to come to, in the order of `ERRORS`.

    Args:
        yardstick: Lobes that took no steps.  [F, N, .]
        frame: The maps.
        left: Shares of the yardstick's errors that a fit is to leave.

    Returns:
        [F, 5]
    """
    shown = lobe_images.images(yardstick, frame.places)
    found = errors(shown.radiance, frame)
    return torch.maximum(found * found.new_tensor(left), found.new_tensor(ENOUGH))


def measured(found: newton.Outcome, frame: Target, aim: Tensor) -> Measured:
    """Measure lobes of one map.

    Args:
        found: Lobes that took steps.  F = 1
        frame: The map, with J's own weights.
        aim: From `aims`.
    """
    lit = light.with_amplitudes(found, frame)
    return Measured(found, lit, (errors(lit.radiance, frame) / aim)[0])


def lags_of_each(found: newton.Outcome, frame: Target, aim: Tensor) -> Tensor:
    """Return each error over what it is to come to: above 1 it lags behind.

    Args:
        found: Lobes that took steps.
        frame: The maps, with J's own weights.
        aim: From `aims_of_each`.  [F, 5]

    Returns:
        [F, 5]
    """
    return errors(light.with_amplitudes(found, frame).radiance, frame) / aim


def with_weights(frame: Target, factors: Tensor) -> Target:
    """Return a map with other weights.

    Args:
        frame: The map.
        factors: Of the weight of each of `ERRORS`; the larger one of irr and irrMax counts.
    """
    env, irr, irr_max, rough, glossy = factors.tolist()
    return frame.with_weights(env, (1.0, max(irr, irr_max), rough, glossy))


def raised(lag: Tensor) -> Tensor:
    """Return the factors of J's weights with which a start goes once more.  [5].

    Args:
        lag: Of the start's end, from `lags`.
    """
    return lag.pow(POWER).clamp(1.0, FACTOR_MAX)


def reweighted(
    start: Measured,
    frame: Target,
    aim: Tensor,
    width_min: float,
    weights: Tensor | None = None,
) -> Measured:
    """Take steps with the weights of what lags behind raised, while the largest lag goes down.

    What materials show is not brought behind for the map, nor paid for it at any price: where the
    map's error alone lags, J rises by no larger a factor than the lag falls by.

    Args:
        start: The lobes.
        frame: The map, with J's own weights.
        aim: From `aims`.
        width_min: Sigma of the narrowest lobe allowed, radians.
        weights: Factors of J's weights to begin with, for lobes that were fitted with them.  [5]

    Returns:
        The lobes, with the value of J by its own weights.
    """
    weights = torch.ones_like(aim) if weights is None else weights
    best, value, factor = start, own_value(start.found, frame), FACTOR
    for _ in range(ROUNDS):
        lag = best.lag
        if float(lag.max()) <= 1 or factor < FACTOR_LEAST:
            break
        heavier = weights * torch.where(lag > 1, factor, 1.0)
        stepped = newton.minimise(
            best.found.lobes, with_weights(frame, heavier), STEPS, width_min=width_min
        )
        ahead, value_ahead = measured(stepped, frame, aim), own_value(stepped, frame)
        lit, lit_ahead = float(lag[1:].max()), float(ahead.lag[1:].max())
        fall = float(lag.max() / ahead.lag.max())
        costs_more = lit <= 1 and float(value_ahead) > fall * float(value)
        if lit_ahead > max(1.0, lit) or fall <= 1 or costs_more:
            factor = math.sqrt(factor)
        else:
            best, weights, value = ahead, heavier, value_ahead
    return replace(best, found=replace(best.found, value=value))


def own_value(found: newton.Outcome, frame: Target) -> Tensor:
    """Return J of lobes that took steps, by its own weights.  [F]."""
    assert found.shown is not None
    return objective.value(found.shown.radiance, frame)
