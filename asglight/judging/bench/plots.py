# SPDX-License-Identifier: Apache-2.0
"""Pictures of what the bench measured, dark as a PNG and in a page's own colours as an SVG.

All axes but that of frame numbers are logarithmic. Looks are those of `bench_looks`.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from asglight.judging.bench.looks import LOOKS, NAMES, PEER, colour_of
from asglight.judging.compare.methods import METHODS
from asglight.judging.pictures.charts import label_points, panel_grid, plain_numbers
from asglight.judging.pictures.layout import DARK, DPI, Theme, sheet

METRIC_TITLES = {
    "irr": "irr: a white ball",
    "r0.5": "r0.5: a rough ball",
    "r0.25": "r0.25: a glossy ball",
    "env": "env: the map itself",
}

WIDTH = 1500
MARGINS = (90, 40, 150, 96)
"""Pixels: left, right, top, bottom."""


Draw = Callable[[dict[str, Any], Theme], Figure]
"""From the record of an input and colours to a picture."""


def pictures(record: dict[str, Any]) -> dict[str, Draw]:
    """Return what there is to draw of an input, by name.

    Args:
        record: As in bench.json.
    """
    found: dict[str, Draw] = {"time": draw_time, "lobes": draw_lobes, "scaling": draw_scaling}
    if "sequence" in record:
        found = {"time": draw_time, "following": draw_following} | found
    return found


def draw_time(record: dict[str, Any], theme: Theme = DARK) -> Figure:
    """Draw error against processor time at one number of floats: ways as lines, peers as points."""
    floats = record["floats"]
    figure = sheet(
        WIDTH,
        1120,
        f"{record['name']}: error against time, {floats} floats ({record['lobes']} lobes)",
        "left and down is better; dotted: nothing is both sooner and nearer",
        theme,
    )
    fits = [fit for fit in record["fits"] if fit["lobes"] == record["lobes"]]
    for axes, (key, title) in zip(_four(figure, theme), METRIC_TITLES.items(), strict=True):
        _title(axes, title, theme)
        _front(axes, fits, key, theme)
        for fit in fits:
            points = [(point["cpu_seconds"], point[key]) for point in fit["points"]]
            _line(axes, fit["method"], points, theme, small_on_the_way=fit["method"] != "paper")
        _finish(axes, "processor seconds of a first frame", "relative error", theme)
        peers = [fit for fit in fits if fit["method"] not in LOOKS]
        ends = [(fit["points"][-1]["cpu_seconds"], fit["points"][-1][key]) for fit in peers]
        names = [fit["method"] for fit in peers]
        label_points(axes, ends, names, colour_of("peer", theme), _every_point(fits, key))
    published = METHODS["paper"].steps
    steps = max(
        (fit["points"][-1]["steps"] for fit in fits if fit["method"] == "paper"), default=published
    )
    note = f"paper: whole runs of up to {steps:,} of its {published:,} steps" * (steps < published)
    _legend(figure, [fit["method"] for fit in fits if fit["method"] in LOOKS], theme)
    _foot(figure, note, theme)
    return figure


def draw_lobes(record: dict[str, Any], theme: Theme = DARK) -> Figure:
    """Draw error against the number of lobes."""
    figure = sheet(
        WIDTH,
        1120,
        f"{record['name']}: error against the number of lobes",
        "em has as many floats: 4 round lobes for each 3 of ours",
        theme,
    )
    swept = [name for name in ("fast", "best", "em", "paper") if _of(record, name)]
    for axes, (key, title) in zip(_four(figure, theme), METRIC_TITLES.items(), strict=True):
        _title(axes, title, theme)
        for name in swept:
            points = [(fit["lobes"], point[key]) for fit, point in at_like_steps(record, name)]
            _line(axes, name, points, theme)
        _finish(axes, "lobes (8 floats each)", "relative error", theme)
    _legend(figure, swept, theme)
    steps = {point["steps"] for _, point in at_like_steps(record, "paper")}
    _foot(figure, "; ".join(f"paper: {count:,} steps" for count in steps), theme)
    return figure


def draw_scaling(record: dict[str, Any], theme: Theme = DARK) -> Figure:
    """Draw how time and memory grow, with the fitted power laws."""
    figure = sheet(
        WIDTH,
        1120,
        f"{record['name']}: how time and memory grow",
        "lines: power laws by least squares in logarithms, exponent ± standard error",
        theme,
    )
    texels, lobes, frames, memory = _four(figure, theme)
    for axes, (key, title) in zip(
        (texels, lobes, frames),
        {
            "texels": "time by texels of the map",
            "lobes": "time by lobes",
            "frames": "time by frames that follow",
        }.items(),
        strict=True,
    ):
        _title(axes, title, theme)
        account = record["scaling"][key]
        for name, found in account["methods"].items():
            _grown(axes, name, found, account["unit"], theme)
        _finish(axes, account["unit"], "processor seconds", theme)
        _panel_legend(axes, theme)
    _title(memory, "peak memory by texels of the map", theme)
    for name, found in record["scaling"]["texels"]["methods"].items():
        known = [
            (size, peak / 1e6)
            for size, peak in zip(found["sizes"], found["peak_bytes"], strict=True)
            if peak
        ]
        if known:
            _line(memory, _method(name), known, theme, label=name)
    _finish(memory, "texels", "MB above the start of the fit", theme)
    _panel_legend(memory, theme)
    return figure


def draw_following(record: dict[str, Any], theme: Theme = DARK) -> Figure:
    """Draw errors and seconds by frame, and flicker and error against the time of a frame."""
    account = record["sequence"]
    count = len(record["frames"])
    figure = sheet(
        WIDTH,
        1120,
        f"{record['name']}: following {count} frames, {record['lobes']} lobes",
        "left and down is better in the lower row",
        theme,
    )
    error, seconds, flicker, mean = _four(figure, theme)
    _title(error, "r0.25: a glossy ball, by frame", theme)
    _title(seconds, "processor seconds of each frame", theme)
    _title(flicker, "flicker against the time of a next frame", theme)
    _title(mean, "mean r0.25 against the time of a next frame", theme)
    for name, found in account["methods"].items():
        frames = record["frames"]
        _line(error, name, list(zip(frames, found["errors"]["r0.25"], strict=True)), theme)
        _line(seconds, name, list(zip(frames, found["cpu_seconds"], strict=True)), theme)
        time = found["next_cpu_seconds"]
        _line(flicker, name, [(time, found["mean"]["flicker"])], theme)
        _line(mean, name, [(time, found["mean"]["r0.25"])], theme)
    _finish(error, "frame", "relative error", theme, linear_x=True)
    _finish(seconds, "frame", "processor seconds", theme, linear_x=True)
    _finish(flicker, "processor seconds of a next frame", "flicker", theme)
    _finish(mean, "processor seconds of a next frame", "relative error", theme)
    _legend(figure, list(account["methods"]), theme)
    first, following = account["paper_steps"]
    _foot(
        figure,
        f"paper: {first:,} steps of its recipe for the first frame, then {following:,}",
        theme,
    )
    return figure


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that no other one beats in both numbers, by the first."""
    found: list[tuple[float, float]] = []
    for point in sorted(points):
        if not found or point[1] < found[-1][1]:
            found.append(point)
    return found


