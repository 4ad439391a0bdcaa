# SPDX-License-Identifier: Apache-2.0
"""The third measurement of `fit.py`: following a sequence.

Seconds are of the fits alone: frames are read before.
"""

import math
import statistics
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from asglight.cli.progress import Reporter
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.sequence import REFINEMENT
from asglight.images import sequence as image_sequence
from asglight.judging.clock import Clock, Point
from asglight.judging.following import follow, jumps, matched, refined
from asglight.judging.metrics import METRIC_NAMES, frame_errors, sequence_errors
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.fading import carried_on

PRESETS = (Preset.LIVE, Preset.FAST, Preset.BEST)

AVERAGED, AVERAGED_EVERY = ("env", "irr", "r0.5", "r0.25"), 4
"""What a mean is of; frames from one that counts in it to the next: neighbours are alike."""


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
        if preset in REFINEMENT:
            fitted = refined(references, *fitted, preset)
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


def _account(
    references: Sequence[Tensor],
    found: Sequence[Lobes],
    seconds: Sequence[Point],
    first: int | None,
) -> dict[str, Any]:
    """Return errors, flicker, jumps and seconds of fitted frames, dark lobes waiting as written.

    Flicker is that of all frames and, as `flicker_first`, of the first so many.
    """
    found = [carried_on(stack(list(found)))[index] for index in range(len(found))]
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
