# SPDX-License-Identifier: Apache-2.0
"""What images of production size cost: beside OpenEXR's own decoder, and in a fit.

    python -m benchmarks.inputs.production --map ../shared/hdri/lobby.exr

Prints three tables as Markdown. Files are written into a folder that is deleted at the end; images
of 16k take 4 GB of memory while they are made.

1. Processor time of one image from the file to the fit's 256 rows, repaired and reduced, in the
   process that decodes and in the one that asks together; and of the package OpenEXR, which only
   decodes the same channels, on one thread; the least of several, taken in turn. And the largest
   size of either process.
2. `live` and `fast` on a sequence of 4k and on the same frames at 256 rows: seconds of wall and
   processor time of the whole fit, without imports, and frames a second after the first.
3. Processor time of the viewer's 1024 rows, on the quick way and by OpenImageIO.
"""

import argparse
import contextlib
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import OpenImageIO
import torch
from numpy.typing import NDArray

from asglight.fitting.options import FIT_HEIGHT, FitOptions, Preset
from asglight.images import read_latlong, write_exr
from asglight.images.decoding.decoders import APART, HERE, Decoder
from asglight.shots import fit_shot
from asglight.sphere import latlong
from benchmarks.given import refused_in_a_line

GRAIN = 0.01
"""Of a texel, at random: without it an enlarged map would compress as no photograph does."""

REFERENCE = """\
import sys, time, OpenEXR
best = 1e9
for _ in range(int(sys.argv[2])):
    begin = time.process_time()
    OpenEXR.File(sys.argv[1], separate_channels=True, num_threads=0).channels()
    best = min(best, time.process_time() - begin)
peak = next(l for l in open("/proc/self/status") if l.startswith("VmHWM")).split()[1]
print(best, int(peak) / 1024)
"""


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        rows: Of the image.
        compression: OpenEXR's name.
        layout: `lines`, `tiles`, or `parts`: a beauty part before three others.
    """

    rows: int
    compression: str
    layout: str = "lines"

    @property
    def name(self) -> str:
        """Return a short name."""
        return f"{self.rows // 512}k {self.compression} {self.layout}"


KINDS = (
    *(Kind(2048, name) for name in ("NO", "ZIP", "PIZ", "DWAA")),
    *(Kind(2048, name, "tiles") for name in ("ZIP", "PIZ", "DWAA")),
    *(Kind(2048, name, "parts") for name in ("ZIP", "PIZ")),
    *(Kind(4096, name) for name in ("NO", "ZIP", "PIZ", "DWAA")),
    *(Kind(8192, name) for name in ("NO", "ZIP", "PIZ", "DWAA")),
)


@dataclass(frozen=True)
class Cost:
    """Processor seconds of an image, and the largest size in MB of the process that decodes."""

    seconds: float
    megabytes: float


def enlarged(path: Path, rows: int) -> NDArray[np.float16]:
    """Return a map with more rows and grain.  [rows, 2 rows, 3]."""
    source = OpenImageIO.ImageBuf(read_latlong(path).radiance.contiguous().numpy())
    high = min(rows, 2048)
    area = OpenImageIO.ROI(0, 2 * high, 0, high)
    resized = OpenImageIO.ImageBufAlgo.resize(source, filtername="cubic", roi=area)
    values: Any = resized.get_pixels(OpenImageIO.FLOAT)
    values *= 1 + GRAIN * np.random.default_rng(1).standard_normal(values.shape, np.float32)
    halves = np.clip(values, 0, 65000).astype(np.float16)
    # beyond 4k the map is repeated: what costs time is in every part of it
    return np.tile(halves, (rows // high, rows // high, 1))


def write(path: Path, values: NDArray[np.float16], kind: Kind) -> Path:
    """Write an image; return the file that holds its beauty alone."""
    header: dict[str, Any] = {
        "type": OpenEXR.scanlineimage,
        "compression": getattr(OpenEXR, f"{kind.compression}_COMPRESSION"),
    }
    if kind.layout == "tiles":
        tiles = OpenEXR.TileDescription()
        tiles.xSize = tiles.ySize = 64
        header |= {"type": OpenEXR.tiledimage, "tiles": tiles}
    if kind.layout != "parts":
        OpenEXR.File(header, {"RGB": values}).write(str(path))
        return path
    names = ("rgba", "diffuse", "specular", "N")
    parts = [OpenEXR.Part(dict(header), {"RGB": values}, name) for name in names]
    OpenEXR.File(parts).write(str(path))
    alone = path.with_name(f"beauty.{path.name}")
    OpenEXR.File(header, {"RGB": values}).write(str(alone))
    return alone


def ours(path: Path, repeats: int, height: int = FIT_HEIGHT, decoder: Decoder = APART) -> Cost:
    """Measure one image as a fit reads it."""
    APART.close()
    read_latlong(path, height=height, decoder=decoder)
    best = float("inf")
    for _ in range(repeats):
        before = _spent()
        read_latlong(path, height=height, decoder=decoder)
        best = min(best, _spent() - before)
    return Cost(best, _peak(_decoder() or os.getpid()))


def reference(path: Path, repeats: int) -> Cost:
    """Measure OpenEXR's own decoding, in a process that does nothing else."""
    words = [sys.executable, "-c", REFERENCE, str(path), str(repeats)]
    found = subprocess.run(words, check=True, capture_output=True, text=True).stdout.split()
    return Cost(float(found[0]), float(found[1]))


