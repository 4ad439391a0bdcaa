# SPDX-License-Identifier: Apache-2.0
"""`asglight compare`: every method on the same map at the same number of floats."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from asglight.cli.folders import made_folder
from asglight.cli.inputs import lit, open_input
from asglight.cli.options.parser import add_input_options, add_json_option
from asglight.cli.printing import print_json, size
from asglight.cli.progress import reporter
from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.images.message import shown
from asglight.judging.compare.maps import (
    FLOATS,
    FLOATS_MIN,
    Comparison,
    Plan,
    Result,
    compare,
    row_title,
)
from asglight.judging.compare.methods import COMPARED
from asglight.judging.compare.spheres import SPHERES
from asglight.judging.metrics import METRIC_NAMES

EXAMPLE = "asglight compare sky.exr -o compare-output --methods fast,em,sh"

EXPLANATION = """\
Methods: {methods}.
Columns: floats used; their bytes, or those of an image's files; processor seconds of the fit;
errors as of `asglight eval`; PSNR of three balls (mirror, silver, diffuse) as a screen shows them,
in dB; FLIP: their HDR-FLIP, 0 to 1, where
asglight[report] is installed. The second table is the three-sphere protocol of papers that
estimate light from photographs. docs/results/compare.md says how each method was read.
keys and keys-texture keep an image and to no budget: the map without its lamps, and a few lights.
paper and physg take a part of their published steps, which the table names; --full takes all:
half an hour and hours."""

QUICK_HEIGHT = 64
FLOATS_MAX = 400
"""Fifty ASG: more lights than anyone would edit, and as slow as the slowest method can be borne."""

WIDTH = 160
"""Columns: every row in one line, also in a log or a file; a narrower terminal breaks lines."""

WIDE = 1e4
"""From which a number is written as a power of ten: where a fit is black nearly everywhere, its
tone mapping makes an error of millions."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `compare`."""
    explanation = EXPLANATION.format(methods=", ".join(COMPARED))
    parser.description = f"{parser.description}\n\n{explanation}"
    add = parser.add_argument
    add("input", metavar="INPUT", help="image file, folder or pattern; by default its first frame")
    folder = "folder for the pictures (default: %(default)s)"
    add("-o", "--output", metavar="DIR", default="compare-output", help=folder)
    add("--floats", type=int, default=FLOATS, metavar="N", help="budget (default: %(default)s)")
    add("--methods", metavar="NAME,...", help="some of the methods (default: all)")
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--full", action="store_true", help="all steps of paper and physg")
    few = "64 rows and few steps: shows that all works, not how well"
    effort.add_argument("--quick", action="store_true", help=few)
    add_input_options(parser, "default: the first")
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Compare on each frame; print tables or JSON, write pictures."""
    plan = Plan(
        chosen(arguments.methods), checked(arguments.floats), arguments.full, arguments.quick
    )
    height = QUICK_HEIGHT if arguments.quick else FIT_HEIGHT
    sequence = open_input(arguments.input, arguments, height)
    frames = sequence.frames if arguments.frames else sequence.frames[:1]
    folder = made_folder(Path(arguments.output))
    done: list[tuple[int, Path, Comparison]] = []
    with reporter() as report:
        for frame in frames:
            comparison = compare(lit(sequence, frame), plan, report.follow)
            picture = folder / f"{sequence.name}.{frame}.png"
            draw(picture, comparison, f"{sequence.name}, frame {frame}", plan.floats)
            done.append((frame, picture, comparison))
    if arguments.json:
        judged = [
            {"frame": frame, "picture": str(picture), "methods": list(map(as_json, found.results))}
            for frame, picture, found in done
        ]
        print_json({"input": arguments.input, "floats": plan.floats, "frames": judged})
        return 0
    for frame, picture, comparison in done:
        print_tables(comparison, f"{sequence.name}, frame {frame}", str(picture))
    return 0


def chosen(names: str | None) -> tuple[str, ...]:
    """Return the methods that were asked for, in the order of the table.

    Raises:
        InputError: There is no such method.
    """
    if names is None:
        return tuple(COMPARED)
    wanted = [name.strip() for name in names.split(",")]
    unknown = [name for name in wanted if name not in COMPARED]
    if unknown:
        raise InputError(
            f"methods: {unknown[0]!r}; expected some of {', '.join(COMPARED)}, with commas between."
        )
    return tuple(name for name in COMPARED if name in wanted)


def checked(floats: int) -> int:
    """Return the budget.

    Raises:
        InputError: It is too small for a lobe, or more than the methods are made for.
    """
    if not FLOATS_MIN <= floats <= FLOATS_MAX:
        raise InputError(
            f"floats: {floats}; expected {FLOATS_MIN} (one lobe) to {FLOATS_MAX}. 120 are 15 lobes."
        )
    return floats


def draw(path: Path, comparison: Comparison, name: str, floats: int) -> None:
    """Write the picture of all methods."""
    from asglight.judging.compare import sheet as compare_sheet

    compare_sheet.draw(path, comparison, f"{name}: every method with {floats} floats")


def print_tables(comparison: Comparison, name: str, picture: str) -> None:
    """Print the errors and those of the three spheres, and where the picture is."""
    console = Console(width=WIDTH, highlight=False)
    console.print(errors_table(comparison.results, name))
    console.print(spheres_table(comparison.results))
    console.print(f"{shown(picture)}: all methods in one picture", markup=False, soft_wrap=True)


def errors_table(results: Sequence[Result], name: str) -> Table:
    """Return the first table; the best of each column is bold."""
    heads = ["floats", "bytes", "CPU s", *METRIC_NAMES, "PSNR", "FLIP"]
    columns: list[list[float | None]] = [
        [result.errors[metric] for result in results] for metric in METRIC_NAMES
    ]
    cells = [_column(column, "{:.4f}", lowest=True) for column in columns]
    cells.append(_column([result.psnr for result in results], "{:.1f}", lowest=False))
    cells.append(_column([result.flip for result in results], "{:.4f}", lowest=True))
    cells.insert(0, [f"{result.seconds:.1f}" for result in results])
    cells.insert(0, [size(result.bytes) for result in results])
    cells.insert(0, [str(result.floats) for result in results])
    return _table(name, results, heads, cells)


def spheres_table(results: Sequence[Result]) -> Table:
    """Return the table of the three-sphere protocol; the best of each column is bold."""
    heads: list[str] = []
    cells: list[list[str]] = []
    for sphere in SPHERES:
        for attribute, head in (("rmse", "RMSE"), ("si_rmse", "si-RMSE"), ("angular", "angle")):
            heads.append(f"{sphere} {head}")
            values = [getattr(result.spheres[sphere], attribute) for result in results]
            cells.append(_column(values, "{:.3f}", lowest=True))
    return _table("three spheres, tone-mapped (angle in degrees)", results, heads, cells)


def _column(values: Sequence[float | None], form: str, *, lowest: bool) -> list[str]:
    """Return the cells of a column."""
    known = [value for value in values if value is not None]
    best = (min if lowest else max)(known, default=None)
    texts = ["–" if value is None else _cell(value, form) for value in values]
    bold = None if best is None else _cell(best, form)
    return [f"[bold]{text}[/bold]" if text == bold else text for text in texts]


def _cell(value: float, form: str) -> str:
    """Return a number in a form, or by its power of ten where that form would fill a column."""
    return form.format(value) if abs(value) < WIDE else f"{value:.0e}"


def _table(
    title: str, results: Sequence[Result], heads: Sequence[str], cells: Sequence[Sequence[str]]
) -> Table:
    table = Table(title=Text(title), title_justify="left", box=None, pad_edge=False)
    table.add_column("method", no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right")
    for row, result in enumerate(results):
        table.add_row(row_title(result), *(column[row] for column in cells))
    return table


def as_json(result: Result) -> dict[str, Any]:
    """Return a result as JSON values."""
    method = COMPARED[result.name]
    return {
        "name": result.name,
        "title": method.title,
        "floats": result.floats,
        "bytes": result.bytes,
        "cpu_seconds": result.seconds,
        "steps": result.steps,
        "published_steps": method.steps,
        **result.errors,
        "psnr_db": result.psnr,
        "hdr_flip": result.flip,
        "spheres": {sphere: vars(errors) for sphere, errors in result.spheres.items()},
    }
