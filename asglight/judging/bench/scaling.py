# SPDX-License-Identifier: Apache-2.0
"""How time and memory grow with texels, lobes and frames, with fitted exponents.

Times are CPU seconds of one thread, the least of some repeats; exponents are of `power_law`.
"""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.judging.bench.memory import peak_memory
from asglight.judging.bench.plan import Plan
from asglight.judging.bench.power_law import power_law
from asglight.judging.bench.still import Run, lobes_of, peer_run, preset_run
from asglight.judging.clock import Clock, timed
from asglight.judging.compare.maps import Follow
from asglight.judging.metrics import frame_errors
from asglight.lobes import Lobes
from asglight.sphere import latlong
from asglight.threads import one_thread

LIVE = "live, a next frame"


def measured(
    source: Tensor, frames: Sequence[Tensor], done: Sequence[Run], plan: Plan, follow: Follow
) -> dict[str, Any]:
    """Measure the three ways to grow.

    Args:
        source: The map as finely as its file has it.  [H, W, 3]
        frames: The map at the size that is fitted, or the frames of a sequence.  [H, W, 3]
        done: Fits of the first of these with several numbers of lobes.
        plan: What is measured.
        follow: Shows how far this is.
    """
    return {
        "texels": by_texels(source, plan, follow),
        "lobes": by_lobes(frames[0], done, plan, follow),
        "frames": by_frames(frames, plan, follow),
    }


def by_texels(source: Tensor, plan: Plan, follow: Follow) -> dict[str, Any]:
    """Fit the map at several sizes; one that is finer than its file has its texels split.

    Args:
        source: [H, W, 3]
        plan: What is measured.
        follow: Shows how far this is.
    """
    measures: dict[str, list[tuple[float, int | None]]] = {"fast": [], LIVE: [], "em": []}
    for width in follow(plan.widths, "scaling with texels", len(plan.widths)):
        reference = latlong.reduce(source, width // 2, width)
        fit_frame(reference, FitOptions(1), None)  # unmeasured: prepares the grids of this size
        several = [preset_run(reference, "fast", plan.lobes, 1) for _ in range(plan.repeats)]
        measures["fast"].append(_least(several))
        lobes = lobes_of(several, "fast", plan.lobes)
        measures[LIVE].append((_next_frame(reference, lobes, plan.repeats), None))
        measures["em"].append(_least([peer_run(reference, "em", plan.lobes, plan, follow)]))
    texels = [width * width // 2 for width in plan.widths]
    account = {name: _account(texels, listed) for name, listed in measures.items()}
    return {"unit": "texels", "source_columns": source.shape[1], "methods": account}


def by_lobes(reference: Tensor, done: Sequence[Run], plan: Plan, follow: Follow) -> dict[str, Any]:
    """Return times by number of lobes of the fits that were made, and of a next frame of `live`."""
    methods: dict[str, Any] = {}
    for name in ("fast", "best", "em"):
        listed = [run for run in done if run.method == name]
        methods[name] = _account([run.count for run in listed], [_least([run]) for run in listed])
    counts = plan.counts["fast"]
    times = [
        (_next_frame(reference, lobes_of(done, "fast", count), plan.repeats), None)
        for count in follow(counts, "scaling with lobes", len(counts))
    ]
    methods[LIVE] = _account(counts, times)
    return {"unit": "lobes", "methods": methods}


def by_frames(frames: Sequence[Tensor], plan: Plan, follow: Follow) -> dict[str, Any]:
    """Follow a long sequence with `live`; return its seconds, and its error, at several lengths.

    Lengths count the frames that follow the first one. The frames turn about the vertical by one
    texel each, exactly, so that those of a still are equally hard and an error that grows is drift.
    A still comes round after as many frames as it has columns.
    """
    counts, longest = plan.frame_counts, plan.frame_counts[-1]
    options = FitOptions(plan.lobes, Preset.LIVE)
    listed: list[tuple[float, int | None]] = []
    indices = follow(range(1, longest + 1), "scaling with frames", longest)
    with one_thread(), peak_memory() as peak:
        found = [fit_frame(moved(frames, 0), FitOptions(plan.lobes), None).lobes]
        clock = Clock()
        for index in indices:
            with clock.paused():
                frame = moved(frames, index)
            earlier = found[-2] if index > 1 else None
            found.append(fit_frame(frame, options, found[-1], earlier).lobes)
            if index in counts:
                listed.append((clock.seconds()["cpu_seconds"], None))
    account = _account(counts, listed)
    account["r0.25"] = [
        frame_errors(found[index], moved(frames, index)).values["r0.25"] for index in counts
    ]
    return {"unit": "frames", "methods": {LIVE: account}, "peak_bytes": peak.grown}


def moved(frames: Sequence[Tensor], index: int) -> Tensor:
    """Return a frame of an endless sequence: those given, there and back, each turned further.

    Args:
        frames: Maps of one size.  [H, W, 3]
        index: Which; it is turned by as many texels.
    """
    cycle = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    return torch.roll(frames[cycle[index % len(cycle)]], index, dims=1)


def _next_frame(reference: Tensor, lobes: Lobes, repeats: int) -> float:
    """Return CPU seconds of a frame that has turned by a texel."""
    turned = torch.roll(reference, 1, dims=1)
    options = FitOptions(lobes.count, Preset.LIVE)
    fit_frame(turned, options, lobes)  # unmeasured: prepares the grids
    with one_thread():
        several = [timed(fit_frame, turned, options, lobes)[1] for _ in range(repeats)]
    return min(seconds["cpu_seconds"] for seconds in several)


def _least(several: Sequence[Run]) -> tuple[float, int | None]:
    seconds = min(run.checkpoints[-1].seconds["cpu_seconds"] for run in several)
    peaks = [run.peak_bytes for run in several if run.peak_bytes is not None]
    return seconds, max(peaks) if peaks else None


def _account(sizes: Sequence[int], listed: Sequence[tuple[float, int | None]]) -> dict[str, Any]:
    """Return sizes, seconds, bytes where they are known, and the power law of the seconds."""
    seconds = [passed for passed, _ in listed]
    law = power_law(sizes, seconds)
    return {
        "sizes": list(sizes),
        "cpu_seconds": seconds,
        "peak_bytes": [peak for _, peak in listed],
        "law": None if law is None else vars(law),
    }
