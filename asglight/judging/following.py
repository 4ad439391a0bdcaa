# SPDX-License-Identifier: Apache-2.0
"""A sequence fitted frame by frame against the clock, and how its lobes move.

Seconds are of the fits alone: frames are read before.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.following import whole_shot
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import REFINEMENT, fit_frame
from asglight.judging.clock import Clock, Point, timed
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.lobes.identity import matching
from asglight.threads import one_thread

JUMP_DEG, JUMP_SHARE = 10.0, 0.01
"""A lobe jumps that turns by more from one frame to the next, with more of the flux in either."""


def follow(
    references: Iterable[Tensor], options: FitOptions, *, fresh: bool = False
) -> tuple[list[Lobes], list[Point]]:
    """Fit frames one after the other; return their lobes and seconds.

    Args:
        references: Repaired radiance of each frame.  [H, W, 3]
        options: Settings.
        fresh: Start every frame from nothing.
    """
    options = replace(options, moving=not fresh)
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
    references: Sequence[Tensor],
    found: Sequence[Lobes],
    seconds: Sequence[Point],
    preset: Preset = Preset.FAST,
) -> tuple[list[Lobes], list[Point]]:
    """Refine a shot as `asglight fit` does; its seconds count evenly on every frame.

    Args:
        references: Repaired radiance of each frame.  [H, W, 3]
        found: The lobes of each.  [N, .]
        seconds: Of each.
        preset: One of `REFINEMENT`.
    """
    clock, size = Clock(), whole_shot.CHUNK
    shot, frames = stack(list(found)), [first_frame.exposed(radiance) for radiance in references]
    chunks = [frames[at : at + size] for at in range(0, len(frames), size)]
    threads = torch.get_num_threads()
    with one_thread(), torch.inference_mode():
        lobes, _ = whole_shot.refine_shot(shot, lambda: chunks, REFINEMENT[preset], threads=threads)
    whole = clock.seconds()
    total = [{name: s + whole[name] / len(frames) for name, s in one.items()} for one in seconds]
    return [lobes[index].clone() for index in range(len(frames))], total


def matched(found: Sequence[Lobes]) -> list[Lobes]:
    """Reorder the lobes of each frame so that they turn least from the one before.

    The order of lobes that were fitted independently means nothing: only the best match between
    neighbouring frames can be called a motion.
    """
    result = list(found[:1])
    for lobes in found[1:]:
        result.append(matching.matched(lobes, result[-1]))
    return result


def jumps(found: Sequence[Lobes]) -> int:
    """Count how often a lobe turns by more than 10 degrees while it holds over 1 % of the flux."""
    count = 0
    for before, lobes in itertools.pairwise(found):
        turned = (before.axis_z * lobes.axis_z).sum(-1) < math.cos(math.radians(JUMP_DEG))
        lit = torch.maximum(matching.flux_shares(before), matching.flux_shares(lobes)) > JUMP_SHARE
        count += int((turned & lit).sum())
    return count
