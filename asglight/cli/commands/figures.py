# SPDX-License-Identifier: Apache-2.0
"""`asglight figures`: the figures of Clausen et al. 2024 on any input, with their numbers."""

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asglight.cli.folders import made_folder, write_json, write_text
from asglight.cli.inputs import lit, open_input
from asglight.cli.options.parser import Parser, add_input_options, add_json_option
from asglight.cli.options.reading import given, read_options
from asglight.cli.printing import print_json
from asglight.cli.progress import Reporter, reporter
from asglight.cli.sources import built_in
from asglight.errors import InputError
from asglight.fitting.options import LOBES
from asglight.fitting.paper import fit as paper
from asglight.images.message import shown
from asglight.judging.paper_figures.data import LOBE_COUNTS, ROWS, STARTS, STEPS, Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from torch import Tensor

    from asglight.judging.pictures.layout import Theme

EXAMPLE = "asglight figures losses sky.exr -o figures-output"

FIGURES = {
    "lobes": "the map, balls and errors by number of lobes",
    "losses": "the paper's recipe with each of its six losses",
    "time": "a row of the map over time, with and without the temporal term",
    "forms": "isotropic against anisotropic lobes",
}

EXPLANATION = """\
Fits INPUT anew and writes into DIR: figure-FIGURE.png, its caption with a table and what it says
beside the paper (.md), and every number (.json). Without INPUT the built-in environment is taken.
The paper's recipe takes a stated part of its 24,000 steps on a coarser map, so that a figure takes
minutes; --steps 24000 --rows 256 is the published recipe and takes hours:
docs/results/figures.md."""

LOBES_MAX = 120
ROWS_MIN, STARTS_MAX = 8, 9
FRAMES = 16
"""Of a sequence, where --frames does not choose: four minutes of one core."""


@dataclass(frozen=True)
class Shot:
    """What is fitted.

    Attributes:
        name: Short, of the heading.
        frames: Their numbers.
        maps: Their radiance.  [H, W, 3]
    """

    name: str
    frames: tuple[int, ...]
    maps: "Sequence[Tensor]"


Drawn = tuple["Figure", str, list[dict[str, Any]]]
"""Picture, caption, numbers."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the figures, each with the options that it has."""
    parser.description = f"{parser.description}\n\n{EXPLANATION}"
    figures = parser.add_subparsers(
        title="figures", metavar="FIGURE", required=True, dest="figure", parser_class=Parser
    )
    for name, meaning in FIGURES.items():
        figure = figures.add_parser(name, help=meaning, description=f"Draw {meaning}.")
        figure.epilog = f"example: asglight figures {name} sky.exr -o figures-output"
        add = figure.add_argument
        add("input", nargs="?", metavar="INPUT", help="image file, folder or pattern")
        folder = "folder to write into (default: %(default)s)"
        add("-o", "--output", metavar="DIR", default="figures-output", help=folder)
        if name == "lobes":
            counts = ",".join(map(str, LOBE_COUNTS))
            many = f"numbers of lobes, with commas (default: {counts})"
            add("--lobes", metavar="N,...", default=counts, help=many)
        else:
            add("--lobes", metavar="N", default=str(LOBES), help="lobes (default: %(default)s)")
        if name != "forms":
            steps = "Adam steps of the paper's recipe, of 24000 (default: %(default)s)"
            add("--steps", type=int, default=STEPS, metavar="N", help=steps)
            rows = "rows of the map that it is given, of 256 (default: %(default)s)"
            add("--rows", type=int, default=ROWS, metavar="N", help=rows)
        if name == "losses":
            starts = "starts, over which errors are averaged (default: %(default)s)"
            add("--starts", type=int, default=STARTS, metavar="N", help=starts)
        if name == "time":
            row = "latitude of the row, in degrees (default: the row that changes most)"
            add("--latitude", type=float, metavar="DEG", help=row)
        add("--dark", action="store_true", help="a picture for dark pages")
        is_of_time = name == "time"
        add_input_options(figure, f"default: the first {FRAMES}" if is_of_time else "the first")
        add_json_option(figure)


def run(arguments: argparse.Namespace) -> int:
    """Measure, draw, write picture, caption and numbers, and say where they are."""
    plan = plan_for(arguments)
    if vars(arguments).get("latitude") is not None:
        checked("latitude", arguments.latitude, -90, 90)
    folder = made_folder(Path(arguments.output))
    with reporter() as report:
        shot = opened(arguments, report)
        plan = replace(plan, rows=min(plan.rows, len(shot.maps[0])))
        figure, caption, numbers = DRAWN[arguments.figure](arguments, shot, plan, report)
    command = command_of(arguments)
    document = {
        "figure": arguments.figure,
        "command": command,
        "input": shot.name,
        "frames": list(shot.frames),
        "rows": len(shot.maps[0]),
        "paper": {"steps": plan.steps, "rows": plan.rows},
        "fits": numbers,
    }
    paths = write(
        folder, arguments.figure, figure, page(arguments.figure, command, caption), document
    )
    if arguments.json:
        print_json(document)
    else:
        print("\n".join([caption, "", *map(shown, paths)]))
    return 0


