# SPDX-License-Identifier: Apache-2.0
r"""One picture of keys and rest: the map with its keys drawn on it, the rest, and balls.

    make blender-extension
    python -m benchmarks.keyed.sheet MAP.exr --zip dist/asglight-blender-0.2.0.zip -o keys.png

The balls, mirror, silver and matte, are lit by the map, by its lobes, and by keys plus rest as a
stage shows them. With the extension a small set is rendered in Blender under the three as well.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from torch import Tensor

from asglight.fitting.options import FIT_HEIGHT, FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.images import read_latlong
from asglight.judging import keyed
from asglight.judging.compare.spheres import SPHERES, render
from asglight.judging.metrics import maps_errors
from asglight.judging.pictures.display import (
    ball_exposure_stops,
    luminance,
    view_transform,
)
from asglight.judging.pictures.figures import cut_out, show
from asglight.judging.pictures.layout import BACKGROUND, FAINT, TEXT, Grid, save, sheet
from asglight.judging.pictures.outlines import colour, segments
from asglight.keys.rectangles import Card
from asglight.lobes import texels
from benchmarks.given import refused_in_a_line
from dcc.keyed.picture import pictures

MAP, BALL, GAP, LEFT, TOP = (660, 330), 136, 12, 28, 116
"""Pixels."""

RENDERED = (420, 236)
"""Of a picture rendered in Blender, in pixels."""

MIDDLE_GREY = 0.3
"""Display-linear level that the median of what is rendered under the map is brought to."""

NEARLY_WHITE = 0.8
"""Display-linear level that the ninth decile of the rest is brought to."""

SIZE = 204
"""Pixels that balls are computed in."""

POINTS = 60
"""Of a side of a card: on a latlong it is no straight line."""

SHOWN = ("env", "irr", "r0.5", "r0.25")


def main(argv: Sequence[str] | None = None) -> int:
    """Fit, cut, and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.keyed.sheet", description=__doc__)
    parser.add_argument("image", type=Path, metavar="IMAGE", help="latlong map")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="PNG", help="picture")
    texture = "keys carry the pixels of their lamps"
    parser.add_argument("--texture", action="store_true", help=texture)
    package = "the Blender extension: add pictures rendered there"
    parser.add_argument("--zip", type=Path, metavar="ZIP", help=package)
    work = "folder for stages and renders (%(default)s)"
    parser.add_argument("--work", type=Path, default=Path("dcc-output/keys-sheet"), help=work)
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    rendered: list[Tensor] = []
    with refused_in_a_line(parser):
        if options.zip is not None:
            rendered = pictures(
                options.image, options.work, options.zip, RENDERED, textured=options.texture
            )
        draw(options.image, options.output, rendered, textured=options.texture)
    return 0


