# SPDX-License-Identifier: Apache-2.0
"""The comparison picture: what Blender shows of one frame, beside the image that was fitted.

Columns are the original image and the three representations, rows are balls. All of one row is
shown at one exposure; distant lights are divided by Blender's factor. The numbers are those of
`python -m dcc.measure`, which must have run into the same folder.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.judging.pictures.display import view_transform
from asglight.judging.pictures.layout import BACKGROUND, Grid, save, sheet
from asglight.luminance import luminance
from asglight.usd import Representation
from dcc import renderers, scene
from dcc.in_blender import DISTANT_FACTOR, ORIGINAL

COLUMNS = (ORIGINAL, Representation.DOME, Representation.CARDS, Representation.DISTANT)
TITLES = ("original HDRI", "dome", "cards", "distant  (÷ 4)")
LABELS = {"matte": "matte", "r0.5": "rough\nglossy\nr = 0.5", "r0.25": "glossy\nr = 0.25"}

BALL = 208
"""Pixels across a ball of the picture."""

FINER = 2
"""Rendered so many times as large and averaged, because a pixel of a render is a point."""

SAMPLES = 32
LIGHT_GREY = 0.45
"""Display-linear level that the median of the matte ball under the original is brought to."""


def main(argv: Sequence[str] | None = None) -> int:
    """Render and draw; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m dcc.picture", description=__doc__)
    parser.add_argument("--measured", type=Path, required=True, metavar="DIR", help="of measure")
    parser.add_argument("--shot", default="day-1025", metavar="NAME-FRAME", help="(day-1025)")
    parser.add_argument("--view", choices=scene.VIEWS, default="front", help="side (front)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PNG")
    options = parser.parse_args(argv)
    try:
        numbers = measured(options.measured / "dcc.json", options.shot)
        pictures = rendered(options.measured / "renders", options.shot, options.view)
        draw(options.output, options.shot, pictures, numbers)
    except InputError as error:
        print(f"dcc-picture: {error}", file=sys.stderr)
        return 2
    return 0


def measured(path: Path, shot: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the rows of a frame in Blender by representation and ball.

    Raises:
        InputError: It was not measured.
    """
    rows = json.loads(path.read_text())["balls"] if path.is_file() else []
    found = {
        (row["representation"], row["material"]): row
        for row in rows
        if (row["program"], row["up_axis"]) == ("Blender", "Y")
        and f"{row['sequence']}-{row['frame']}" == shot
    }
    if not found:
        raise InputError(
            f"{path}: has nothing of {shot}; expected a measured frame. Run `make test-dcc` first."
        )
    return found


def rendered(folder: Path, shot: str, view: str) -> list[Tensor]:
    """Render the four columns large.  [material, S, S, 3] each, S = 208."""
    jobs, outs = [], []
    for column in COLUMNS:
        name = shot if column == ORIGINAL else f"{shot}-Y-{column}"
        out = (folder / f"{shot}-picture-{column}.npz").resolve()
        stage = (folder / f"{name}.usda").resolve()
        job = {"stage": str(stage), "out": str(out), "kind": "balls", "rows": 256}
        jobs.append(job | {"size": FINER * BALL, "samples": SAMPLES, "seeds": [1], "views": [view]})
        outs.append(out)
    renderers.run("dcc.blender_render", jobs, folder)
    pictures = []
    for column, out in zip(COLUMNS, outs, strict=True):
        values = torch.from_numpy(np.load(out)["balls"][0, 0]).double()
        values = values.unflatten(1, (BALL, FINER)).unflatten(3, (BALL, FINER)).mean((2, 4))
        pictures.append(values / (DISTANT_FACTOR if column == Representation.DISTANT else 1))
    return pictures


def draw(
    path: Path, shot: str, pictures: list[Tensor], numbers: dict[tuple[str, str], dict[str, Any]]
) -> None:
    """Lay the balls out with their errors.

    Args:
        path: PNG to write.
        shot: Sequence and frame, for the title.
        pictures: Of each column.  [material, S, S, 3]
        numbers: Measured rows by representation and ball.
    """
    levels = luminance(pictures[0][0])
    stops = math.log2(LIGHT_GREY / float(levels[levels > 0].median()))
    step, top = BALL + 66, 132
    width, height = 150 + step * len(COLUMNS), top + step * len(scene.MATERIALS) + 18
    note = f"Cycles, exposure {stops:+.1f} stops, sRGB"
    figure = sheet(width, height, f"Blender, {shot.replace('-', ' frame ')}", note)
    grid = Grid(figure, left=130, top=top, cell=(BALL, BALL), step=(step, step))
    alpha = disc(BALL)[..., None]
    ground = np.array([int(BACKGROUND[i : i + 2], 16) for i in (1, 3, 5)])
    for row, material in enumerate(scene.MATERIALS):
        grid.row_label(row, LABELS[material])
        for column, kind in enumerate(COLUMNS):
            # coverage is divided out before the view transform, or the rim would be too bright
            covered = pictures[column][row] / torch.from_numpy(alpha).clamp(min=0.25)
            shown = alpha * view_transform(covered, stops) + (1 - alpha) * ground
            grid.axes(row, column).imshow(shown.astype(np.uint8), interpolation="nearest")
            grid.caption(row, column, caption(numbers[kind, material]), centred=True)
            if row == 0:
                grid.column_title(column, TITLES[column])
    save(figure, path)


def caption(row: dict[str, Any]) -> str:
    """Say how far a ball is from the original and from its lobes."""
    if row["total"] is None:
        return f"{100 * row['reading']:.1f} % from its integral"
    return f"{100 * row['total']:.1f} % from the HDRI\n{100 * row['export']:.1f} % from the lobes"


def disc(size: int) -> np.ndarray:
    """Return what of each pixel the ball covers, at the points that were rendered."""
    inside = (scene.pixel_places(FINER * size) ** 2).sum(-1) < 1
    return inside.reshape(size, FINER, size, FINER).mean((1, 3))


if __name__ == "__main__":
    sys.exit(main())
