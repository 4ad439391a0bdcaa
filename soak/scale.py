# SPDX-License-Identifier: Apache-2.0
"""Long shots, large images, many lobes: the memory that they take.

    python -m soak.scale -o soak-output

Each measurement is made in a forked process of its own, so that it begins from the same memory.
"""

import argparse
import json
import os
import shutil
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO
import torch

from asglight.cli.folders import write_text
from asglight.fitting.options import FitOptions, Preset
from asglight.images import read_latlong, write_exr
from asglight.images.decoding.decoders import APART
from asglight.judging.bench.memory import Peak, peak_memory
from asglight.shots.events import FrameDone
from asglight.shots.job import fit_shot
from asglight.usd import read_usd
from soak.shot import write_shot

HELD = 25
"""Frames that show the same image, as in a shot that was animated on twenty-fives. A tiny fit takes
0.2 s, so that 10,000 of them take half an hour; what is read, kept and written is 10,000 frames."""

IMAGES = 8
"""Different images."""

LONG = (100, 1_000, 10_000)
LARGE = (8192, 16384)
"""Rows and columns."""

MEAN = 2.0
"""Of the large image."""

MANY = 512
MANY_ROWS = 32
"""Rows of the map that many lobes are fitted to."""


@dataclass
class Measured:
    """One measurement.

    Attributes:
        what: Its subject.
        figures: Numbers by name, with their units.
        seconds: It took.
    """

    what: str
    figures: dict[str, Any]
    seconds: float


def long_shot(folder: Path, count: int) -> dict[str, Any]:
    """Fit so many frames, and tell the memory that it took."""
    images = write_shot(folder / "images", range(1, IMAGES + 1))
    source = folder / "in"
    source.mkdir()
    for frame in range(1, count + 1):
        image = 1 + frame // HELD % IMAGES
        os.link(images / f"sky.{image:04d}.exr", source / f"sky.{frame:05d}.exr")
    stage = folder / "shot.usdc"
    options = FitOptions(lobes=1, preset=Preset.LIVE)
    checkpoint = stage.with_name("shot.usdc.checkpoint")
    begin, seen = _kilobytes("self", "VmRSS"), {"fitting": 0, "bytes": 0}

    def watch(event: object) -> None:
        if isinstance(event, FrameDone):
            seen["fitting"] = max(seen["fitting"], _kilobytes("self", "VmRSS") - begin)
            seen["bytes"] = checkpoint.stat().st_size

    with peak_memory() as peak:
        result = fit_shot(source, stage, options, on_progress=watch)
    assert len(result.records) == count
    return {
        "frames": count,
        "of them fitted": sum(record.repeats is None for record in result.records),
        "grown while fitting MB": seen["fitting"] // 1024,
        "grown with the stage MB": _megabytes(peak),
        "checkpoint bytes a frame": seen["bytes"] // count,
        "reader peak MB": _reader_megabytes(),
    }


def large_image(folder: Path) -> dict[str, Any]:
    """Read one image of 16,384 x 8,192 texels, and tell the memory that it took."""
    path = folder / "large.exr"
    _write_large(path, *LARGE)
    with peak_memory() as peak:
        image = read_latlong(path, height=256, decoder=APART)
    assert image.source_shape == LARGE
    assert abs(float(image.radiance.mean()) - MEAN) < 1e-3 * MEAN  # half floats
    return {
        "size": f"{LARGE[1]} x {LARGE[0]}",
        "whole MB": LARGE[0] * LARGE[1] * 12 >> 20,
        "grown MB": _megabytes(peak),
        "reader peak MB": _reader_megabytes(),
    }


