# SPDX-License-Identifier: Apache-2.0
"""Time the re-shading of six balls by 15 lobes: specialised programs against the general one.

The two take turns in one run, so that what else the machine does meets both. A time is the median
from the call to the end of the drawing (`finish`), with the packing of lobes in Python; CPU time is
that of all threads, and on a software renderer is what a busy machine does not change.

    python -m benchmarks.shaded.viewer
"""

import argparse
import statistics
import time
from collections.abc import Sequence
from typing import NamedTuple

import moderngl
import numpy as np
import torch

from asglight.lobes import Form, Lobes, asg, frames
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.context import describe, standalone_context
from asglight.viewer.gl.passes import radiance_target
from asglight.viewer.state.balls import Material, ball_row

SHARPNESS = (0.3, 0.5, 1, 2, 3, 5, 8, 12, 20, 40, 80, 200, 1e3, 5e3, 3e4)
"""Geometric means, as fits of 15 lobes have them: from the sky to the sun."""

RATIO = 4.0
ROUND_LOBES = "round"


class Times(NamedTuple):
    """Milliseconds: the first picture, whose program is compiled; later ones; their CPU time."""

    first: float
    wall: float
    cpu: float


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=128, help="pixels of a ball (128)")
    parser.add_argument("--repeats", type=int, default=30, help="pictures of each kind (30)")
    options = parser.parse_args(argv)
    context = standalone_context()
    print(f"{describe(context)}; {len(SHARPNESS)} lobes, six balls of {options.size} pixels\n")
    print("| lobes | balls | first, ms | ms | CPU ms | general: ms | CPU ms | ratio of CPU |")
    print("|---|---|---|---|---|---|---|---|")
    for name in (*Form, ROUND_LOBES):
        for material in Material:
            lobes = scene(Form.ASG, 1.0) if name == ROUND_LOBES else scene(Form(name), RATIO)
            special, general = measured(context, lobes, material, options.size, options.repeats)
            print(
                f"| {name} | {material} | {special.first:.0f} | {special.wall:.1f} | "
                f"{special.cpu:.1f} | {general.wall:.1f} | {general.cpu:.1f} | "
                f"{general.cpu / special.cpu:.2f} |"
            )
    context.release()


def scene(form: Form, ratio: float) -> Lobes:
    """Return one lobe of each sharpness, all of the same flux.  [15, .]."""
    generator = torch.Generator().manual_seed(0)
    count = len(SHARPNESS)
    axes = frames.axes_from_quaternion(torch.randn(count, 4, generator=generator).double())
    mean = torch.tensor(SHARPNESS, dtype=torch.float64)[:, None]
    ratio = 1.0 if form is Form.SG else ratio
    sharpness = mean * torch.tensor([ratio**0.5, ratio**-0.5], dtype=torch.float64)
    even = torch.ones(count, 3, dtype=torch.float64)
    lobes = Lobes(axes, sharpness, even, form)
    return Lobes(axes, sharpness, even / asg.integral(lobes)[:, None], form)


def measured(
    context: moderngl.Context, lobes: Lobes, material: Material, size: int, repeats: int
) -> tuple[Times, Times]:
    """Time the specialised pass and the general one in turns."""
    balls = ball_row(material)
    target = radiance_target(context, (3 * size, 2 * size))
    cells = [(i % 3 * size, i // 3 * size, size) for i in range(len(balls))]
    table = albedo_table(context)
    passes = [BallsPass(context, table, specialise=special) for special in (True, False)]

    def picture(balls_pass: BallsPass) -> tuple[float, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        balls_pass.draw(lobes, balls, np.eye(3), cells, target)
        context.finish()
        return 1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu)

    first = [picture(balls_pass)[0] for balls_pass in passes]
    rounds = [[picture(balls_pass) for balls_pass in passes] for _ in range(repeats)]
    special, general = (
        Times(first[i], *(statistics.median(r[i][kind] for r in rounds) for kind in (0, 1)))
        for i in (0, 1)
    )
    return special, general


if __name__ == "__main__":
    main()
