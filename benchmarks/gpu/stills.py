# SPDX-License-Identifier: Apache-2.0
"""A thousand stills side by side, and a few of them one by one."""

import statistics
from collections.abc import Iterator

import torch

from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.fitting.stills import fit_stills
from benchmarks.gpu import data
from benchmarks.gpu.rows import Given, Row
from benchmarks.gpu.timing import seconds_of

COUNT, SHORT_COUNT, ALONE, SHORT_ALONE = 1000, 3, 4, 1
LOBES, SHORT_LOBES = 15, 2

GOAL = 60.0
"""Seconds of a thousand."""

WORSE = 1.1
"""J over that of the same map by itself, at most: rounding moves it by a few percent either way."""


def measure(given: Given) -> Iterator[Row]:
    """Fit maps that are on the host; what brings them to the device is in the seconds."""
    lobes = SHORT_LOBES if given.short else LOBES
    maps = data.stills(given, SHORT_COUNT if given.short else COUNT)
    few = maps[: SHORT_ALONE if given.short else ALONE]
    alone = [fit_frame(each, FitOptions(lobes), None).loss for each in few]
    fits, seconds = seconds_of(lambda: fit_stills(maps, lobes, device=given.device), given.device)
    found: dict[str, float | str] = {"s": seconds, "J": statistics.median(f.loss for f in fits)}
    if given.is_gpu:
        found["GB on the device"] = torch.cuda.max_memory_allocated() / 1e9
    goal = {"s": GOAL} if given.is_gpu and not given.short else {}
    yield Row(f"{len(maps)} stills in one call", found, goal)
    ratios = [fit.loss / single for fit, single in zip(fits, alone, strict=False)]
    yield Row(
        f"J of {len(few)} of them over that of one by one on the processor",
        {"median": statistics.median(ratios), "worst": max(ratios)},
        {"worst": WORSE},
    )
