# SPDX-License-Identifier: Apache-2.0
"""Panels with axes, on the sheets of `layout`."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from asglight.judging.pictures.layout import DARK, DPI, Theme

LETTER_WIDTH, LETTER_HEIGHT = 9.5, 17
"""Pixels of a letter of 12 points, on average: enough to tell where a name would lie."""


class _Box(NamedTuple):
    """A rectangle of a picture, in pixels from its lower left corner."""

    left: float
    bottom: float
    right: float
    top: float

    def overlaps(self, other: "_Box") -> bool:
        across = self.left < other.right and other.left < self.right
        return across and self.bottom < other.top and other.bottom < self.top


def panel_grid(
    figure: Figure,
    rows: int,
    columns: int,
    margins: tuple[int, int, int, int],
    gap: float,
    theme: Theme = DARK,
) -> list[list[Axes]]:
    """Return a grid of empty panels.

    Args:
        figure: Where.
        rows: Down.
        columns: Across.
        margins: Left, right, top, bottom in pixels.
        gap: Between columns, over the width of one.
        theme: Colours.
    """
    width, height = (figure.get_size_inches() * figure.dpi).tolist()
    left, right, top, bottom = margins
    grid = figure.add_gridspec(
        rows,
        columns,
        left=left / width,
        right=1 - right / width,
        top=1 - top / height,
        bottom=bottom / height,
        wspace=gap,
        hspace=0.3,
    )
    found = [
        [figure.add_subplot(grid[row, column]) for column in range(columns)] for row in range(rows)
    ]
    for axes in (axes for row in found for axes in row):
        axes.set_facecolor(theme.background)
        axes.grid(color=theme.line, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.tick_params(colors=theme.text, which="both", length=0, labelsize=11)
        for spine in axes.spines.values():
            spine.set_color(theme.line)
    return found


def plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis with few plain numbers, such as 0.1, 0.2, 0.5, 1."""
    low, high = sorted(axis.get_view_interval())
    for span, digits in ((40, (1, 2, 5)), (400, (1, 3)), (math.inf, (1,))):
        if high / low < span:
            axis.set_major_locator(LogLocator(subs=digits, numticks=20))
            break
    if high / low < 4:  # too short for the digits of a logarithmic scale
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


def label_points(
    axes: Axes,
    points: Sequence[tuple[float, float]],
    names: Sequence[str],
    colour: str,
    taken: Sequence[tuple[float, float]],
) -> None:
    """Write a name beside each point, where it covers neither another name nor a point.

    Places to the right, left, above and below are tried in turn, then further out; where nothing is
    free the first serves. The axes must have their limits and scales.

    Args:
        axes: Where.
        points: In the units of the axes.
        names: One a point.
        colour: Of the names.
        taken: Points that no name may cover, in the units of the axes.
    """
    covered = [_box(x, y, 8, 8) for x, y in axes.transData.transform(list(taken)).tolist()]
    frame = axes.get_window_extent()
    pixels = axes.transData.transform(list(points)).tolist()
    for name, point, (x, y) in zip(names, points, pixels, strict=True):
        wide, high = LETTER_WIDTH * len(name), LETTER_HEIGHT
        offsets = [
            (dx * (wide / 2 + 12), dy * (high / 2 + 8))
            for reach in (1, 2, 3)
            for dx, dy in ((1, 0), (-1, 0), (0, reach), (0, -reach), (1, reach), (1, -reach))
        ]
        places = [(dx, dy, _box(x + dx, y + dy, wide, high)) for dx, dy in offsets]
        free = [
            (dx, dy, box)
            for dx, dy, box in places
            if frame.x0 < box.left
            and box.right < frame.x1
            and frame.y0 < box.bottom
            and box.top < frame.y1
            and not any(box.overlaps(other) for other in covered)
        ]
        dx, dy, box = (free or places)[0]
        covered.append(box)
        axes.annotate(
            name,
            point,
            (dx * 72 / DPI, dy * 72 / DPI),
            textcoords="offset points",
            color=colour,
            fontsize=12,
            ha="center",
            va="center",
            bbox={"facecolor": axes.get_facecolor(), "edgecolor": "none", "pad": 1},
            zorder=2.5,  # above grids and the front, under what is measured
        )


def _box(x: float, y: float, wide: float, high: float) -> _Box:
    return _Box(x - wide / 2, y - high / 2, x + wide / 2, y + high / 2)
