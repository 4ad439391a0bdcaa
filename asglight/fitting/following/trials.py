# SPDX-License-Identifier: Apache-2.0
"""Trials: one lobe in several places competes for a frame, a few steps each, on few adaptive cells.

Whether a place is worth a lobe is settled between it and the few lobes whose light lies there. In a
trial with companions only these take steps, and the light of all others is held: J of all is J of
the few against what the others leave of the map (objective.less), and a step of four lobes costs
half of one of 15.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.steps import neighbours, newton
from asglight.lobes import Lobes


@dataclass(frozen=True)
class TrialSettings:
    """How much is spent on a trial.

    Attributes:
        steps: Steps tried.
        companions: Lobes that take them beside the one in question; None for all.
    """

    steps: int
    companions: int | None = None


def compete(
    trials: Lobes,
    indices: Sequence[int],
    frame: objective.Target,
    settings: TrialSettings,
    *,
    width_min: float,
    damping: Tensor | float = newton.DAMPING_START,
) -> tuple[Lobes, Tensor]:
    """Take steps from each trial; lobes that are black in it stay so.

    Args:
        trials: Two or more; the first is the lobes as they are.  [F, N, .]
        indices: The lobe that each trial is about; of the first, that which shall stay as it is.
        frame: The map on few adaptive cells.  F = 1
        settings: How much is spent.
        width_min: Sigma of the narrowest lobe allowed, radians.
        damping: First damping.  [1]

    Returns:
        The lobes after their steps [F, N, .] and J of each trial [F].
    """
    many, black = frame.repeated(len(indices)), (trials.amplitude <= 0).all(-1)
    if settings.companions is None or settings.companions + 1 >= trials.count:
        found = newton.minimise(
            trials, many, settings.steps, damping=damping, width_min=width_min, still=black
        )
        return found.lobes, found.value
    shown = lobe_images.images(trials, many.places)
    moving = _together(shown, many, indices, settings.companions + 1)
    light = neighbours.pick(shown.light, moving, 3)
    some = light.mT @ neighbours.pick(shown.values, moving, shown.values.shape[-1])
    found = newton.minimise(
        neighbours.some(trials, moving),
        objective.less(many, shown.radiance - some),
        settings.steps,
        damping=damping,
        width_min=width_min,
        still=neighbours.pick(black, moving),
    )
    return neighbours.put(trials, moving, found.lobes), found.value


def _together(
    shown: lobe_images.Images, frame: objective.Target, indices: Sequence[int], count: int
) -> Tensor:
    """Return in each trial the lobe in question and those whose light lies most where it does.

    Where it does in any of the trials: all of them are judged on about the same lobes.

    Returns:
        Ascending indices.  [F, count]
    """
    sent = shown.light.sum(-1, keepdim=True) * shown.values * frame.places.share.sqrt()[:, None]
    norm = sent.norm(dim=-1, keepdim=True).clamp(min=torch.finfo(sent.dtype).tiny)
    own = torch.tensor(indices, device=sent.device)
    rows = torch.arange(len(own), device=sent.device)
    there = sent[rows[1:], own[1:]].sum(0)
    alike = (sent / norm) @ there  # [F, N], over the norm of `there`, which is the same for all
    alike[rows, own] = torch.inf
    return alike.topk(count, dim=-1).indices.sort(-1).values