def _four(figure: Figure, theme: Theme) -> list[Axes]:
    grid = panel_grid(figure, 2, 2, MARGINS, 0.16, theme)
    return [axes for row in grid for axes in row]


def _of(record: dict[str, Any], method: str) -> list[dict[str, Any]]:
    return [fit for fit in record["fits"] if fit["method"] == method]


def at_like_steps(
    record: dict[str, Any], method: str
) -> list[tuple[dict[str, Any], dict[str, float]]]:
    """Return a method's fits by lobes and their ends; of the paper, what as many steps come to."""
    fits = _of(record, method)
    if method != "paper" or not fits:
        return [(fit, fit["points"][-1]) for fit in fits]
    least = min(fit["points"][-1]["steps"] for fit in fits)
    return [(fit, point) for fit in fits for point in fit["points"] if point["steps"] == least]


def _method(name: str) -> str:
    """Return the method of a row of the scaling, `live` of `live, a next frame`."""
    return name.partition(",")[0]


def _line(
    axes: Axes,
    name: str,
    points: Sequence[tuple[float, float]],
    theme: Theme,
    *,
    small_on_the_way: bool = False,
    label: str | None = None,
) -> None:
    """Draw the points of a method; peers as markers alone."""
    look, colour = LOOKS.get(name, PEER), colour_of(name, theme)
    x, y = zip(*points, strict=True)
    size = 4 if small_on_the_way else 8
    axes.plot(
        x,
        y,
        color=colour,
        linestyle=look.line if len(points) > 1 else "",
        linewidth=2,
        marker=look.marker,
        markersize=size,
        label=label,
        zorder=3,
    )
    axes.plot(x[-1], y[-1], look.marker, color=colour, markersize=8, zorder=3)