def plan_for(arguments: argparse.Namespace) -> Plan:
    """Return what the options ask for.

    Raises:
        InputError: A number is none or out of range.
    """
    try:
        counts = sorted({int(word) for word in arguments.lobes.split(",")})
    except ValueError:
        counts = []
    if not counts or not 1 <= counts[0] <= counts[-1] <= LOBES_MAX:
        numbers = "numbers" if arguments.figure == "lobes" else "one number"
        raise InputError(f"lobes: {arguments.lobes!r}; expected {numbers} from 1 to {LOBES_MAX}.")
    if len(counts) > 1 and arguments.figure != "lobes":
        raise InputError(
            f"lobes: {arguments.lobes!r}; expected one number. For several: asglight figures lobes."
        )
    steps, rows, starts = (
        checked(name, vars(arguments).get(name, default), low, high)
        for name, default, low, high in (
            ("steps", STEPS, 1, paper.FIRST_FRAME_STEPS),
            ("rows", ROWS, ROWS_MIN, paper.HEIGHT),
            ("starts", STARTS, 1, STARTS_MAX),
        )
    )
    return Plan(counts[0], tuple(counts), steps, rows, starts)


def checked(name: str, value: float, low: int, high: int) -> Any:
    """Return a number that is in range.

    Raises:
        InputError: It is not.
    """
    if not low <= value <= high:
        raise InputError(f"{name}: {value}; expected {low} to {high}.")
    return value


def opened(arguments: argparse.Namespace, report: Reporter) -> Shot:
    """Read the frames of a figure: one, or for `time` all that were asked for.

    Raises:
        InputError: They cannot be read, have no light, or are too few.
    """
    many = FRAMES if arguments.frames is None else None
    if arguments.input is None:
        return environment(arguments, many, report)
    sequence = open_input(arguments.input, arguments)
    frames = some(sequence.frames, arguments.figure, many, sequence.name)
    read = report.follow(frames, f"reading {sequence.name}", len(frames))
    return Shot(sequence.name, frames, [lit(sequence, frame) for frame in read])


def environment(arguments: argparse.Namespace, many: int | None, report: Reporter) -> Shot:
    """Draw frames of the built-in environment.

    Raises:
        InputError: It has none of the frames, or an option would choose among images.
    """
    from asglight.images.frame_files import frame_set, ranges

    for option in given(read_options(arguments)):
        raise InputError(f"{option}: given without images; expected them as INPUT.")
    wanted = built_in.FRAMES if many else frame_set(arguments.frames, "frames")
    outside = tuple(sorted(set(wanted) - set(built_in.FRAMES)))
    if outside:
        raise InputError(
            f"frames: {ranges(outside)}; expected some of {ranges(built_in.FRAMES)} of the "
            f"{built_in.NAME}."
        )
    frames = some(wanted, arguments.figure, many, built_in.NAME)
    drawn = report.follow(frames, f"drawing the {built_in.NAME}", len(frames))
    return Shot(built_in.NAME, frames, [built_in.environment(frame) for frame in drawn])


def some(frames: tuple[int, ...], figure: str, many: int | None, name: str) -> tuple[int, ...]:
    """Return the frames that a figure shows.

    Raises:
        InputError: There is one, and the figure is of time.
    """
    if figure != "time":
        return frames[:1]
    if len(frames) < 2:
        raise InputError(f"{name}: has one frame; expected two or more to stack over time.")
    return frames[:many]


def command_of(arguments: argparse.Namespace) -> str:
    """Return the command that makes the same numbers."""
    words = ["asglight", "figures", arguments.figure]
    words += [] if arguments.input is None else [arguments.input]
    usual = {"lobes": str(LOBES), "steps": STEPS, "rows": ROWS, "starts": STARTS}
    if arguments.figure == "lobes":
        usual["lobes"] = ",".join(map(str, LOBE_COUNTS))
    for name in (*usual, "latitude", "frames"):
        value = vars(arguments).get(name)
        if value is not None and value != usual.get(name):
            words += [f"--{name.replace('_', '-')}", str(value)]
    for option, value in given(read_options(arguments)).items():
        words += [option, value]
    return shlex.join(words)


def draw_lobes(arguments: argparse.Namespace, shot: Shot, plan: Plan, report: Reporter) -> Drawn:
    """Make the sweep."""
    from asglight.judging.paper_figures import captions
    from asglight.judging.paper_figures import sheet as sheets
    from asglight.judging.paper_figures.data import OURS, by_label, lobe_sweep

    still = lobe_sweep(shot.maps[0], plan, report.follow)
    labels, groups = zip(*by_label(still.rows, OURS), strict=True)
    names = [f"{label} lobe{'s' if label != '1' else ''}" for label in labels]
    lines = sheets.lines_of(still, groups, names)
    title = f"{shot.name}: number of lobes, ours (fast)"
    foot = (
        f"curves: fast, and the paper's recipe (Clausen et al. 2024) with {captions.recipe(plan)}"
    )
    figure = sheets.draw_sweep(title, still, lines, foot, theme_of(arguments))
    return figure, captions.lobes_caption(still, plan), [row.as_json() for row in still.rows]


