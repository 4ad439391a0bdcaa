# SPDX-License-Identifier: Apache-2.0
"""Maps side by side: some of them, each several times, each with weights of its own."""

from dataclasses import replace
from typing import TypeVar

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.probes import of_views
from asglight.fitting.steps import newton
from asglight.lobes import data as lobe_data

Framed = TypeVar("Framed", AdaptiveCells, objective.Target)


def picked(frames: objective.Target, index: Tensor) -> objective.Target:
    """Return maps by index, which may name one several times.  [F] -> [F']."""
    return replace(_picked(frames, index), places=_picked(frames.places, index))


def _picked(frames: Framed, index: Tensor) -> Framed:
    tensors = {
        name: value[index] for name, value in vars(frames).items() if isinstance(value, Tensor)
    }
    return replace(frames, **tensors)


def with_weights(frames: objective.Target, factors: Tensor) -> objective.Target:
    """Return maps under J over the factor of its first weight: steps are the same as under J.

    w_env is one number for all maps, the other weights are not.

    Args:
        frames: The maps.
        factors: Of the weight of each of `reweighting.ERRORS`; the larger one of irr and irrMax
            counts.  [F, 5]
    """
    env, irr, irr_max, rough, glossy = factors.unbind(-1)
    probes = torch.stack([torch.ones_like(env), torch.maximum(irr, irr_max), rough, glossy], -1)
    of_env = of_views(probes / env[:, None], frames.places.rows)
    return replace(frames, view_weight=frames.view_weight * of_env)


def chosen(first: Tensor, one: newton.Outcome, other: newton.Outcome) -> newton.Outcome:
    """Return the one's outcome in some frames and the other's elsewhere.

    Args:
        first: Which frames are the one's.  [F]
        one: Of every frame, after steps.
        other: As many.
    """
    assert one.shown is not None  # of lobes that took steps
    assert other.shown is not None
    shown = lobe_images.chosen(first, one.shown, other.shown)
    return newton.Outcome(
        lobe_data.chosen(first, one.lobes, other.lobes),
        torch.where(first, one.value, other.value),
        torch.where(first, one.damping, other.damping),
        shown,
    )


def put(found: newton.Outcome, index: Tensor, other: newton.Outcome) -> newton.Outcome:
    """Return an outcome with another one's frames in the places of some.

    Args:
        found: Of every frame.  F
        index: Which are replaced.  [F']
        other: By what.  F'
    """
    if not len(index):
        return found
    place = torch.zeros(len(found.value), dtype=torch.long, device=index.device)
    place[index] = torch.arange(len(index), device=index.device)
    replaced = torch.zeros_like(place, dtype=torch.bool)
    replaced[index] = True
    assert other.shown is not None  # of lobes that took steps
    spread = newton.Outcome(
        other.lobes[place], other.value[place], other.damping[place], other.shown[place]
    )
    return chosen(replaced, spread, found)