def _write_large(path: Path, rows: int, columns: int) -> None:
    """Write an image of mean `MEAN` row by row, as no writer of a whole image could."""
    spec = OpenImageIO.ImageSpec(columns, rows, 3, "half")
    spec.attribute("compression", "zip")
    output = OpenImageIO.ImageOutput.create(str(path))
    if output is None or not output.open(str(path), spec):
        raise OSError(f"{path}: cannot be opened for writing")
    pattern = np.tile(np.linspace(0, 2 * MEAN, 64, dtype=np.float32), columns // 64)
    strip = np.ascontiguousarray(np.broadcast_to(pattern[None, :, None], (256, columns, 3)))
    for top in range(0, rows, 256):
        if not output.write_scanlines(top, top + 256, 0, strip):
            raise OSError(f"{path}: cannot be written: {output.geterror()}")
    if not output.close():
        raise OSError(f"{path}: cannot be closed: {output.geterror()}")


def many_lobes(folder: Path) -> dict[str, Any]:
    """Fit very many lobes, write them and read them back."""
    values = np.random.default_rng(4).lognormal(sigma=1.5, size=(MANY_ROWS, 2 * MANY_ROWS, 3))
    write_exr(folder / "sky.exr", torch.from_numpy(values.astype(np.float32)))
    options = FitOptions(lobes=MANY, preset=Preset.LIVE)
    source, stage = folder / "sky.exr", folder / "shot.usdc"
    with peak_memory() as peak:
        result = fit_shot(source, stage, options)
    lobes = read_usd(stage).lobes
    for part in (lobes.axes, lobes.sharpness, lobes.amplitude):
        assert bool(torch.isfinite(part).all())
    assert lobes.count == result.tracks.lobes.count
    return {
        "lobes": MANY,
        "written": lobes.count,
        "flux error": f"{abs(result.records[0].flux_error):.1e}",
        "grown MB": _megabytes(peak),
    }


def _megabytes(peak: Peak) -> float | None:
    """Return the largest growth of this process; None where nobody tells."""
    return None if peak.grown is None else round(peak.grown / 2**20, 1)


def _reader_megabytes() -> int:
    """Return the largest size of a process that decodes."""
    sizes = [_kilobytes(process._process.pid, "VmHWM") for process in APART._idle]
    return max(sizes) // 1024


def _kilobytes(process: object, name: str) -> int:
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(f"{name}:")).split()[1])


def measured(what: str, folder: Path, measure: Callable[[Path], dict[str, Any]]) -> Measured:
    """Make a measurement in a forked process.

    Raises:
        RuntimeError: It failed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    begin, place = time.monotonic(), folder / "figures.json"
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            place.write_text(json.dumps(measure(folder)))
            status = 0
        except Exception:
            traceback.print_exc()
        finally:
            APART.close()
            os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    figures = json.loads(place.read_text()) if place.exists() else {}
    shutil.rmtree(folder)
    if status != 0:
        raise RuntimeError(f"{what}: ended with {status}")
    return Measured(what, figures, time.monotonic() - begin)


def scale(folder: Path, lengths: tuple[int, ...] = LONG) -> list[Measured]:
    """Make every measurement."""
    folder = folder.resolve()
    rows = [
        measured(f"{count:,} frames", folder, lambda place, count=count: long_shot(place, count))
        for count in lengths
    ]
    rows.append(measured("a 16k image", folder, large_image))
    rows.append(measured(f"{MANY} lobes", folder, many_lobes))
    return rows


def as_table(rows: list[Measured]) -> str:
    """Return the measurements as a table."""
    lines = ["| what | measured | seconds |", "|---|---|---|"]
    for row in rows:
        figures = ", ".join(f"{name} {value}" for name, value in row.figures.items())
        lines.append(f"| {row.what} | {figures} | {row.seconds:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Make every measurement, and print them."""
    parser = argparse.ArgumentParser(description="Measure long shots, large images, many lobes.")
    lengths = ",".join(map(str, LONG))
    parser.add_argument("--lengths", default=lengths, help="frames of the shots")
    parser.add_argument("-o", "--output", type=Path, default=Path("soak-output"))
    arguments = parser.parse_args()
    chosen = tuple(map(int, arguments.lengths.split(",")))
    rows = scale(arguments.output / "scale", chosen)
    write_text(arguments.output / "scale.json", json.dumps([vars(row) for row in rows]))
    print(as_table(rows))


if __name__ == "__main__":
    main()
