# SPDX-License-Identifier: Apache-2.0
"""A moving shot in Blender, beside its HDRI: one picture of a start, a middle and an end.

Columns are frames, rows are the images as the World, the ordinary import with the extension, the
same without it. All of a column has one exposure, that of the row of images.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from asglight.errors import InputError
from asglight.judging.pictures.display import view_transform
from asglight.judging.pictures.layout import BACKGROUND, Grid, save, sheet
from asglight.luminance import luminance
from dcc import renderers, shots, stages

ROWS = {
    "original": "the HDRI\nas World",
    "hook": "stage,\nwith the\nextension",
    "plain": "stage,\nwithout the\nextension",
}

WIDTH, HEIGHT = 420, 210
"""Of a picture, in pixels."""

SAMPLES = 48
GLOSSY = 0.25
"""Roughness of the right ball."""

MIDDLE_GREY = 0.3
"""Display-linear level that the median of the first row is brought to."""


def main(argv: Sequence[str] | None = None) -> int:
    """Render and draw; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m dcc.moving.picture", description=__doc__)
    add = parser.add_argument
    add("--sequences", type=Path, default=Path("../shared/sequences"), metavar="DIR")
    add("--shot", default="day", metavar="NAME", help="sequence (%(default)s)")
    add("--zip", type=Path, required=True, metavar="ZIP", help="the extension")
    add("--work", type=Path, default=Path("dcc-output/moving"), metavar="DIR")
    add("-o", "--output", type=Path, required=True, metavar="PNG")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)  # the renderer has the cores
    try:
        (shot,) = shots.from_sequences(options.sequences, 3, _made(options.work), [options.shot])
        draw(options.output, shot, rendered(shot, options))
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2
    return 0


def _made(folder: Path) -> Path:
    folder = folder.resolve()
    (folder / "renders").mkdir(parents=True, exist_ok=True)
    return folder


def rendered(shot: shots.Shot, options: argparse.Namespace) -> dict[str, list[torch.Tensor]]:
    """Render all rows.  By way, a picture a frame, [H, W, 4], its alpha beside it."""
    folder = options.work.resolve() / "renders"
    common = {
        "width": WIDTH,
        "height": HEIGHT,
        "samples": SAMPLES,
        "glossy": GLOSSY,
        "zip": str(options.zip.resolve()),
    }
    jobs, outs = [], {}

    def job(stage: Path, way: str, frames: list[int], name: str) -> None:
        out = str(folder / f"{shot.name}-picture-{name}.npz")
        jobs.append({**common, "stage": str(stage), "way": way, "frames": frames, "out": out})
        outs.setdefault(way, []).append(out)

    for frame, image in zip(shot.frames, shot.images, strict=True):
        stage = stages.original(image, folder / f"{shot.name}-{frame}-image.usda")
        job(stage, "original", [frame], f"original-{frame}")
    for way in ("hook", "plain"):
        job(shot.stages["Y"], way, list(shot.frames), way)
    renderers.run("dcc.moving.picture_render", jobs, options.work.resolve())
    return {
        way: [
            torch.from_numpy(picture).double()
            for path in paths
            for picture in np.load(path)["pictures"]
        ]
        for way, paths in outs.items()
    }


def draw(path: Path, shot: shots.Shot, pictures: dict[str, list[torch.Tensor]]) -> None:
    """Lay the pictures out.

    Args:
        path: PNG to write.
        shot: What was rendered.
        pictures: By row, one a frame.  [H, W, 4]
    """
    gap, top, left = 14, 118, 130
    width = left + len(shot.frames) * (WIDTH + gap) + 12
    height = top + len(ROWS) * (HEIGHT + gap) + 6
    title = f"Blender, the sequence {shot.name}: File > Import > USD"
    figure = sheet(width, height, title, "Cycles, one exposure a column")
    grid = Grid(figure, left=left, top=top, cell=(WIDTH, HEIGHT), step=(WIDTH + gap, HEIGHT + gap))
    ground = np.array([int(BACKGROUND[i : i + 2], 16) for i in (1, 3, 5)])
    for row, (way, label) in enumerate(ROWS.items()):
        grid.row_label(row, label)
        for column, frame in enumerate(shot.frames):
            levels = luminance(pictures["original"][column][..., :3])
            stops = math.log2(MIDDLE_GREY / float(levels[levels > 0].median()))
            picture = pictures[way][column]
            alpha = picture[..., 3:].clamp(0, 1)
            light = picture[..., :3] / alpha.clamp(min=1e-3)
            shown = alpha.numpy() * view_transform(light, stops) + (1 - alpha.numpy()) * ground
            grid.axes(row, column).imshow(shown.astype(np.uint8), interpolation="nearest")
            if row == 0:
                grid.column_title(column, f"frame {frame}  ({stops:+.1f} stops)")
    save(figure, path)


if __name__ == "__main__":
    sys.exit(main())
