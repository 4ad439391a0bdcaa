# SPDX-License-Identifier: Apache-2.0
"""`fast` beside EM on maps that no one looked at: turned maps, frames of shots, lamps in the dark.

    python -m benchmarks.fits.unseen --maps ../shared/hdri --sequences ../shared/sequences

Each map is turned twice about some axis, so that its lamps stand elsewhere on the grid and the
poles lie elsewhere in it; of each sequence every eighth frame is fitted as a still; and rooms are
drawn with one to 40 hard-edged lamps of 2 to 40 degrees. Ratios to EM and targets are those of
`benchmarks/fits/__main__.py`.
"""

import argparse
import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from asglight.fitting.options import LOBES, FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.judging.clock import Point, timed
from asglight.judging.metrics import frame_errors
from asglight.lobes.frames import axes_from_quaternion
from asglight.peers import vmf_em
from asglight.sphere import latlong
from benchmarks.fits.__main__ import find_maps, find_sequences
from benchmarks.fits.measures import compare
from benchmarks.given import read_map, refused_in_a_line

TURNS = 2
"""Of each map."""

EVERY = 8
"""Frames from one still of a sequence to the next."""

SAMPLES = 3
"""Along a side of a texel of a turned map: its mean, not what lies at its centre."""

LAMPS = (1, 2, 3, 5, 8, 12, 20, 40)
"""In a room."""

ROWS = 256
"""Of a room's map."""


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every case, print the ratios to EM and what misses a target."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fits.unseen", description=__doc__)
    parser.add_argument("--maps", type=Path, required=True, metavar="DIR", help="latlong maps")
    parser.add_argument("--sequences", type=Path, metavar="DIR", help="folder of sequences")
    options = parser.parse_args(argv)
    with refused_in_a_line(parser):
        print(table(every(cases(options.maps, options.sequences))))
    return 0


def cases(maps: Path, sequences: Path | None) -> Iterator[tuple[str, Tensor]]:
    """Yield each case, a map [H, 2 H, 3], by name."""
    for index, path in enumerate(find_maps(maps)):
        radiance = read_map(path)
        for turn in range(TURNS):
            axes = random_axes(TURNS * index + turn)
            yield f"{path.stem}, turned {'once' if turn == 0 else 'again'}", turned(radiance, axes)
    for sequence in find_sequences(sequences) if sequences is not None else ():
        for frame in sequence.frames[::EVERY]:
            yield f"{sequence.name} {frame}", sequence.read(frame).radiance
    for count in LAMPS:
        yield f"room with lamps: {count}", room(count)


def random_axes(seed: int) -> Tensor:
    """Return an even choice of all orientations.  [3, 3]."""
    generator = torch.Generator().manual_seed(seed)
    return axes_from_quaternion(torch.randn(4, generator=generator, dtype=torch.float64))


def turned(radiance: Tensor, axes: Tensor) -> Tensor:
    """Return a map as one sees it whose axes are turned.

    Args:
        radiance: [H, 2 H, 3]
        axes: Rows are where +X, +Y and +Z point in the map.  [3, 3]
    """
    height, width, _ = radiance.shape
    own = latlong.directions(SAMPLES * height, SAMPLES * width, dtype=torch.float64)
    u, v = latlong.uv_from_direction(own @ axes)
    around = torch.cat([radiance[:, -1:], radiance, radiance[:, :1]], dim=1)
    places = torch.stack([(2 * u * width + 2) / (width + 2) - 1, 2 * v - 1], dim=-1)
    samples = torch.nn.functional.grid_sample(
        around.movedim(-1, 0)[None].float(),
        places[None].float(),
        padding_mode="border",
        align_corners=False,
    )
    return torch.nn.functional.avg_pool2d(samples, SAMPLES)[0].movedim(0, -1).contiguous()


def room(count: int) -> Tensor:
    """Return a dim map with lamps of even light: squares and strips, some of them tinted.

    Args:
        count: Of lamps, the seed as well.
    """
    generator = np.random.default_rng(count)
    directions = latlong.directions(ROWS, 2 * ROWS, dtype=torch.float64)
    radiance = 0.02 * (1 + 0.5 * directions[..., 1:2]).expand(-1, -1, 3).clone()
    for _ in range(count):
        frame = random_axes(int(generator.integers(1 << 30)))
        half = math.radians(generator.choice([1, 3, 6, 12, 20]))
        length = generator.choice([1, 1, 2, 5]) ** 0.5
        x, y, z = (directions @ frame.mT).unbind(-1)
        inside = (z > 0) & (x.abs() < length * math.tan(half) * z)
        inside &= y.abs() < math.tan(half) * z / length
        power = 0.05 * 10 ** generator.uniform(-0.5, 0.5)
        radiance[inside] += power / half**2 * torch.tensor(generator.uniform(0.6, 1.0, size=3))
    return radiance.float()


def every(given: Iterable[tuple[str, Tensor]]) -> dict[str, dict[str, Point]]:
    """Return what was measured of each case, by name.

    Args:
        given: As of `cases`.
    """
    found: dict[str, dict[str, Point]] = {}
    prepared: set[torch.Size] = set()
    for name, reference in given:
        if reference.shape not in prepared:  # unmeasured: a first fit also prepares its grids
            fit_frame(reference, FitOptions(LOBES, Preset.FAST), None)
            prepared.add(reference.shape)
        found[name] = measured(reference)
    return found


def measured(reference: Tensor) -> dict[str, Point]:
    """Return the errors and seconds of EM and of `fast` for a map.  [H, 2 H, 3]."""
    peer, seconds = timed(vmf_em.fit, reference, LOBES)
    found = {"em": frame_errors(peer, reference).values | seconds}
    fit, seconds = timed(fit_frame, reference, FitOptions(LOBES, Preset.FAST), None)
    found["fast"] = frame_errors(fit.lobes, reference).values | seconds
    return found


def table(found: dict[str, dict[str, Point]]) -> str:
    """Return a row a case, the medians, and what misses a target.

    Args:
        found: What was measured of each case.
    """
    result = compare(found, "fast")
    names = list(result["median"])
    lines = [f"| case | {' | '.join(names)} | s |", "|---|" + "--:|" * (len(names) + 1)]

    def row(name: str, ratios: Point, seconds: float) -> str:
        return f"| {name} | {' | '.join(f'{ratios[key]:.2f}' for key in names)} | {seconds:.1f} |"

    spent = {name: errors["fast"]["wall_seconds"] for name, errors in found.items()}
    lines += [row(name, ratios, spent[name]) for name, ratios in result["ratios"].items()]
    lines.append(row("median", result["median"], statistics.median(spent.values())))
    lines.append(row("worst", result["worst"], max(spent.values())))
    missed = [f"{name}: {', '.join(each)}" for name, each in result["missed"].items() if each]
    return "\n".join([*lines, "", f"misses a target: {'; '.join(missed) or 'none'}"])


if __name__ == "__main__":
    raise SystemExit(main())
