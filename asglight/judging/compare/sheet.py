# SPDX-License-Identifier: Apache-2.0
"""One picture of all methods: the map of each, the three spheres under it, and its errors."""

from pathlib import Path

from matplotlib.figure import Figure
from torch import Tensor

from asglight.judging.compare.maps import Comparison, Result, row_title
from asglight.judging.compare.spheres import SPHERES
from asglight.judging.pictures.display import ball_exposure_stops, exposure_stops, view_transform
from asglight.judging.pictures.figures import cut_out, show
from asglight.judging.pictures.layout import FAINT, TEXT, Grid, save, sheet

MAP, BALL, GAP = (320, 160), 160, 10
"""Pixels."""

ROW, COLUMN, TOP, LEFT = 248, 908, 136, 28
COLUMNS = 2
NOTE = "sRGB; the map {:+.1f} stops, balls {:+.1f} stops, the same for all"


def draw(path: Path, comparison: Comparison, title: str) -> None:
    """Write the picture.

    Args:
        path: PNG file to write.
        comparison: The methods on one map.
        title: Heading.

    Raises:
        InputError: The file cannot be written.
    """
    stops = exposure_stops(comparison.reference[None])
    ball_stops = ball_exposure_stops(comparison.balls[None])
    count = len(comparison.results) + 1
    rows = -(-count // COLUMNS)
    figure = sheet(
        COLUMNS * COLUMN + LEFT,
        TOP + ROW * rows,
        title,
        NOTE.format(stops, ball_stops),
    )
    pictures = [(comparison.reference, comparison.balls, "Reference", " · ".join(SPHERES))]
    pictures += [
        (result.radiance, result.balls, row_title(result), caption(result))
        for result in comparison.results
    ]
    for index, (radiance, balls, name, numbers) in enumerate(pictures):
        column, row = divmod(index, rows)
        corner = (LEFT + column * COLUMN, TOP + row * ROW)
        _draw_row(figure, corner, radiance, balls, (stops, ball_stops))
        grid = Grid(figure, left=corner[0], top=corner[1], cell=MAP, step=MAP)
        grid.write(corner[0], corner[1] - 18, name, 14, TEXT, "left")
        grid.write(corner[0], corner[1] + MAP[1] + 18, numbers, 12, FAINT, "left")
    save(figure, path)


def caption(result: Result) -> str:
    """Return the errors of a method as one line."""
    count = f"{result.floats}" if result.floats < 10_000 else f"{result.floats / 1000:.0f}k"
    parts = [f"{count} floats"]
    parts += [
        f"{name} {100 * result.errors[name]:.3g} %" for name in ("env", "irr", "r0.5", "r0.25")
    ]
    parts.append(f"PSNR {result.psnr:.1f} dB")
    if result.flip is not None:
        parts.append(f"FLIP {result.flip:.3f}")
    return "   ".join(parts)


def _draw_row(
    figure: Figure,
    corner: tuple[int, int],
    radiance: Tensor,
    balls: Tensor,
    stops: tuple[float, float],
) -> None:
    left, top = corner
    show(
        Grid(figure, left=left, top=top, cell=MAP, step=MAP).axes(0, 0),
        view_transform(radiance, stops[0]),
    )
    grid = Grid(
        figure,
        left=left + MAP[0] + 2 * GAP,
        top=top,
        cell=(BALL, BALL),
        step=(BALL + GAP, BALL),
    )
    for place, ball in enumerate(balls):
        show(grid.axes(0, place), cut_out(ball, stops[1]))
