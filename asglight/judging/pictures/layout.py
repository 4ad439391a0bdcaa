# SPDX-License-Identifier: Apache-2.0
"""Sheets of pictures laid out by the pixel: neutral ground, titles, captions, saving."""

from dataclasses import dataclass
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from asglight.images.output import written_beside

DPI = 100
BACKGROUND, TEXT, FAINT, LINE = "#1d1e20", "#e4e4e2", "#9a9b9d", "#3a3b3e"


@dataclass(frozen=True)
class Theme:
    """Colours of a sheet.

    Attributes:
        background: The ground.
        text: Words.
        faint: Words of less weight.
        line: Frames and grids.
    """

    background: str = BACKGROUND
    text: str = TEXT
    faint: str = FAINT
    line: str = LINE


DARK = Theme()
LIGHT = Theme("#f7f7f5", "#1d1e20", "#5f6062", "#cfcfcc")


def sheet(width: int, height: int, title: str, note: str, theme: Theme = DARK) -> Figure:
    """Return an empty sheet with a heading, drawn by Agg and unknown to pyplot.

    Args:
        width: Pixels.
        height: Pixels.
        title: Heading, left.
        note: What holds for the whole sheet, right.
        theme: Colours.
    """
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=theme.background)
    FigureCanvasAgg(figure)
    baseline = 1 - 44 / height
    figure.text(24 / width, baseline, title, fontsize=18, color=theme.text, va="baseline")
    figure.text(
        1 - 24 / width, baseline, note, fontsize=12, color=theme.faint, va="baseline", ha="right"
    )
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a PNG beside its place and rename it there, so that no half picture is ever seen.

    Raises:
        InputError: The folder is missing or cannot be written.
    """
    with written_beside(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI)


class Grid:
    """Places pictures and texts by pixels from the top left corner of a figure."""

    def __init__(
        self,
        figure: Figure,
        *,
        left: int,
        top: int,
        cell: tuple[int, int],
        step: tuple[int, int],
        theme: Theme = DARK,
    ) -> None:
        """Take the figure, the corner of the first cell, the size of cells and their distance."""
        self.figure, self.left, self.top, self.cell, self.step = figure, left, top, cell, step
        self.theme = theme
        self.width, self.height = (figure.get_size_inches() * DPI).tolist()

    def axes(self, row: int, column: int) -> Axes:
        """Return empty axes that fill a cell."""
        x, y = self.corner(row, column)
        w, h = self.cell
        box = (x / self.width, 1 - (y + h) / self.height, w / self.width, h / self.height)
        axes = self.figure.add_axes(box)
        axes.set_axis_off()
        return axes

    def row_label(self, row: int, text: str) -> None:
        """Write beside the first cell of a row, half way up."""
        _, y = self.corner(row, 0)
        self.write(self.left - 14, y + self.cell[1] / 2, text, 13, self.theme.text, "right")

    def caption(self, row: int, column: int, text: str, *, centred: bool = False) -> None:
        """Write under a cell."""
        x, y = self.corner(row, column)
        x += self.cell[0] / 2 if centred else 0
        side = "center" if centred else "left"
        self.write(x, y + self.cell[1] + 8, text, 12, self.theme.faint, side, "top")

    def column_title(self, column: int, text: str) -> None:
        """Write above the first cell of a column."""
        x, y = self.corner(0, column)
        self.write(x + self.cell[0] / 2, y - 10, text, 13, self.theme.text, "center", "bottom")

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """Return the pixels of a cell's top left corner."""
        return self.left + column * self.step[0], self.top + row * self.step[1]

    def write(
        self,
        x: float,
        y: float,
        text: str,
        size: int,
        colour: str,
        side: str,
        level: str = "center",
    ) -> None:
        """Write at a pixel, the text's `side` and `level` there."""
        self.figure.text(
            x / self.width,
            1 - y / self.height,
            text,
            fontsize=size,
            color=colour,
            ha=side,
            va=level,
            linespacing=1.5,
        )
