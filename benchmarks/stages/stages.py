# SPDX-License-Identifier: Apache-2.0
"""Size and speed of a stage: what docs/reference/stage.md quotes.

    python -m benchmarks.stages.stages [--lobes 15] [--frames 1000] [--repeats 3]

The lobes turn, sharpen and brighten, once smoothly and once with a tenth of noise in every frame,
as fits of filmed light have: then no sample can be left out. Times are CPU seconds of this process,
the least of the repeats, so other programs on the machine hardly count. The dome's images are a
cost of their own, in proportion to the frames.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from pxr import Usd

from asglight.lobes import LobeTracks
from asglight.usd import Representation, StageOptions, lint_stage, read_usd
from asglight.usd.lights import cards
from asglight.usd.spaces import Space
from asglight.usd.write import layer, staging

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "support"))
from usd_tracks import moving

BOTH = StageOptions(representations=(Representation.CARDS, Representation.DISTANT))
"""Both kinds of light, the most that a stage holds of numbers."""

IMAGES = 8
"""Frames of the dome that are written to learn what one costs."""


def main() -> None:
    """Print one row for each kind of track."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lobes", type=int, default=15)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    print(f"{arguments.lobes} lobes, {arguments.frames} frames, usdc")
    print("\n| tracks | bytes | a lobe and frame | author and save | lint | open | `read_usd` |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    for name, jitter in (("smooth", 0.0), ("noisy", 0.1)):
        tracks = moving(range(1001, 1001 + arguments.frames), arguments.lobes, jitter=jitter)
        with tempfile.TemporaryDirectory() as folder:
            print(f"| {name} | {row(tracks, Path(folder) / 'shot.usdc', arguments.repeats)}")
    print()
    with tempfile.TemporaryDirectory() as folder:
        print(dome_row(tracks, Path(folder) / "shot.usdc"))


def row(tracks: LobeTracks, path: Path, repeats: int) -> str:
    """Write, check, open and read one stage."""
    fill = [f"./shot_dome/shot.fill.{frame}.exr" for frame in tracks.frames]
    images = layer.Images(fill=fill)

    def write() -> None:
        kinds = cards.kinds(tracks.lobes)
        staging.export(layer.build(tracks, BOTH, images, path.name, kinds)[0], path)

    seconds = least(write, repeats)
    size = path.stat().st_size
    share = size / (tracks.lobes.count * len(tracks.frames))
    check = least(lambda: lint_stage(path), repeats)
    opened = least(lambda: Usd.Stage.Open(str(path)), 3 * repeats)
    read = least(lambda: read_usd(path), repeats)
    return (
        f"{size:,} | {share:.1f} | {seconds:.2f} s | {check:.2f} s | "
        f"{1000 * opened:.2f} ms | {read:.2f} s |"
    )


def dome_row(tracks: LobeTracks, path: Path) -> str:
    """Write some of the dome's images."""
    few = LobeTracks(tracks.frames[:IMAGES], tracks.fps, tracks.lobes[:IMAGES])
    start = time.process_time()
    images = staging.dome_images(few, path, StageOptions().dome_height, Space()).write()
    seconds = (time.process_time() - start) / len(images)
    size = sum(image.stat().st_size for image in images) / len(images)
    return f"dome: {size / 1000:.0f} kB and {1000 * seconds:.0f} ms an image"


def least(action: Callable[[], object], repeats: int) -> float:
    """Return the least CPU time of an action."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        held = action()
        times.append(time.process_time() - start)
        del held
    return min(times)


if __name__ == "__main__":
    main()