def draw(source: Path, target: Path, rendered: Sequence[Tensor], *, textured: bool) -> None:
    """Write the picture of a map, with what Blender shows where that was rendered."""
    radiance = read_latlong(source, height=FIT_HEIGHT).radiance
    lobes = fit_frame(radiance, FitOptions(), None).lobes
    cut = keyed.cut(radiance, textured=textured)
    size = radiance.shape[:2]
    maps = torch.stack([radiance, texels.texel_means(lobes, *size), cut.texel_means(*size)])
    errors = maps_errors(maps[1:], radiance)
    stops, balls = _map_stops(cut.rest), render(maps, SIZE)
    ball_stops = ball_exposure_stops(balls[:1])
    width = 2 * MAP[0] + GAP + 2 * LEFT
    note = f"sRGB; maps {stops:+.1f} stops, balls {ball_stops:+.1f} stops"
    top = TOP + MAP[1] + BALL + 136
    height = top + (RENDERED[1] + 34 if rendered else 0)
    figure = sheet(width, height, f"{source.stem}: keys and rest", note)
    grid = Grid(figure, left=LEFT, top=TOP, cell=MAP, step=(MAP[0] + GAP, MAP[1]))
    for column, (image, title) in enumerate(
        ((radiance, f"the map, and its {len(cut.keys)} keys"), (cut.rest, "the rest"))
    ):
        axes = grid.axes(0, column)
        axes.imshow(view_transform(image, stops), extent=(0, 1, 1, 0), aspect="auto")
        grid.column_title(column, title)
        if not column:
            for index, key in enumerate(cut.keys):
                outline(axes, key.card, index)
    titles = ["under the map", f"under {lobes.count} lobes", "under keys and rest"]
    numbers = ["", *(_numbers(one.values) for one in errors)]
    group = (width - 2 * LEFT - 2 * 3 * GAP) / 3
    for place, (own, title, text) in enumerate(zip(balls, titles, numbers, strict=True)):
        left = round(LEFT + place * (group + 3 * GAP))
        row = Grid(
            figure,
            left=left,
            top=TOP + MAP[1] + 64,
            cell=(BALL, BALL),
            step=(BALL + GAP // 2, BALL),
        )
        row.write(left, TOP + MAP[1] + 44, title, 12, TEXT, "left")
        row.write(left, row.top + BALL + 44, text, 11, FAINT, "left")
        for column, (ball, name) in enumerate(zip(own, SPHERES, strict=True)):
            show(row.axes(0, column), cut_out(ball, ball_stops))
            row.write(
                left + column * (BALL + GAP // 2) + BALL / 2,
                row.top + BALL + 16,
                name,
                11,
                FAINT,
                "center",
            )
    if rendered:
        _rendered(figure, rendered, top, round(group + 3 * GAP))
    save(figure, target)


def _map_stops(rest: Tensor) -> float:
    """Return the exposure at which a tenth of the rest is brighter than white nearly is."""
    levels = luminance(rest.double())
    return math.log2(NEARLY_WHITE / float(levels.quantile(0.9)))


def _rendered(figure: Figure, pictures: Sequence[Tensor], top: int, step: int) -> None:
    """Show what Blender rendered, all at the exposure that suits the first."""
    grid = Grid(figure, left=LEFT, top=top, cell=RENDERED, step=(step, RENDERED[1]))
    levels = luminance(pictures[0][..., :3])
    stops = math.log2(MIDDLE_GREY / float(levels[levels > 0].median()))
    ground = np.array([int(BACKGROUND[i : i + 2], 16) for i in (1, 3, 5)])
    for column, picture in enumerate(pictures):
        alpha = picture[..., 3:].clamp(0, 1)
        light = picture[..., :3] / alpha.clamp(min=1e-3)  # 1e-3: no coverage, any colour
        shown = alpha.numpy() * view_transform(light, stops) + (1 - alpha.numpy()) * ground
        grid.axes(0, column).imshow(shown.astype(np.uint8), interpolation="nearest")
    grid.write(LEFT, top + RENDERED[1] + 14, f"in Blender, {stops:+.1f} stops", 11, FAINT, "left")


def _numbers(errors: dict[str, float]) -> str:
    return "  ".join(f"{one} {100 * errors[one]:.2g} %" for one in SHOWN)


def outline(axes: Axes, card: Card, index: int) -> None:
    """Draw a card on a latlong picture."""
    along = np.linspace(-1, 1, POINTS)
    sides = [(along, 1), (1, -along), (-along, -1), (-1, along)]
    points = [np.broadcast_arrays(x, y) for x, y in sides]
    x, y = (torch.from_numpy(np.concatenate([point[k] for point in points])) for k in (0, 1))
    directions = card.rectangle.points(x, y)
    closed = torch.cat([directions, directions[:1]])
    shadow = [withStroke(linewidth=3.4, foreground="#000000", alpha=0.5)]
    for u, v in segments(closed):
        axes.plot(u, v, color=colour(index), linewidth=1.6, path_effects=shadow)
    axes.set_xlim(0, 1)
    axes.set_ylim(1, 0)


if __name__ == "__main__":
    sys.exit(main())