def _front(axes: Axes, fits: Sequence[dict[str, Any]], key: str, theme: Theme) -> None:
    found = front(_every_point(fits, key))
    x, y = zip(*found, strict=True)
    axes.plot(x, y, color=theme.faint, linestyle=(0, (1, 2)), linewidth=1.5, drawstyle="steps-post")


def _every_point(fits: Sequence[dict[str, Any]], key: str) -> list[tuple[float, float]]:
    return [(point["cpu_seconds"], point[key]) for fit in fits for point in fit["points"]]


def _grown(axes: Axes, name: str, found: dict[str, Any], unit: str, theme: Theme) -> None:
    """Draw the points of a ladder and its power law."""
    method, law = _method(name), found["law"]
    look, colour = LOOKS[method], colour_of(method, theme)
    label = name
    if law is not None:
        label = f"{name}: {unit}^{law['exponent']:.2f} ± {law['standard_error']:.2f}"
        ends = [min(found["sizes"]), max(found["sizes"])]
        fitted = [law["coefficient"] * size ** law["exponent"] for size in ends]
        axes.plot(ends, fitted, color=colour, linestyle=look.line, linewidth=1.5)
    axes.plot(
        found["sizes"],
        found["cpu_seconds"],
        look.marker,
        color=colour,
        markersize=8,
        label=label,
        zorder=3,
    )


def _title(axes: Axes, text: str, theme: Theme) -> None:
    axes.set_title(text, fontsize=14, color=theme.text, pad=10)


def _finish(axes: Axes, x: str, y: str, theme: Theme, *, linear_x: bool = False) -> None:
    """Make the axes logarithmic and name them."""
    axes.set_yscale("log")
    if not linear_x:
        axes.set_xscale("log")
        axes.margins(x=0.08)
        plain_numbers(axes.xaxis)
    axes.margins(y=0.08)
    plain_numbers(axes.yaxis)
    axes.set_xlabel(x, color=theme.faint, fontsize=12)
    axes.set_ylabel(y, color=theme.faint, fontsize=12)


def _panel_legend(axes: Axes, theme: Theme) -> None:
    axes.legend(frameon=False, labelcolor=theme.text, fontsize=12, loc="upper left")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.35)  # room for the legend above the points
    plain_numbers(axes.yaxis)


def _legend(figure: Figure, methods: Sequence[str], theme: Theme) -> None:
    """Name the methods under the heading."""
    width, height = (figure.get_size_inches() * figure.dpi).tolist()
    handles = [
        Line2D(
            [],
            [],
            color=colour_of(name, theme),
            marker=LOOKS[name].marker,
            linestyle=LOOKS[name].line,
            linewidth=2,
            markersize=8,
            label=NAMES.get(name, name),
        )
        for name in methods
    ]
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(12 / width, 1 - 62 / height),
        ncols=len(handles),
        frameon=False,
        labelcolor=theme.text,
        fontsize=13,
    )


def _foot(figure: Figure, text: str, theme: Theme) -> None:
    height = figure.get_size_inches()[1] * DPI
    figure.text(24 / WIDTH, 16 / height, text, fontsize=12, color=theme.faint)
