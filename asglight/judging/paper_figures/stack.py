# SPDX-License-Identifier: Apache-2.0
"""The picture of a row of the map stacked over time, one column a way of fitting it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from torch import Tensor

from asglight.judging.paper_figures.over_time import INDEPENDENT, OURS, WITH, WITHOUT, Stacked
from asglight.judging.paper_figures.sheet import percent
from asglight.judging.pictures.display import view_transform
from asglight.judging.pictures.figures import DIFFERENCE_COLOURS
from asglight.judging.pictures.layout import DARK, Grid, Theme, sheet
from asglight.luminance import luminance

PANEL_WIDTH, GAP, LEFT, TOP = 250, 20, 96, 168
"""Pixels."""

STACK_HEIGHT, BETWEEN, FOOT = 300, 44, 140

CHANGE_RANGE = 0.2
"""Of the mean luminance of the row: a change beyond it is plainly seen."""

CHANGE = """on a glossy ball (0.25):
change from each frame
to the next,
fit less reference"""

LEGEND = """dark: it changes as the map
bright: it flickers, or misses
a light that moves or flickers"""

TITLES = {
    WITH: "paper's recipe\nwith L_T",
    WITHOUT: "paper's recipe\nwithout L_T",
    INDEPENDENT: "paper's recipe\neach frame by itself",
    OURS: "ours: fast",
}


def draw_stack(title: str, found: Stacked, foot: str, theme: Theme = DARK) -> Figure:
    """Draw the row of every frame, one under the other, and how its change is wrong.

    Args:
        title: Heading.
        found: The row, and the ways.
        foot: What holds for all, under the picture.
        theme: Colours.
    """
    columns = 1 + len(found.ways)
    width = LEFT + columns * (PANEL_WIDTH + GAP) + 90
    height = TOP + 2 * STACK_HEIGHT + BETWEEN + FOOT + 22 * foot.count("\n")
    note = f"sRGB, {found.stops:+.1f} stops, the same everywhere"
    figure = sheet(width, height, title, note, theme)
    cell, step = (PANEL_WIDTH, STACK_HEIGHT), (PANEL_WIDTH + GAP, STACK_HEIGHT + BETWEEN)
    grid = Grid(figure, left=LEFT, top=TOP, cell=cell, step=step, theme=theme)
    rows = [found.row, *(way.row for way in found.ways)]
    names = ["reference", *(TITLES[way.name] for way in found.ways)]
    for column, (row, name) in enumerate(zip(rows, names, strict=True)):
        axes = _panel(grid, 0, column, found)
        axes.imshow(view_transform(row, found.stops), **_extent(len(row)))
        grid.column_title(column, name)
    image: AxesImage | None = None
    for column, way in enumerate(found.ways, start=1):
        axes = _panel(grid, 1, column, found)
        limits = {"vmin": -CHANGE_RANGE, "vmax": CHANGE_RANGE, "cmap": DIFFERENCE_COLOURS}
        changes = wrong_change(way.glossy, found.glossy)
        image = axes.imshow(changes, **_extent(len(changes), 0.5), **limits)
        errors = {name: percent(error) for name, error in way.mean.items()}
        numbers = (
            f"flicker {errors['flicker']} %, {way.jumps} jumps\n"
            f"irr {errors['irr']} %, r0.25 {errors['r0.25']} %\n"
            f"{way.seconds:.2f} s a frame"
        )
        grid.caption(1, column, numbers, centred=True)
        figure.texts[-1].set_position((figure.texts[-1].get_position()[0], _caption_level(height)))
    assert image is not None
    _bar(figure, grid, image, columns)
    x, y = grid.corner(1, 0)
    grid.write(x, y + 24, CHANGE, 13, theme.text, "left", "top")
    grid.write(x, y + 146, LEGEND, 11, theme.faint, "left", "top")
    grid.write(24, height - 22 - 22 * foot.count("\n"), foot, 11, theme.faint, "left", "top")
    return figure


def wrong_change(glossy: Tensor, reference: Tensor) -> np.ndarray:
    """Return how much more the fit brightens than the map, over the mean luminance.

    Args:
        glossy: What a glossy ball shows of each frame's fit.  [F, D, 3]
        reference: The same of the frames.  [F, D, 3]

    Returns:
        For each frame after the first.  [F - 1, D]
    """
    level = luminance(reference)
    mean = float(level.mean())
    difference = (luminance(glossy) - level).diff(dim=0)
    return (difference / (mean if mean > 0 else 1.0)).numpy()


def _extent(count: int, first: float = 0.0) -> dict:
    """Return where a stack lies: longitude as the map has it, left +180, frames down.

    Args:
        count: Rows of the stack.
        first: Place of the middle of the first; a change lies between two frames.
    """
    top = first - 0.5
    return {"extent": (180, -180, top + count, top), "aspect": "auto", "interpolation": "nearest"}


def _panel(grid: Grid, row: int, column: int, found: Stacked) -> Axes:
    """Return axes with longitudes below and, at the first of a row, frames beside."""
    axes, theme = grid.axes(row, column), grid.theme
    axes.set_axis_on()
    axes.tick_params(colors=theme.faint, length=3, labelsize=10)
    for spine in axes.spines.values():
        spine.set_color(theme.line)
    axes.set_xticks([90, 0, -90], labels=["90°", "0°", "-90°"])
    shown = np.unique(np.linspace(0, len(found.frames) - 1, 4).round().astype(int))
    axes.set_yticks(shown, labels=[str(found.frames[k]) for k in shown] if column == 0 else [])
    if row == 0 and column == 0:
        axes.set_xlabel("longitude", color=theme.faint, fontsize=11)
        axes.set_ylabel("frame", color=theme.faint, fontsize=11)
    return axes


def _caption_level(height: int) -> float:
    return 1 - (TOP + 2 * STACK_HEIGHT + BETWEEN + 30) / height


def _bar(figure: Figure, grid: Grid, image: AxesImage, columns: int) -> None:
    """Draw the scale of the changes beside the last panel."""
    x, y = grid.corner(1, columns)
    box = (
        x / grid.width,
        1 - (y + STACK_HEIGHT) / grid.height,
        12 / grid.width,
        STACK_HEIGHT / grid.height,
    )
    bar = figure.colorbar(image, cax=figure.add_axes(box), extend="both")
    bar.outline.set_visible(False)
    most = round(100 * CHANGE_RANGE)
    bar.set_ticks([-CHANGE_RANGE, 0, CHANGE_RANGE])
    bar.ax.set_yticklabels([f"darkens\n-{most} %", "0", f"brightens\n+{most} %"])
    bar.ax.tick_params(color=grid.theme.faint, labelcolor=grid.theme.text, labelsize=10, length=0)
