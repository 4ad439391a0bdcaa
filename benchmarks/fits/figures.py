# SPDX-License-Identifier: Apache-2.0
"""Pictures of what `fit.py` measured: accuracy beside EM, error against time, following.

Every method has its colour and its marker, the same in all pictures [colours: Okabe and Ito 2008,
"Color universal design", which every kind of colour vision tells apart].
"""

import math
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import ScaledTranslation

from asglight.judging.pictures.charts import panel_grid, plain_numbers
from asglight.judging.pictures.layout import FAINT, LINE, TEXT, save, sheet

LOOKS = {
    "em": ("#9a9b9d", "D"),
    "paper": ("#e69f00", "D"),
    "fast": ("#56b4e9", "o"),
    "best": ("#009e73", "s"),
    "live": ("#f0e442", "^"),
    "independent": ("#cc79a7", "."),
}
"""Colour and marker by method."""

NAMES = {
    "em": "EM, isotropic lobes",
    "paper": "the paper's recipe (Clausen et al. 2024)",
    "independent": "independent fits",
}
"""Methods that are more than their name."""

METRIC_TITLES = {
    "env": "env: the map itself",
    "irr": "irr: white ball",
    "irrMax": "irrMax: its worst place",
    "r0.5": "r0.5: rough ball",
    "r0.25": "r0.25: glossy ball",
}
LOSS_TITLES = {"loss": "the paper's own loss", **METRIC_TITLES}


def draw_accuracy(path: Path, result: dict[str, Any]) -> None:
    """Draw the ratio of every error to that of EM by map, and the seconds.

    Args:
        path: PNG file to write.
        result: As in fit.json.
    """
    maps, presets = result["accuracy"]["maps"], result["accuracy"]["presets"]
    rows = [*maps, "median"]
    top, bottom, height = 176, 84, 40 * len(rows)
    figure = sheet(
        1800,
        top + height + bottom,
        f"Error of the presets over the error of EM, {result['lobes']} lobes each",
        "left of 1 is better than EM; dashed: the target of that preset",
    )
    panels = panel_grid(figure, 1, len(METRIC_TITLES) + 1, (120, 30, top, bottom), gap=0.07)[0]
    for axes, (key, title) in zip(panels, METRIC_TITLES.items(), strict=False):
        axes.set_title(title, fontsize=13, color=TEXT, pad=10)
        axes.axvline(1, color=LOOKS["em"][0], linewidth=1.5)
        for shift, (preset, account) in zip(_shifts(presets), presets.items(), strict=True):
            _ratios(axes, key, preset, account, shift)
    panels[-1].set_title("wall seconds of a fit", fontsize=13, color=TEXT, pad=10)
    for place, methods in enumerate(maps.values()):
        for shift, (method, errors) in zip(_shifts(methods), methods.items(), strict=True):
            colour, marker = LOOKS[method]
            panels[-1].plot(errors["wall_seconds"], place + shift, marker, color=colour)
    for index, axes in enumerate(panels):
        axes.set_xscale("log")
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_yticks(range(len(rows)), labels=rows if index == 0 else [])
        axes.axhline(len(maps) - 0.5, color=LINE, linewidth=1)
        axes.set_xlabel("seconds" if axes is panels[-1] else "ratio to EM", color=FAINT)
        plain_numbers(axes.xaxis)
    missing = Line2D([], [], color=TEXT, marker="X", linestyle="", label="misses its target")
    _legend(figure, ["em", *presets], result, [missing])
    save(figure, path)


def _shifts(methods: Collection[str]) -> list[float]:
    """Return how far the markers of each method stand from the middle of their row."""
    return [0.24 * (place - (len(methods) - 1) / 2) for place in range(len(methods))]


def _ratios(axes: Axes, key: str, preset: str, account: dict[str, Any], shift: float) -> None:
    """Draw one metric of a preset: a marker for each map, its median, and its targets."""
    colour, marker = LOOKS[preset]
    count = len(account["ratios"])
    places = [(row[key], key in account["missed"][name]) for name, row in account["ratios"].items()]
    places.append((account["median"][key], key in account["missed_median"]))
    for place, (ratio, is_missed) in enumerate(places):
        axes.plot(ratio, place + shift, "X" if is_missed else marker, color=colour, markersize=8)
    targets = account["targets"]
    dashed: dict[str, Any] = {"color": colour, "linestyle": (0, (4, 3)), "linewidth": 1.5}
    axes.plot([targets["every"][key]] * 2, [-0.5, count - 0.5], **dashed)
    if key in targets["median"]:
        axes.plot([targets["median"][key]] * 2, [count - 0.5, count + 0.5], **dashed)


def draw_curves(path: Path, result: dict[str, Any]) -> None:
    """Draw error against wall time on each map.

    Args:
        path: PNG file to write.
        result: As in fit.json.
    """
    curves = result["curves"]
    top, bottom, height = 176, 84, 460 * len(curves)
    steps = max(curve["paper_steps"] for curve in curves.values())
    figure = sheet(
        1800,
        top + height + bottom,
        "Error against time, first frame",
        f"arrows: time to the last error of the paper's recipe, after {steps:,} Adam steps",
    )
    grid = panel_grid(figure, len(curves), 3, (120, 30, top, bottom), gap=0.14)
    for panels, (name, curve) in zip(grid, curves.items(), strict=True):
        for axes, key in zip(panels, ("loss", "irr", "r0.25"), strict=True):
            axes.set_title(f"{name}, {LOSS_TITLES[key]}", fontsize=13, color=TEXT, pad=10)
            for method, points in curve["points"].items():
                _curve(axes, key, method, points)
            axes.set(xscale="log", yscale="log")
            axes.margins(y=0.12)
            for place, (preset, races) in enumerate(curve["races"].items()):
                _race(axes, place, preset, races[key])
            axes.set_xlabel("wall seconds", color=FAINT)
            plain_numbers(axes.xaxis)
            plain_numbers(axes.yaxis)
        panels[0].set_ylabel("relative error", color=FAINT)
    _legend(figure, next(iter(curves.values()))["points"], result)
    save(figure, path)


