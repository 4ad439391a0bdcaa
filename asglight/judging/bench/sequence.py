# SPDX-License-Identifier: Apache-2.0
"""A sequence followed by every preset, beside frames that do not know of each other.

Seconds are of the fits alone, on one thread; `fast` and `best` count their second pass over the
shot, spread evenly. Every method fits the same frames, and every frame is judged for all at once.
"""

import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.judging.bench.memory import peak_memory
from asglight.judging.bench.plan import Plan
from asglight.judging.clock import Point, timed
from asglight.judging.compare import methods
from asglight.judging.compare.maps import Follow
from asglight.judging.compare.methods import METHODS, Task
from asglight.judging.following import follow as fit_frames
from asglight.judging.following import jumps, matched, refined
from asglight.judging.metrics import FrameErrors, maps_errors, sequence_errors
from asglight.lobes import Lobes, texels
from asglight.lobes.data import stack
from asglight.lobes.identity.tracks import as_tracks
from asglight.peers.approximation import LobeSum
from asglight.threads import one_thread

TITLES = {
    "live": "asglight, live",
    "fast": "asglight, fast",
    "best": "asglight, best",
    "independent": "asglight, fast, each frame from nothing",
    "em": METHODS["em"].title + ", each frame from nothing",
    "paper": METHODS["paper"].title,
}

Fitted = tuple[list[Lobes], list[Point]]


def measured(references: Sequence[Tensor], plan: Plan, follow: Follow) -> dict[str, Any]:
    """Fit a sequence with every method and judge every frame.

    Args:
        references: Repaired radiance of the frames, each with some light in it.  [H, W, 3]
        plan: What is measured.
        follow: Shows how far this is.
    """
    ratio = paper.NEXT_FRAME_STEPS / paper.FIRST_FRAME_STEPS
    steps = (plan.paper_steps, max(round(ratio * plan.paper_steps), 1))
    fits = _fits(plan, steps)
    found: dict[str, list[Lobes]] = {}
    result: dict[str, dict[str, Any]] = {}
    for name, fit in fits.items():
        frames = follow(references, f"following: {name}", len(references))
        with peak_memory() as peak, one_thread():
            lobes, seconds = fit(references, frames)
        found[name] = lobes
        result[name] = {
            "title": TITLES[name],
            "wall_seconds": [spent["wall_seconds"] for spent in seconds],
            "cpu_seconds": [spent["cpu_seconds"] for spent in seconds],
            "next_cpu_seconds": statistics.fmean(spent["cpu_seconds"] for spent in seconds[1:]),
            "peak_bytes": peak.grown,
            "jumps": jumps(lobes),
        }
    for name, errors in _judged(found, references, follow).items():
        result[name] |= errors
    return {"paper_steps": list(steps), "methods": result}


def _fits(
    plan: Plan, paper_steps: tuple[int, int]
) -> dict[str, Callable[[Sequence[Tensor], Iterable[Tensor]], Fitted]]:
    """Return a function for each method, from the frames and the same with progress."""

    def ours(preset: Preset, *, again: bool = False) -> Callable[..., Fitted]:
        """Return how a preset fits a sequence, with the pass over the whole shot if `again`."""

        def fit(references: Sequence[Tensor], frames: Iterable[Tensor]) -> Fitted:
            lobes, seconds = fit_frames(frames, FitOptions(plan.lobes, preset))
            if again:
                lobes, seconds = refined(references, lobes, seconds, preset)
            shot = as_tracks(stack(lobes))
            return [shot[k] for k in range(len(lobes))], seconds

        return fit

    def independent(references: Sequence[Tensor], frames: Iterable[Tensor]) -> Fitted:
        lobes, seconds = fit_frames(frames, FitOptions(plan.lobes), fresh=True)
        return matched(lobes), seconds

    def em(references: Sequence[Tensor], frames: Iterable[Tensor]) -> Fitted:
        """Fit each frame by itself and match the lobes of neighbouring ones."""
        lobes, seconds = [], []
        for frame in frames:
            task = Task(frame, plan.floats, 0, lambda: None)
            fit, spent = timed(methods.run, METHODS["em"], task)
            assert isinstance(fit, LobeSum)
            lobes.append(fit.lobes)
            seconds.append(spent)
        return matched(lobes), seconds

    def papers(references: Sequence[Tensor], frames: Iterable[Tensor]) -> Fitted:
        return fit_frames(frames, FitOptions(plan.lobes, Preset.PAPER, paper_steps=paper_steps))

    return {
        "live": ours(Preset.LIVE),
        "fast": ours(Preset.FAST, again=True),
        "best": ours(Preset.BEST, again=True),
        "independent": independent,
        "em": em,
        "paper": papers,
    }


def _judged(
    found: dict[str, list[Lobes]], references: Sequence[Tensor], follow: Follow
) -> dict[str, dict[str, Any]]:
    """Return errors by frame, their means, and flicker, for each method."""
    rows: dict[str, list[tuple[int, FrameErrors]]] = {name: [] for name in found}
    for index, reference in enumerate(follow(references, "judging frames", len(references))):
        height, width, _ = reference.shape
        maps = torch.stack(
            [texels.texel_means(lobes[index].to(torch.float32), height, width)
             for lobes in found.values()]
        )  # fmt: skip
        for name, errors in zip(found, maps_errors(maps, reference), strict=True):
            rows[name].append((index, errors))
    result = {}
    for name, listed in rows.items():
        errors = sequence_errors(listed)
        by_frame = {key: [one.values[key] for _, one in listed] for key in listed[0][1].values}
        result[name] = {"errors": by_frame, "mean": errors.mean}
    return result
