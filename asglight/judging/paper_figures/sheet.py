# SPDX-License-Identifier: Apache-2.0
"""A sheet of fits of one map: its lobes on the map, balls, and a table of errors beside them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure
from torch import Tensor

from asglight.judging.bench.looks import LOOKS, colour_of
from asglight.judging.paper_figures.data import OURS, PAPER, ROUGHNESS, Row, Still, by_label
from asglight.judging.pictures.charts import panel_grid, plain_numbers
from asglight.judging.pictures.display import ball_exposure_stops, exposure_stops, view_transform
from asglight.judging.pictures.figures import cut_out, show
from asglight.judging.pictures.layout import DARK, Grid, Theme, sheet
from asglight.judging.pictures.outlines import draw_lobes
from asglight.lobes import Lobes

METRICS = {
    "env": "the map",
    "flux": "all light",
    "irr": "white ball",
    "r0.5": "rough ball",
    "r0.25": "glossy ball",
}
"""What is tabulated, and of what it is the error."""

MAP_HEAD = "map; outlines: lobes at one deviation"
BALL_HEAD = "balls by roughness; below: their error"

WIDTH = 1460
LABEL, MAP, BALL, CELL = 190, (284, 142), 116, 86
"""Pixels: columns of labels, of maps, of balls, of numbers."""

GAP, TOP, PITCH = 12, 160, 164
CHART_HEIGHT = 400

DECIMALS = ((99.5, 0), (9.95, 1), (0.0995, 2), (0.0005, 3))
"""From which percentage on how many."""


@dataclass(frozen=True)
class Line:
    """A row of the sheet.

    Attributes:
        name: What it is.
        details: What it took, a line each.
        radiance: Its map.  [H, W, 3]
        balls: Balls under it.  [R, S, S, 3]
        lobes: Drawn on the map; None for the reference.
        ball_errors: Under the balls.
        numbers: Texts of the table, by metric.
        spreads: Smaller texts under them.
        bold: Metrics in which it is the best.
    """

    name: str
    details: Sequence[str]
    radiance: Tensor = field(repr=False)
    balls: Tensor = field(repr=False)
    lobes: Lobes | None = None
    ball_errors: Sequence[float] = ()
    numbers: dict[str, str] = field(default_factory=dict)
    spreads: dict[str, str] = field(default_factory=dict)
    bold: Sequence[str] = ()


def percent(value: float) -> str:
    """Return an error in percent, with the decimals that it deserves."""
    shown = 100 * value
    places = next((places for least, places in DECIMALS if shown >= least), None)
    return "0" if places is None else f"{shown:.{places}f}"


def lines_of(
    still: Still,
    rows: Sequence[Sequence[Row]],
    names: Sequence[str],
    compared: Sequence[Sequence[Row]] = (),
) -> list[Line]:
    """Return the lines of a sheet: the reference, then each group of fits by its first.

    Args:
        still: The map and its fits.
        rows: Groups; of an ablation one fit a start.
        names: One a group.
        compared: Groups whose best is bold.
    """
    best = {
        metric: percent(min(mean_error(group, metric) for group in compared))
        for metric in (METRICS if compared else ())
    }
    lines = [Line("reference", [], still.reference, still.balls)]
    for group, name in zip(rows, names, strict=True):
        first = group[0]
        assert first.balls is not None
        numbers = {metric: percent(mean_error(group, metric)) for metric in METRICS}
        lines.append(
            Line(
                name,
                took(first),
                first.radiance,
                first.balls,
                first.fit.lobes,
                first.ball_errors,
                numbers,
                {metric: spread(group, metric) for metric in METRICS} if len(group) > 1 else {},
                [
                    metric
                    for metric in best
                    if group in compared and numbers[metric] == best[metric]
                ],
            )
        )
    return lines


def took(row: Row) -> list[str]:
    """Return what a fit is made of and what it took, a line each."""
    fit = row.fit
    steps = f"{fit.steps:,} steps, " if fit.steps else ""
    lobes = "1 lobe" if fit.lobes.count == 1 else f"{fit.lobes.count} lobes"
    return [f"{lobes}, {fit.floats} floats", f"{steps}{fit.seconds:.1f} s"]


def mean_error(group: Sequence[Row], metric: str) -> float:
    """Return the mean of an error over the starts."""
    return sum(row.errors[metric] for row in group) / len(group)


def spread(group: Sequence[Row], metric: str) -> str:
    """Return the least and the largest of an error over the starts, in percent."""
    values = [row.errors[metric] for row in group]
    return f"{percent(min(values))}–{percent(max(values))}"


def draw_sheet(title: str, lines: Sequence[Line], foot: str, theme: Theme = DARK) -> Figure:
    """Draw a sheet.

    Args:
        title: Heading.
        lines: The reference first.
        foot: What holds for all, under the sheet.
        theme: Colours.
    """
    return _drawn(title, lines, foot, theme, extra=0)


def draw_sweep(title: str, still: Still, lines: Sequence[Line], foot: str, theme: Theme) -> Figure:
    """Draw a sheet with error against the number of lobes under it."""
    figure = _drawn(title, lines, foot, theme, extra=CHART_HEIGHT)
    height = round(figure.get_size_inches()[1] * figure.dpi)
    shown = [metric for metric in METRICS if metric != "flux"]
    margins = (76, 24, height - CHART_HEIGHT + 12, 108)
    (panels,) = panel_grid(figure, 1, len(shown), margins, 0.24, theme)
    for axes, metric in zip(panels, shown, strict=True):
        for method, name in ((OURS, "fast"), (PAPER, "paper's recipe")):
            found = [group[0] for _, group in by_label(still.rows, method)]
            if found:
                look = LOOKS[method]
                axes.plot(
                    [row.fit.lobes.count for row in found],
                    [100 * row.errors[metric] for row in found],
                    color=colour_of(method, theme),
                    linestyle=look.line,
                    marker=look.marker,
                    linewidth=2,
                    markersize=7,
                    label=name,
                )
        axes.set_title(f"{metric}: {METRICS[metric]}", fontsize=13, color=theme.text, pad=8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.margins(0.1)
        axes.set_xlabel("lobes", fontsize=11, color=theme.faint)
        axes.set_xticks([1, 2, 4, 8, 15, 30, 60], labels=["1", "2", "4", "8", "15", "30", "60"])
        axes.minorticks_off()
        plain_numbers(axes.yaxis)
    panels[0].set_ylabel("error, %", fontsize=11, color=theme.faint)
    panels[0].legend(frameon=False, labelcolor=theme.text, fontsize=11, loc="lower left")
    return figure


def _drawn(title: str, lines: Sequence[Line], foot: str, theme: Theme, extra: int) -> Figure:
    stops = exposure_stops(lines[0].radiance[None])
    ball_stops = ball_exposure_stops(lines[0].balls[None])
    body, foot_height = TOP + PITCH * len(lines), 28 + 22 * (foot.count("\n") + 1)
    height = body + extra + foot_height
    note = f"sRGB; map {stops:+.1f} stops, balls {ball_stops:+.1f} stops, the same in all rows"
    figure = sheet(WIDTH, height, title, note, theme)
    page = Grid(figure, left=0, top=0, cell=MAP, step=MAP, theme=theme)
    _heads(page)
    for place, line in enumerate(lines):
        _draw_line(figure, page, line, TOP + PITCH * place, (stops, ball_stops))
    page.write(24, height - foot_height + 10, foot, 11, theme.faint, "left", "top")
    return figure


def _heads(page: Grid) -> None:
    """Write what the columns are."""
    text, faint = page.theme.text, page.theme.faint
    level = TOP - 14
    page.write(LABEL + MAP[0] / 2, level, MAP_HEAD, 12, text, "center", "baseline")
    middle = (_ball_left(0) + _ball_left(len(ROUGHNESS) - 1) + BALL) / 2
    page.write(middle, level - 26, BALL_HEAD, 12, text, "center", "baseline")
    for place, roughness in enumerate(ROUGHNESS):
        middle = _ball_left(place) + BALL / 2
        page.write(middle, level, f"{roughness:g}", 12, text, "center", "baseline")
    right = _number_right(len(METRICS) - 1)
    page.write(right, level - 52, "relative error, %", 12, text, "right", "baseline")
    for place, (metric, meaning) in enumerate(METRICS.items()):
        right = _number_right(place)
        page.write(right, level - 22, metric, 12, text, "right", "baseline")
        page.write(right, level, meaning, 10, faint, "right", "baseline")


def _draw_line(
    figure: Figure, page: Grid, line: Line, top: int, stops: tuple[float, float]
) -> None:
    text, faint = page.theme.text, page.theme.faint
    right = LABEL - 14
    page.write(right, top + 6, line.name, 13, text, "right", "top")
    below = top + 12 + 26 * (line.name.count("\n") + 1)
    page.write(right, below, "\n".join(line.details), 10, faint, "right", "top")
    axes = Grid(figure, left=LABEL, top=top, cell=MAP, step=MAP).axes(0, 0)
    show(axes, view_transform(line.radiance, stops[0]))
    if line.lobes is not None:
        draw_lobes(axes, line.lobes.to("cpu"), numbered=False)
    for place, ball in enumerate(line.balls):
        left = _ball_left(place)
        grid = Grid(figure, left=left, top=top, cell=(BALL, BALL), step=(BALL, BALL))
        show(grid.axes(0, 0), cut_out(ball, stops[1]))
        if line.ball_errors:
            caption = f"{percent(line.ball_errors[place])} %"
            page.write(left + BALL / 2, top + BALL + 4, caption, 11, faint, "center", "top")
    for place, (metric, number) in enumerate(line.numbers.items()):
        right, middle = _number_right(place), top + MAP[1] / 2
        page.write(right, middle, number, 14, text, "right", "bottom")
        figure.texts[-1].set_fontweight("bold" if metric in line.bold else "normal")
        page.write(right, middle + 5, line.spreads.get(metric, ""), 8, faint, "right", "top")


def _ball_left(place: int) -> int:
    return LABEL + MAP[0] + GAP + place * (BALL + GAP)


def _number_right(place: int) -> int:
    return LABEL + MAP[0] + GAP + len(ROUGHNESS) * (BALL + GAP) + (place + 1) * CELL