def _curve(axes: Axes, key: str, method: str, points: Sequence[dict[str, float]]) -> None:
    """Draw the points that have the metric, and mark the last.

    A preset's state stays until the next; of the paper's steps only some were kept.
    """
    colour, marker = LOOKS[method]
    style = "default" if method == "paper" else "steps-post"
    known = [(point["wall_seconds"], point[key]) for point in points if key in point]
    seconds, errors = zip(*known, strict=True)
    axes.plot(seconds, errors, color=colour, linewidth=2, drawstyle=style)
    axes.plot(seconds[-1], errors[-1], marker, color=colour, markersize=10)


def times(ratio: float | None) -> str:
    """Return a ratio with three figures, 75.3 or 1,680; nothing for None."""
    if ratio is None:
        return ""
    return f"{float(f'{ratio:.3g}'):,.0f}" if ratio >= 100 else f"{ratio:.3g}"


def _race(axes: Axes, place: int, preset: str, race: dict[str, float | None]) -> None:
    """Draw how much earlier than the paper's last error a preset is as good: one arrow each."""
    level, slow, quick = race["level"], race["paper_seconds"], race["seconds"]
    assert level is not None
    axes.axhline(level, color=LOOKS["paper"][0], linewidth=1, linestyle=(0, (1, 3)))
    if quick is None or slow is None:
        return
    colour = LOOKS[preset][0]
    down = axes.transData + ScaledTranslation(0, -24 * place / 72, axes.figure.dpi_scale_trans)
    arrow = {"arrowstyle": "<->", "color": colour, "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (quick, level), (slow, level), down, down, arrowprops=arrow)
    axes.annotate(
        f"{preset}: {times(race['times_faster'])} times faster",
        (math.sqrt(quick * slow), level),
        (0, -15 if place else 4),  # under all but the first: over them end marks of fits
        down,
        "offset points",
        color=colour,
        fontsize=12,
        ha="center",
    )


def draw_following(path: Path, result: dict[str, Any]) -> None:
    """Draw the glossy ball's error and the seconds of every frame of each sequence.

    Args:
        path: PNG file to write.
        result: As in fit.json.
    """
    sequences = result["following"]
    figure = sheet(
        1800,
        1000,
        "Following a sequence",
        "independent: every frame fitted from nothing, lobes matched to the frame before",
    )
    grid = panel_grid(figure, 2, len(sequences), (120, 30, 176, 200), gap=0.1)
    for column, (name, account) in enumerate(sequences.items()):
        error, seconds = grid[0][column], grid[1][column]
        size = f"{account['columns']} x {account['rows']}"
        error.set_title(f"{name}, {size}", fontsize=13, color=TEXT, pad=10)
        for place, (method, found) in enumerate(account["methods"].items()):
            colour, marker = LOOKS[method]
            frames = account["frames"][: len(found["wall_seconds"])]
            look: dict[str, Any] = {"color": colour, "linewidth": 2, "marker": marker}
            error.plot(frames, found["errors"]["r0.25"], markersize=4, **look)
            seconds.plot(frames, found["wall_seconds"], markersize=4, **look)
            seconds.text(
                0,
                -0.24 - 0.09 * place,
                _summary(method, found),
                color=colour,
                fontsize=12,
                transform=seconds.transAxes,
            )
        for axes in (error, seconds):
            axes.set_yscale("log")
            plain_numbers(axes.yaxis)
        seconds.set_xlabel("frame", color=FAINT)
    grid[0][0].set_ylabel("r0.25: error of a glossy ball", color=FAINT)
    grid[1][0].set_ylabel("wall seconds of a frame", color=FAINT)
    _legend(figure, next(iter(sequences.values()))["methods"], result)
    save(figure, path)


def _summary(method: str, found: dict[str, Any]) -> str:
    following = found["wall_seconds"][1:] or found["wall_seconds"]
    mean = sum(following) / len(following)
    jumps = "1 jump" if found["jumps"] == 1 else f"{found['jumps']} jumps"
    return f"{method}: {mean:.2f} s a next frame, flicker {found['flicker']:.3f}, {jumps}"


def _legend(
    figure: Figure, methods: Iterable[str], result: dict[str, Any], more: Sequence[Line2D] = ()
) -> None:
    """Name the methods under the heading, and the machine at the foot."""
    width, height = (figure.get_size_inches() * figure.dpi).tolist()
    handles = []
    for method in methods:
        colour, marker = LOOKS[method]
        label = NAMES.get(method, method)
        handles.append(Line2D([], [], color=colour, marker=marker, label=label, linewidth=2))
    figure.legend(
        handles=[*handles, *more],
        loc="upper left",
        bbox_to_anchor=(12 / width, 1 - 66 / height),
        ncols=len(handles) + len(more),
        frameon=False,
        labelcolor=TEXT,
        fontsize=13,
    )
    at = result["machine"]
    text = f"{at['processor']}, {at['cores']} cores, torch {at['torch']}, steps {at['steps']}; "
    text += f"threads: {at['threads']}, of presets one a start"
    figure.text(24 / width, 18 / height, text, fontsize=11, color=FAINT)
