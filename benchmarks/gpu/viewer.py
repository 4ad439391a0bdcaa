# SPDX-License-Identifier: Apache-2.0
"""The viewer's balls through EGL: frames a second, with and without the reference."""

import time
from collections.abc import Callable, Iterator

import numpy as np

from asglight.lobes import Lobes
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.context import describe, standalone_context
from asglight.viewer.gl.layers import SAMPLES_MOST
from asglight.viewer.gl.passes import radiance_target
from asglight.viewer.gl.reference.reference_pass import ReferencePass
from asglight.viewer.state.balls import ball_row
from benchmarks.gpu.data import lamps, maps
from benchmarks.gpu.rows import Given, Row

SIZE, SHORT_SIZE = 512, 16
LOBES = (15, 60)

SECONDS = 2.0
"""Of pictures that are counted, after one that compiles the programs."""

SOFTWARE = ("llvmpipe", "softpipe", "swiftshader")
"""What draws where there is no GPU."""


def measure(given: Given) -> Iterator[Row]:
    """Draw six balls by lobes, and with them those of the reference, which gathers samples."""
    size, seconds = (SHORT_SIZE, 0.0) if given.short else (SIZE, SECONDS)
    context = standalone_context()
    name = describe(context)
    yield Row("drawn by", {"name": name})
    balls, table = ball_row(), albedo_table(context)
    cells = [(k % 3 * size, k // 3 * size, size) for k in range(len(balls))]
    target = radiance_target(context, (3 * size, 2 * size))
    drawing, reference = BallsPass(context, table), ReferencePass(context, table)
    reference.set_map(next(iter(maps(given).values())).numpy())

    def by_lobes(lobes: Lobes) -> None:
        drawing.draw(lobes, balls, np.eye(3), cells, target)

    def by_both(lobes: Lobes) -> None:
        by_lobes(lobes)
        if reference.samples >= reference.target_samples:
            reference.restart(balls, np.eye(3), cells, (3 * size, 2 * size))
        reference.accumulate(SAMPLES_MOST)

    for count in LOBES:
        lobes = lamps(count, 0)
        for word, draw in (("lobes alone", by_lobes), ("lobes and reference", by_both)):
            reference.restart(balls, np.eye(3), cells, (3 * size, 2 * size))
            rate = _rate(lambda lobes=lobes, draw=draw: draw(lobes), context.finish, seconds)
            what = f"six balls of {size} pixels, {count} lobes, {word}"
            yield Row(what, {"frames a second": rate})
    context.release()
    if given.is_gpu and any(each in name.lower() for each in SOFTWARE):
        raise RuntimeError(f"EGL draws with {name}; expected a GPU. Is its driver's EGL installed?")


def _rate(draw: Callable[[], None], finish: Callable[[], None], seconds: float) -> float:
    """Return pictures a second; each is waited for, as a screen does."""
    draw()
    finish()
    begin, count = time.perf_counter(), 0
    while not count or time.perf_counter() - begin < seconds:
        draw()
        finish()
        count += 1
    return count / (time.perf_counter() - begin)
