# SPDX-License-Identifier: Apache-2.0
"""Relocation: the lobe that a frame needs least goes to where one more is needed.

Steps go downhill, so lobes keep the lamps that they have. A lamp that comes into sight, is switched
on or comes near needs more of them. Candidates are one half of the lobe that most of J lies on
(split_merge.py), and the direction in which the sharpest probe lacks most light. Where one more may
be lit, the lobes as they were before their steps compete as well, with a light where they lack
most: a lamp that is switched on pulls lobes away from what they show. A few steps of each on few
cells tell whether J falls by enough [in the spirit of split-and-merge EM, Ueda et al. 2000].

A relocated lobe is another light, unless it comes to look like one that was there (slots.py): it
takes a track that is dark, and its own track fades where it was.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting.first_frame import split_merge
from asglight.fitting.following.trials import TrialSettings, compete
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.adaptive_cells import to_cells
from asglight.fitting.loss.probes import PROBES, directions, probe, split
from asglight.fitting.steps import newton
from asglight.lobes import Lobes
from asglight.lobes.data import joined, stack
from asglight.lobes.frames import axes_around

LACKING_SHARE = 5e-3
"""Filtered radiance lacking in a direction, over the largest there is, from which it is tried."""

SHARPNESS = 60.0
"""Of a lobe put there: sigma = 5 degrees, about the probe that found the direction."""

COST = 0.002
"""What a light that begins or ends costs: a trial must lower J by more. Under a slow sky a tenth of
it lets lights come and go for nothing that is seen, and flicker."""

GAIN = 0.02
"""Share of J by which a trial must lower J as well: under noise J is large, and all trials gain
something."""


@dataclass(frozen=True)
class Relocation:
    """How much is spent on relocating lobes in a frame.

    Attributes:
        rounds: Lobes relocated, at most; where fewer are lit than may be, lights are added beyond.
        trial: Steps of each trial, and the lobes that take them.
        splits: Halves that compete in a round.
    """

    rounds: int
    trial: TrialSettings
    splits: int = 2


def relocated(
    start: newton.Outcome,
    before: Lobes,
    frame: objective.Target,
    count: int,
    room: int,
    width_min: float,
    settings: Relocation,
) -> tuple[Lobes, Tensor]:
    """Relocate or add lobes one by one, while that gains enough.

    Args:
        start: Lit lobes.  F = 1
        before: The same before they took any step.  [N, .]
        frame: The map on few cells.
        count: Lobes lit at most.
        room: New lobes at most: tracks that are free.
        width_min: Sigma of the narrowest lobe allowed, radians.
        settings: How much is spent.

    Returns:
        All lobes [N', .], the new ones last, and which of them stay lit [N'].
    """
    best = start.lobes[0]
    stays = ~temporal.is_dark(best)
    for number in range(room):
        lit = torch.nonzero(stays).flatten()
        own, is_full = best.select(lit), len(lit) >= count
        if is_full and number >= settings.rounds:
            break
        gone, trials = _trials(own, frame, is_full, width_min, settings.splits)
        if number == 0 and not is_full:
            trials += _one_more(before.select(lit), frame)
        found, value = compete(
            stack([joined(own, _black_like(own)), *trials]),
            [own.count] * (1 + len(trials)),
            frame,
            settings.trial,
            width_min=width_min,
            damping=start.damping,
        )
        stayed = float(value[0])
        if float(value[1:].min()) > stayed - max(COST, GAIN * stayed):
            break
        others, new = found[int(value.argmin())].split(own.count)
        best = joined(best.replaced(lit, others), new)
        stays = torch.cat([stays, torch.ones_like(stays[:1])])
        if gone is not None:
            stays[lit[gone]] = False
    return best, stays


def _trials(
    lobes: Lobes, frame: objective.Target, full: bool, width_min: float, splits: int
) -> tuple[int | None, list[Lobes]]:
    """Return which lobe goes, if one must, and the lobes with one more in each candidate place.

    Args:
        lobes: Lit lobes.  [N, .]
        frame: The map on few cells.
        full: Whether no more may be lit.
        width_min: Sigma of the narrowest lobe allowed, radians.
        splits: Halves among the candidates.

    Returns:
        The index of the lobe that goes, which is black in all candidates, and these [N + 1, .].
    """
    gone = None
    if full:
        shown = lobe_images.images(lobes[None], frame.places)
        costs, filled = split_merge.leave_one_out_costs(shown, frame)
        gone = int(costs.argmin())
        lobes = split_merge.without(gone, lobes, filled, width_min)
    new = lobes.count
    lobes = joined(lobes, _black_like(lobes))
    shown = lobe_images.images(lobes[None], frame.places)
    costs = torch.full((lobes.count,), torch.inf)
    costs[new] = 0.0
    halves = [each for each in split_merge.ordered(shown, frame, costs) if each.lobe != gone]
    trials = [split_merge.halved(lobes, *each) for each in halves[:splits]]
    there = placed(lobes, new, shown, frame)
    return gone, trials if there is None else [*trials, there]


def _one_more(lobes: Lobes, frame: objective.Target) -> list[Lobes]:
    """Return lobes with one more where light lacks most, if any does.  [N, .] -> [N + 1, .]."""
    more = joined(lobes, _black_like(lobes))
    there = placed(more, lobes.count, lobe_images.images(more[None], frame.places), frame)
    return [] if there is None else [there]


def placed(
    lobes: Lobes, index: int, seen: lobe_images.Images, frame: objective.Target
) -> Lobes | None:
    """Put a lobe where the sharpest probe lacks most light; None where nothing lacks.

    Args:
        lobes: All lobes, that one dark.  [N, .]
        index: Which.
        seen: What they show.
        frame: The map and its weights.
    """
    sharpest, rows = PROBES[-1], frame.places.rows
    wanted = split(probe(to_cells(frame.radiance, frame.places), rows), rows)[-1][0]  # [3, D]
    shown = split(probe(to_cells(seen.radiance, frame.places), rows), rows)[-1][0]
    lacking = wanted - shown
    place = int(lacking.sum(0).argmax())
    if float(lacking[:, place].sum()) < LACKING_SHARE * float(wanted.sum(0).max()):
        return None
    direction = directions(sharpest, rows).to(wanted)[place]
    own = torch.tensor([index])
    return lobes.replaced(
        own,
        Lobes(
            axes_around(direction)[None],
            torch.full_like(lobes.sharpness[:1], SHARPNESS),
            lacking[None, :, place].clamp(min=0),
            lobes.form,
        ),
    )


def _black_like(lobes: Lobes) -> Lobes:
    """Return one black lobe.  [1, .]."""
    one = lobes.select(torch.tensor([0]))
    return replace(one, amplitude=torch.zeros_like(one.amplitude))
