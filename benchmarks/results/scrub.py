# SPDX-License-Identifier: Apache-2.0
"""The moving picture of README.md: the viewer, scrubbed through a shot.

Example:
    python -m benchmarks.results.scrub ../shared/sequences/day -o scrub.webp

The shot is fitted with `fast`; each frame is a screenshot of the window, all at one exposure.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from asglight.images import open_sequence
from asglight.images.output import written_beside
from benchmarks.given import refused_in_a_line

MILLISECONDS = 80
"""Of a frame: half the speed of the shot, so that one sees what moves."""

SIZE = (1600, 1000)
"""Pixels of the window."""

WIDTH = 1000
"""Pixels of the picture; README.md is shown about as wide."""

EXPOSURE_EV = -3.5
"""In the middle of what the viewer takes by itself over the shot; a step would look like a lamp."""

QUALITY = 86
"""Of WebP: below 80 dark balls show its blocks, with 90 the file grows by half."""

ASGLIGHT = (sys.executable, "-c", "from asglight.cli.main import main; raise SystemExit(main())")


def main(argv: Sequence[str] | None = None) -> int:
    """Fit, take screenshots and write the picture."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.results.scrub", description=__doc__)
    parser.add_argument("sequence", metavar="DIR", help="frames of a shot")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="WEBP")
    options = parser.parse_args(argv)
    with refused_in_a_line(parser):
        frames = open_sequence(options.sequence).frames
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder) / "shot.usda"
        subprocess.run([*ASGLIGHT, "fit", options.sequence, "-o", stage], check=True)
        pictures = [screenshot(stage, frame) for frame in frames]
    write_moving(options.output, pictures)
    return 0


def screenshot(stage: Path, frame: int) -> Image.Image:
    """Return the window at a frame, as wide as the picture."""
    path = stage.with_suffix(f".{frame}.png")
    size = "x".join(map(str, SIZE))
    words = ["view", stage, "--frame", str(frame), "--size", size, "--screenshot", path]
    words.append(f"--exposure-ev={EXPOSURE_EV}")
    subprocess.run([*ASGLIGHT, *words], check=True, stdout=subprocess.DEVNULL)
    with Image.open(path) as picture:
        height = round(WIDTH * picture.height / picture.width)
        return picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)


def write_moving(path: Path, pictures: Sequence[Image.Image]) -> None:
    """Write pictures as one that plays for ever."""
    first, *rest = pictures
    with written_beside(path) as temporary:
        first.save(
            temporary,
            save_all=True,
            append_images=rest,
            duration=MILLISECONDS,
            loop=0,
            quality=QUALITY,
            method=6,
        )


if __name__ == "__main__":
    raise SystemExit(main())