def draw_losses(arguments: argparse.Namespace, shot: Shot, plan: Plan, report: Reporter) -> Drawn:
    """Make the ablation."""
    from asglight.judging.paper_figures import captions
    from asglight.judging.paper_figures import sheet as sheets
    from asglight.judging.paper_figures.data import OURS, PAPER, by_label, loss_ablation

    still = loss_ablation(shot.maps[0], plan, report.follow)
    ablated = list(by_label(still.rows, PAPER))
    labels, groups = zip(*ablated, *by_label(still.rows, OURS), strict=True)
    names = [label.replace(", ", "\n") for label in labels]
    lines = sheets.lines_of(still, groups, names, [group for _, group in ablated])
    title = f"{shot.name}: six losses in the paper's recipe, {plan.lobes} lobes"
    starts = "one start" if plan.seeds == 1 else f"means over {plan.seeds} starts, least–largest"
    foot = (
        f"Each loss: {captions.recipe(plan)}; {starts}; bold: best of the six.\n"
        "L_D: L1 of what a white ball shows, by harmonics of degree 3. Clausen et al. 2024 take "
        "L1 + L_D. Map and balls are those of the first start."
    )
    figure = sheets.draw_sheet(title, lines, foot, theme_of(arguments))
    return figure, captions.losses_caption(still, plan), [row.as_json() for row in still.rows]


def draw_forms(arguments: argparse.Namespace, shot: Shot, plan: Plan, report: Reporter) -> Drawn:
    """Make the comparison of lobe functions."""
    from asglight.judging.paper_figures import captions
    from asglight.judging.paper_figures import sheet as sheets
    from asglight.judging.paper_figures.data import form_comparison

    still = form_comparison(shot.maps[0], plan, report.follow)
    names = [row.fit.label.replace(", ", "\n").replace(" (", "\n(") for row in still.rows]
    groups = [[row] for row in still.rows]
    lines = sheets.lines_of(still, groups, names, groups)
    title = f"{shot.name}: isotropic against anisotropic lobes, ours (fast)"
    foot = "bold: best of the four. A bingham lobe has a twin on the other side of the sphere."
    figure = sheets.draw_sheet(title, lines, foot, theme_of(arguments))
    return figure, captions.forms_caption(still), [row.as_json() for row in still.rows]


def draw_time(arguments: argparse.Namespace, shot: Shot, plan: Plan, report: Reporter) -> Drawn:
    """Make the stacked row."""
    from asglight.judging.paper_figures import captions
    from asglight.judging.paper_figures.over_time import stacked
    from asglight.judging.paper_figures.stack import draw_stack

    found = stacked(shot.maps, shot.frames, plan, report.follow, arguments.latitude)
    title = (
        f"{shot.name}: the row at {found.latitude_deg:+.0f}° over {len(shot.frames)} frames, "
        f"{plan.lobes} lobes"
    )
    foot = f"paper's recipe (Clausen et al. 2024): {captions.recipe(plan)}; L_T: its temporal term"
    figure = draw_stack(title, found, foot, theme_of(arguments))
    return figure, captions.time_caption(found, plan), [way.as_json() for way in found.ways]


DRAWN: dict[str, Callable[[argparse.Namespace, Shot, Plan, Reporter], Drawn]] = {
    "lobes": draw_lobes,
    "losses": draw_losses,
    "time": draw_time,
    "forms": draw_forms,
}


def theme_of(arguments: argparse.Namespace) -> "Theme":
    """Return the colours that were asked for."""
    from asglight.judging.pictures.layout import DARK, LIGHT

    return DARK if arguments.dark else LIGHT


def page(figure: str, command: str, caption: str) -> str:
    """Return the caption as a section of Markdown."""
    title = FIGURES[figure]
    head = f"## {title[0].upper()}{title[1:]}"
    return f"{head}\n\n![{head[3:]}](figure-{figure}.png)\n\n`{command}`\n\n{caption}\n"


def write(
    folder: Path, name: str, figure: "Figure", caption: str, document: dict[str, Any]
) -> list[Path]:
    """Write picture, caption and numbers; each is whole or not there.

    Raises:
        InputError: The folder cannot be written.
    """
    from asglight.judging.pictures.layout import save

    picture, text, numbers = (
        folder / f"figure-{name}{suffix}" for suffix in (".png", ".md", ".json")
    )
    save(figure, picture)
    write_text(text, caption)
    write_json(numbers, document)
    return [picture, text, numbers]
