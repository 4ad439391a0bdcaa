# SPDX-License-Identifier: Apache-2.0
"""What compiled steps gain: the parts of a step and whole frames, with them and without, in turn.

    python -m benchmarks.steps.compiled ../shared/hdri/lobby.exr ../shared/sequences/tunnel

Both take turns on one thread, and each figure is the least of several, so that what other programs
take counts little. The steps that are not compiled are those of torch.
"""

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any
from unittest import mock

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.first_frame import seeding
from asglight.fitting.first_frame.fit import exposed
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.options import LOBES, FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.fitting.steps import equations, light, newton
from asglight.images.sequence import open_sequence
from asglight.lobes import Form, Lobes
from asglight.threads import one_thread
from benchmarks.given import refused_in_a_line

PART_RUNS = 30

Row = tuple[str, float, float]
"""What; seconds compiled and in torch."""


def main(argv: Sequence[str] | None = None) -> int:
    """Time a map and a sequence, print a table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.steps.compiled", description=__doc__
    )
    parser.add_argument("map", metavar="MAP", help="a latlong map")
    parser.add_argument("sequence", metavar="DIR", help="a sequence of latlong maps")
    parser.add_argument("--frames", type=int, default=24, metavar="N", help="the first N (24)")
    parser.add_argument("--runs", type=int, default=3, metavar="N", help="of whole frames (3)")
    options = parser.parse_args(argv)
    if compiled.LIBRARY is None:
        parser.error("no steps were compiled here; install a C compiler and asglight again")
    with refused_in_a_line(parser):
        still, shot = open_sequence(options.map), open_sequence(options.sequence)
        radiance = still.read(still.frames[0]).radiance
        maps = [shot.read(frame).radiance for frame in shot.frames[: options.frames]]
    if len(maps) < 2:
        parser.error(f"{options.sequence}: {len(maps)} frame; expected two or more to follow")
    with one_thread(), torch.inference_mode():
        rows = [*parts(radiance), *wholes(radiance, maps, options.runs)]
    print(table(rows))
    return 0


@contextlib.contextmanager
def in_torch() -> Iterator[None]:
    """Take steps that are not compiled."""
    with mock.patch.object(compiled, "LIBRARY", None):
        yield


def in_turn(calls: dict[str, Callable[[], Any]], runs: int) -> list[Row]:
    """Return the least seconds of each call, compiled and in torch."""
    found = []
    for name, call in calls.items():
        ours, torchs = [], []
        for _ in range(runs):
            ours.append(_seconds(call))
            with in_torch():
                torchs.append(_seconds(call))
        found.append((name, min(ours), min(torchs)))
    return found


def _seconds(call: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def parts(reference: Tensor) -> list[Row]:
    """Return the parts of a step on a map.  [H, 2 H, 3]."""
    frame = exposed(reference)
    cells = seeding.cells(reference / frame.exposure)
    lobes = seeding.seed_lobes(cells, LOBES, Form.ASG, float("inf"))[None]
    target = objective.target(frame.radiance)
    shown = lobe_images.images(lobes, target.places)
    radiance = shown.radiance
    loss_gradient = objective.loss_gradient(radiance, target)
    calls = {
        "images of the lobes": lambda: lobe_images.images(lobes, target.places),
        "J": lambda: objective.value(radiance, target),
        "its slope on adaptive cells": lambda: objective.loss_gradient(
            radiance, target, target_sizes
        ),
        "matrix and slope": lambda: equations.normal_equations(shown, loss_gradient, target),
        "four steps": lambda: newton.minimise(lobes, target, 4, tolerance=0.0, shown=shown),
        "light": lambda: light.solve_amplitudes(shown, target),
    }
    target_sizes = objective.loss_terms(radiance, target)
    return in_turn(calls, PART_RUNS)


def wholes(reference: Tensor, maps: Sequence[Tensor], runs: int) -> list[Row]:
    """Return a first frame of a map and the mean next frame of a sequence.

    Args:
        reference: The map.  [H, 2 H, 3]
        maps: The sequence.  [H, 2 H, 3] each
        runs: Of each.
    """
    fast = FitOptions(LOBES, Preset.FAST)
    first = fit_frame(maps[0], fast, None).lobes
    calls = {"a first frame, fast": lambda: fit_frame(reference, fast, None)}
    found = in_turn(calls, runs)
    for preset in (Preset.LIVE, Preset.FAST):
        options = FitOptions(LOBES, preset)
        calls = {
            f"a next frame, {preset.value}": lambda options=options: followed(maps, first, options)
        }
        found += [
            (name, ours / (len(maps) - 1), torchs / (len(maps) - 1))
            for name, ours, torchs in in_turn(calls, runs)
        ]
    return found


def followed(maps: Sequence[Tensor], first: Lobes, options: FitOptions) -> list[Lobes]:
    """Follow a sequence from the lobes of its first frame."""
    found = [first]
    for radiance in maps[1:]:
        earlier = found[-2] if len(found) > 1 else None
        found.append(fit_frame(radiance, options, found[-1], earlier).lobes)
    return found


def table(rows: Sequence[Row]) -> str:
    """Return a row a part."""
    lines = ["| part | compiled, ms | torch, ms | times faster |", "|---|--:|--:|--:|"]
    lines += [
        f"| {name} | {1e3 * ours:.3g} | {1e3 * torchs:.3g} | {torchs / ours:.1f} |"
        for name, ours, torchs in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
