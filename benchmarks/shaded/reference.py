# SPDX-License-Identifier: Apache-2.0
"""Measure the viewer's reference: error against samples, and what 16 samples cost.

Errors are relative L1 in percent at 16 / 64 / 256 / 1024 samples. Truth are sums in float64 over
all texels of maps averaged down to 64 x 128 (tests/support), seen on balls of 48 pixels. Markdown
tables go to standard output.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import moderngl
import numpy as np
import torch

from asglight.images import read_latlong
from asglight.sphere import latlong
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.context import describe, standalone_context
from asglight.viewer.gl.reference.reference_pass import ReferencePass
from asglight.viewer.state.balls import ball_row
from benchmarks.given import refused_in_a_line

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
import ball_truth

EXAMPLE = "example: python -m benchmarks.shaded.reference ../shared/hdri/*.exr"
SAMPLES = (16, 64, 256, 1024)
ROWS, SIZE = 64, 48
DRAWS = 16
"""Of the truth of sharp balls: its own noise stays below 1 %."""

COST_SIZE = 128
ROW = ball_row()
HEADING = ["roughness " + f"{ball.roughness:g}" if ball.roughness else "Lambert" for ball in ROW]


def main(argv: Sequence[str] | None = None) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, epilog=EXAMPLE)
    parser.add_argument("maps", nargs="*", type=Path, help="latlong maps; some are made up besides")
    paths = parser.parse_args(argv).maps
    with refused_in_a_line(parser):
        read = list(_read(paths))
    context = standalone_context()
    print(describe(context), "\n")
    reference = ReferencePass(context, albedo_table(context))
    _row("map", *HEADING)
    _row(*["---"] * (1 + len(ROW)))
    for name, radiance in [*_made_up(), *read]:
        truth = _truth(radiance)
        errors = [
            [f"{100 * _l1(f, t):.1f}" for f, t in zip(image, truth, strict=True)]
            for image in _pictures(reference, radiance)
        ]
        _row(name, *map(" / ".join, zip(*errors, strict=True)))
    print()
    _row("map", "16 samples, processor ms", "set_map, ms")
    _row("---", "---", "---")
    for path in paths:
        _row(path.stem, *(f"{ms:.0f}" for ms in _cost(context, reference, path)))


def _row(*cells: object) -> None:
    print("|", " | ".join(map(str, cells)), "|", flush=True)


def _made_up() -> Iterator[tuple[str, np.ndarray]]:
    sky = np.full((ROWS, 2 * ROWS, 3), 0.5)
    yield "even", sky.copy()
    sun = sky.copy()
    sun[17, 50] = 5e4
    yield "sun 10^5", sun
    pole = sky.copy()
    pole[0] = 1e3
    yield "sun on the pole", pole
    lamp = 0 * sky
    lamp[20:24, 74:78] = 100
    yield "lamp on black", lamp


def _read(paths: list[Path]) -> Iterator[tuple[str, np.ndarray]]:
    for path in paths:
        radiance = read_latlong(path).radiance
        yield path.stem, latlong.reduce(radiance.double(), ROWS, 2 * ROWS).numpy()


def _truth(radiance: np.ndarray) -> list[np.ndarray]:
    texels = ball_truth.whole(radiance)
    rough = [ball.roughness for ball in ROW if ball.roughness is not None]
    layers = [ball_truth.layer(texels, roughness, SIZE, draws=DRAWS) for roughness in rough]
    return [*layers, ball_truth.base(texels, SIZE)]


def _pictures(reference: ReferencePass, radiance: np.ndarray) -> Iterator[list[np.ndarray]]:
    """Yield the balls at each number of samples."""
    _begin(reference, radiance, SIZE)
    for samples in SAMPLES:
        reference.accumulate(samples - reference.samples)
        image = _read_back(reference)
        yield [image[:, i * SIZE : (i + 1) * SIZE] for i in range(len(ROW))]


def _begin(reference: ReferencePass, radiance: np.ndarray, size: int) -> None:
    reference.set_map(radiance.astype(np.float32))
    cells = [(i * size, 0, size) for i in range(len(ROW))]
    reference.restart(ROW, np.eye(3), cells, (size * len(ROW), size))


def _read_back(reference: ReferencePass) -> np.ndarray:
    target = reference.framebuffer
    data = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
    return data.reshape(target.height, target.width, 4)[..., :3]


def _l1(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(found - truth).sum() / truth.sum())


def _cost(context: moderngl.Context, reference: ReferencePass, path: Path) -> tuple[float, float]:
    radiance = read_latlong(path).radiance.float().numpy()
    _begin(reference, radiance, COST_SIZE)
    reference.accumulate(16)
    context.finish()
    start = time.process_time()
    reference.set_map(radiance)
    mapped = time.process_time()
    for _ in range(4):
        reference.accumulate(16)
    context.finish()
    return (time.process_time() - mapped) / 4 * 1e3, (mapped - start) * 1e3


if __name__ == "__main__":
    torch.set_num_threads(1)
    main()
