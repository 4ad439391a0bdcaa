# SPDX-License-Identifier: Apache-2.0
"""The third measurement of `fit.py`: following a sequence.

Seconds are of the fits alone: frames are read before.
"""

import itertools
import math
import statistics
from collections.abc import Iterable, Sequence
from typing import Any

import torch
from fit_measures import Clock, Point, timed
from scipy.optimize import linear_sum_assignment
from torch import Tensor

from asglight.cli.progress import Reporter
from asglight.fitting import first_frame, paper, whole_shot
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame, one_thread
from asglight.fitting.temporal import waiting
from asglight.images import sequence as image_sequence
from asglight.judging.metrics import METRIC_NAMES, frame_errors, sequence_errors
from asglight.lobes import Lobes, asg
from asglight.lobes.data import stack

PRESETS = (Preset.LIVE, Preset.FAST)

AVERAGED, AVERAGED_EVERY = ("env", "irr", "r0.5", "r0.25"), 4
"""What a mean is of; frames from one that counts in it to the next: neighbours are alike."""

JUMP_DEG, JUMP_SHARE = 10.0, 0.01
"""A lobe jumps that turns by more from one frame to the next, with more of the flux in either."""


def following(
    sequence: image_sequence.Sequence,
    count: int | None,
    peers: int | None,
    lobes: int,
    paper_steps: int,
    report: Reporter,
) -> dict[str, Any]:
    """Follow a sequence with each preset, with the paper's recipe, and fit frames independently.

    Args:
        sequence: Frames.
        count: The first so many are used; None for all.
        peers: The first so many of those are also fitted from nothing and by the paper's recipe;
            None for all.
        lobes: N.
        paper_steps: Of the paper's recipe for a first frame; a next one takes its share of them.
        report: Shows progress.
    """
    frames = sequence.frames[:count]
    clock = Clock()
    references = [sequence.read(frame).radiance for frame in frames]
    reading = clock.seconds()["wall_seconds"]
    shape = references[0].shape
    methods: dict[str, dict[str, Any]] = {}
    for preset in PRESETS:
        options = FitOptions(lobes, preset)
        follow(references[:2], options)  # unmeasured: prepares the grids
        label = f"following: {sequence.name}, {preset}"
        fitted = follow(report.follow(references, label, len(frames)), options)
        if preset is Preset.FAST:
            fitted = refined(references, *fitted)
        methods[preset.value] = _account(references, *fitted, peers)
    alone = references[:peers]
    label = f"following: {sequence.name}, independent"
    found, seconds = follow(report.follow(alone, label, len(alone)), FitOptions(lobes), fresh=True)
    methods["independent"] = _account(alone, matched(found), seconds, peers)
    ratio = paper.NEXT_FRAME_STEPS / paper.FIRST_FRAME_STEPS
    steps = (paper_steps, math.ceil(ratio * paper_steps))
    label = f"following: {sequence.name}, paper"
    options = FitOptions(lobes, Preset.PAPER, paper_steps=steps)
    fitted = follow(report.follow(alone, label, len(alone)), options)
    methods["paper"] = _account(alone, *fitted, peers)
    return {
        "peer_frames": len(alone),
        "paper_steps": list(steps),
        "frames": list(frames),
        "rows": shape[0],
        "columns": shape[1],
        "reading_seconds_per_frame": reading / len(frames),
        "methods": methods,
    }


def follow(
    references: Iterable[Tensor], options: FitOptions, *, fresh: bool = False
) -> tuple[list[Lobes], list[Point]]:
    """Fit frames one after the other; return their lobes and seconds.

    Args:
        references: Repaired radiance of each frame.  [H, W, 3]
        options: Settings.
        fresh: Start every frame from nothing.
    """
    found: list[Lobes] = []
    seconds: list[Point] = []
    for reference in references:
        known = [] if fresh else found
        previous = known[-1] if known else None
        earlier = known[-2] if len(known) > 1 else None
        fit, spent = timed(fit_frame, reference, options, previous, earlier)
        found.append(fit.lobes)
        seconds.append(spent)
    return found, seconds


def refined(
    references: Sequence[Tensor], found: Sequence[Lobes], seconds: Sequence[Point]
) -> tuple[list[Lobes], list[Point]]:
    """Refine a shot as `asglight fit` does; its seconds count evenly on every frame."""
    clock, size = Clock(), whole_shot.CHUNK
    shot, frames = stack(list(found)), [first_frame.exposed(radiance) for radiance in references]
    chunks = [frames[at : at + size] for at in range(0, len(frames), size)]
    with one_thread():
        parts = [part for _, part, _ in whole_shot.refine_shot(shot, chunks)]
    whole = clock.seconds()
    total = [{name: s + whole[name] / len(frames) for name, s in one.items()} for one in seconds]
    return [part[index] for part in parts for index in range(len(part.axes))], total


def _account(
    references: Sequence[Tensor],
    found: Sequence[Lobes],
    seconds: Sequence[Point],
    first: int | None,
) -> dict[str, Any]:
    """Return errors, flicker, jumps and seconds of fitted frames, dark lobes waiting as written.

    Flicker is that of all frames and, as `flicker_first`, of the first so many.
    """
    found = [waiting(stack(list(found)))[index] for index in range(len(found))]
    pairs = zip(found, references, strict=True)
    judged = [(frame, frame_errors(*pair)) for frame, pair in enumerate(pairs)]
    errors, of_first = sequence_errors(judged), sequence_errors(judged[:first])
    counted = list(errors.frames.values())[::AVERAGED_EVERY]
    return {
        "wall_seconds": [spent["wall_seconds"] for spent in seconds],
        "cpu_seconds": [spent["cpu_seconds"] for spent in seconds],
        "errors": {key: [row[key] for row in errors.frames.values()] for key in METRIC_NAMES},
        "mean": {key: statistics.fmean(row[key] for row in counted) for key in AVERAGED},
        "flicker": errors.mean.get("flicker", 0.0),
        "flicker_first": of_first.mean.get("flicker", 0.0),
        "jumps": jumps(found),
    }


def matched(found: Sequence[Lobes]) -> list[Lobes]:
    """Reorder the lobes of each frame so that they turn least, the bright ones before all.

    The order of lobes that were fitted independently means nothing: only the best match between
    neighbouring frames can be called a motion.
    """
    result = list(found[:1])
    for lobes in found[1:]:
        before, share = _shares(result[-1]), _shares(lobes)
        turned = torch.acos((result[-1].axis_z @ lobes.axis_z.mT).clamp(-1, 1))  # [N, N]
        cost = turned * torch.maximum(before[:, None], share[None, :])
        _, order = linear_sum_assignment(cost.numpy())
        result.append(lobes.select(torch.from_numpy(order)))
    return result


def jumps(found: Sequence[Lobes]) -> int:
    """Count how often a lobe turns by more than 10 degrees while it holds over 1 % of the flux."""
    count = 0
    for before, lobes in itertools.pairwise(found):
        turned = (before.axis_z * lobes.axis_z).sum(-1) < math.cos(math.radians(JUMP_DEG))
        lit = torch.maximum(_shares(before), _shares(lobes)) > JUMP_SHARE
        count += int((turned & lit).sum())
    return count


def _shares(lobes: Lobes) -> Tensor:
    """Return each lobe's share of the flux, RGB summed; zeros where all is dark.  [N]."""
    flux = asg.flux(lobes).sum(-1)
    return flux / flux.sum().clamp(min=torch.finfo(flux.dtype).tiny)
