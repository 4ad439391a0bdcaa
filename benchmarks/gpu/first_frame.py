# SPDX-License-Identifier: Apache-2.0
"""A first frame: the first of a process, which records what it does, and a later one."""

from collections.abc import Iterator

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from benchmarks.gpu.data import maps
from benchmarks.gpu.rows import Given, Row
from benchmarks.gpu.timing import seconds_of

LOBES, SHORT_LOBES = 15, 2


def measure(given: Given) -> Iterator[Row]:
    """Fit two maps with `fast`, there and here, and one with `best`."""
    count = SHORT_LOBES if given.short else LOBES
    one, other = list(maps(given).values())[:2]
    fast = FitOptions(count, Preset.FAST)
    for where in dict.fromkeys((given.device, "cpu")):
        for word, reference in (("first", one), ("later", other)):
            there = reference.to(where)
            fit, seconds = seconds_of(lambda there=there: fit_frame(there, fast, None), where)
            yield Row(f"{word} map, fast, {where}", {"s": seconds, "J": fit.loss})
    if not given.short:
        there, best = other.to(given.device), FitOptions(count, Preset.BEST)
        fit, seconds = seconds_of(lambda: fit_frame(there, best, None), given.device)
        yield Row(f"later map, best, {given.device}", {"s": seconds, "J": fit.loss})