def least(costs: Sequence[Cost]) -> Cost:
    """Return the least seconds, and the largest size."""
    return Cost(min(one.seconds for one in costs), max(one.megabytes for one in costs))


def images(folder: Path, path: Path, kinds: Sequence[Kind], repeats: int) -> Iterator[str]:
    """Measure each kind of file; yield the rows of a table."""
    yield "| file | OpenEXR, ms | asglight, ms | ratio | OpenEXR, MB | asglight, MB |"
    yield "|---|---:|---:|---:|---:|---:|"
    values = np.empty((0, 0, 3), np.float16)
    for kind in kinds:
        if len(values) != kind.rows:
            values = enlarged(path, kind.rows)
        place = folder / "image.exr"
        alone = write(place, values, kind)
        rounds = [(reference(alone, repeats), ours(place, repeats)) for _ in range(2)]
        other, own = (least([pair[k] for pair in rounds]) for k in (0, 1))
        yield (
            f"| {kind.name} | {1e3 * other.seconds:.0f} | {1e3 * own.seconds:.0f} | "
            f"{own.seconds / other.seconds:.2f} | {other.megabytes:.0f} | {own.megabytes:.0f} |"
        )


def fits(folder: Path, path: Path, count: int, compressions: Sequence[str]) -> Iterator[str]:
    """Fit a large sequence and the same frames small; yield the rows of a table."""
    yield "| frames | preset | wall, s | processor, s | frames a second after the first |"
    yield "|---|---|---:|---:|---:|"
    values = enlarged(path, 2048)
    shots = {name: folder / name for name in (*compressions, "256 rows")}
    for place in shots.values():
        place.mkdir()
    for frame in range(1001, 1001 + count):
        turned = np.ascontiguousarray(np.roll(values, 8 * (frame - 1001), axis=1))
        for name in compressions:
            write(shots[name] / f"sky.{frame}.exr", turned, Kind(2048, name))
        small = latlong.reduce(torch.from_numpy(turned.astype(np.float32)), FIT_HEIGHT, 512)
        write_exr(shots["256 rows"] / f"sky.{frame}.exr", small)
    small = shots.pop("256 rows")
    for preset in (Preset.LIVE, Preset.FAST):
        fit(small, folder / "warm.usda", preset)  # prepares grids, loads what writes stages
        for name, place in {"256 rows": small, **shots}.items():
            wall, spent, rate = fit(place, folder / "shot.usda", preset)
            title = name if place is small else f"4k {name}"
            yield f"| {count} x {title} | {preset} | {wall:.1f} | {spent:.1f} | {rate:.1f} |"


def fit(source: Path, output: Path, preset: Preset) -> tuple[float, float, float]:
    """Return wall and processor seconds of a fit, and frames a second after the first one."""
    APART.close()
    begin, before = time.perf_counter(), _cpu()
    result = fit_shot(source, output, FitOptions(preset=preset))
    wall = time.perf_counter() - begin
    APART.close()
    after = sum(record.seconds for record in result.records[1:])
    return wall, _cpu() - before, (len(result.records) - 1) / after


def viewer(folder: Path, path: Path, repeats: int) -> Iterator[str]:
    """Read images for the viewer, which shows 1024 rows; yield the rows of a table."""
    yield "| file, to 1024 rows | OpenImageIO, ms | asglight, ms |"
    yield "|---|---:|---:|"
    values = enlarged(path, 2048)
    for name in ("ZIP", "PIZ"):
        place = folder / "image.exr"
        write(place, values, Kind(2048, name))
        slow, quick = (ours(place, repeats, 1024, decoder) for decoder in (HERE, APART))
        yield f"| 4k {name} | {1e3 * slow.seconds:.0f} | {1e3 * quick.seconds:.0f} |"


def _decoder() -> int | None:
    """Return the process that waits for images, if one does."""
    return APART._idle[0]._process.pid if APART._idle else None


def _spent() -> float:
    """Return the processor seconds of this process and of the one that decodes."""
    decoder = _decoder()
    other = 0.0
    if decoder is not None:
        other = int(Path(f"/proc/{decoder}/schedstat").read_text().split()[0]) / 1e9
    return time.process_time() + other


def _cpu() -> float:
    """Return the processor seconds of this process and of those that have ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def _peak(process: int) -> float:
    """Return the largest size of a process, in MB."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.inputs.production", description=__doc__
    )
    add = parser.add_argument
    add("--map", required=True, type=Path, metavar="FILE", help="a map that is enlarged")
    add("--rows", type=int, default=8192, metavar="N", help="largest image (default: %(default)s)")
    add("--frames", type=int, default=16, metavar="N", help="of a shot (default: %(default)s)")
    add("--repeats", type=int, default=3, metavar="N", help="of each (default: %(default)s)")
    options = parser.parse_args(argv)
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    kinds = [kind for kind in KINDS if kind.rows <= options.rows]
    parts: tuple[Callable[[Path], Iterator[str]], ...] = (
        lambda folder: images(folder, options.map, kinds, options.repeats),
        lambda folder: fits(folder, options.map, options.frames, ("ZIP", "PIZ")),
        lambda folder: viewer(folder, options.map, options.repeats),
    )
    for part in parts:
        with tempfile.TemporaryDirectory(prefix="asglight-") as folder, refused_in_a_line(parser):
            for line in part(Path(folder)):
                print(line, flush=True)
        print()
    with contextlib.suppress(ProcessLookupError):
        APART.close()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
