# SPDX-License-Identifier: Apache-2.0
"""`asglight bench`: error against run time: page, pictures, JSON; a gate for regressions."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asglight.cli.folders import made_folder, write_json, write_text
from asglight.cli.inputs import lit, open_input
from asglight.cli.options.parser import add_input_options, add_json_option
from asglight.cli.options.reading import given, read_options
from asglight.cli.printing import counted, print_json, table
from asglight.cli.progress import Reporter, reporter
from asglight.errors import InputError
from asglight.fitting.options import LOBES
from asglight.images.message import shown
from asglight.judging.bench import gate as bench_gate
from asglight.judging.bench.plan import Effort, Plan, plan_of

if TYPE_CHECKING:
    from asglight.judging.bench.run import Input

EXAMPLE = """asglight bench sky.exr -o bench-output --quick
a sequence: asglight bench shot/ -o bench-output
a gate: asglight bench sky.exr --quick --gate baseline.json"""

EXPLANATION = """\
Fits each INPUT with every preset of asglight at several numbers of lobes, with other methods at the
same number of floats, and at several sizes; a sequence is followed too. Writes bench.html (one page
that works offline), bench.json and pictures. docs/results/bench.md says what is measured and how.
Takes a quarter of an hour for a map on a quiet core; --quick under two minutes, --full hours.
--gate exits with 3 where an error, or a time relative to a peer's, is worse than a baseline's."""

LOBES_MAX = 120
WORSE = 3
"""Exit status: the run is done, and worse than the baseline."""

SHOWN = ("env", "flux", "irr", "irrMax", "r0.5", "r0.25")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench`."""
    parser.description = f"{parser.description}\n\n{EXPLANATION}"
    add = parser.add_argument
    add("input", nargs="+", metavar="INPUT", help="image file, folder or pattern")
    folder = "folder for page, pictures and JSON (default: %(default)s)"
    add("-o", "--output", metavar="DIR", default="bench-output", help=folder)
    lobes = "lobes where one number is meant, 1 to 120 (default: %(default)s)"
    add("--lobes", type=int, default=LOBES, metavar="N", help=lobes)
    steps = "Adam steps of the paper's recipe (24000: all; default: 2400, with --quick 240)"
    add("--paper-steps", type=int, metavar="N", help=steps)
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="few of everything, under two minutes")
    full = "every number of lobes, size and length, all steps of the paper: hours"
    effort.add_argument("--full", action="store_true", help=full)
    add("--baseline", metavar="FILE", help="write what a later --gate compares with")
    add("--gate", metavar="FILE", help="compare with a baseline; exit with 3 where this is worse")
    followed = "default: the first 24, with --quick 8, with --full all"
    add_input_options(parser, followed)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Measure each input; write page, pictures and JSON after each; compare with the baseline."""
    plan = plan_for(arguments)
    before = gate_for(arguments.gate, plan)
    folder = made_folder(Path(arguments.output))
    with reporter() as report:
        inputs = [opened(path, arguments, plan, report) for path in arguments.input]
        check_names([given.name for given in inputs])
        if before is not None:
            facts = {given.name: bench_gate.described(given.facts()) for given in inputs}
            bench_gate.check_inputs(before, Path(arguments.gate), facts)
        document = measure(inputs, plan, folder, report, command_of(arguments))
    if arguments.baseline is not None:
        write_json(Path(arguments.baseline), bench_gate.baseline(document))
    worse = None
    if before is not None:
        worse = bench_gate.compared(before, Path(arguments.gate), document)
    if arguments.json:
        listed = None if worse is None else [vars(each) for each in worse]
        print_json(document | {"worse": listed})
    else:
        print_summary(document, folder, worse)
    return WORSE if worse else 0


def plan_for(arguments: argparse.Namespace) -> Plan:
    """Return what the options ask for.

    Raises:
        InputError: A number is out of range.
    """
    if not 1 <= arguments.lobes <= LOBES_MAX:
        raise InputError(f"lobes: {arguments.lobes}; expected 1 to {LOBES_MAX}.")
    if arguments.paper_steps is not None and arguments.paper_steps < 1:
        raise InputError(f"paper-steps: {arguments.paper_steps}; expected 1 or more.")
    effort = Effort.QUICK if arguments.quick else Effort.FULL if arguments.full else Effort.DEFAULT
    return plan_of(effort, arguments.lobes, arguments.paper_steps)


def command_of(arguments: argparse.Namespace) -> str:
    """Return the command that makes the same page: its inputs and what changes the numbers."""
    words = ["asglight", "bench", *arguments.input]
    words += [f"--{name}" for name in ("quick", "full") if getattr(arguments, name)]
    words += ["--lobes", str(arguments.lobes)] if arguments.lobes != LOBES else []
    for name in ("paper_steps", "frames"):
        value = getattr(arguments, name)
        words += [] if value is None else [f"--{name.replace('_', '-')}", str(value)]
    for option, value in given(read_options(arguments)).items():
        words += [option, value]
    return shlex.join(words)


def gate_for(path: str | None, plan: Plan) -> dict[str, Any] | None:
    """Read the baseline, before any time is spent.

    Raises:
        InputError: It cannot be used for this run.
    """
    if path is None:
        return None
    before = bench_gate.read_baseline(Path(path))
    asked = {"effort": plan.effort.value, "lobes": plan.lobes, "paper_steps": plan.paper_steps}
    bench_gate.check_asked(before, Path(path), asked)
    return before


def opened(path: str, arguments: argparse.Namespace, plan: Plan, report: Reporter) -> "Input":
    """Read an input: its first frame as finely as it comes, all that is followed at 256 rows.

    Frames that were asked for are followed; without a choice, as many as the effort has.

    Raises:
        InputError: It cannot be read, or a frame has no light in it.
    """
    from asglight.judging.bench.run import Input  # loads what fits

    sequence = open_input(path, arguments)
    finest = open_input(path, arguments, max(plan.widths) // 2)
    is_chosen = arguments.frames is not None or sequence.source.asked is not None
    frames = sequence.frames if is_chosen else sequence.frames[: plan.frames]
    read = report.follow(frames, f"reading {sequence.name}", len(frames))
    references = [lit(sequence, frame) for frame in read]
    source = finest.read(frames[0]).radiance
    return Input(sequence.name, path, frames, references, source)


def check_names(names: Sequence[str]) -> None:
    """Refuse two inputs of one name.

    Raises:
        InputError: There are two.
    """
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{shown(name)}: is the name of two inputs; expected different ones, by which "
                "results are known. Rename one."
            )


def measure(
    inputs: Sequence["Input"], plan: Plan, folder: Path, report: Reporter, command: str
) -> dict[str, Any]:
    """Measure one input after the other, writing after each what is there."""
    from asglight.judging.bench import run as bench

    records: list[dict[str, Any]] = []
    document: dict[str, Any] = {}
    for source in inputs:
        records.append(bench.measured(source, plan, report.follow))
        document = bench.document(plan, records, command)
        write(folder, document, report)
    return document


def write(folder: Path, document: dict[str, Any], report: Reporter) -> None:
    """Write JSON, pictures and page; each file is whole or not there.

    Raises:
        InputError: The folder cannot be written.
    """
    from asglight.judging.bench import plots as bench_plots
    from asglight.judging.bench.looks import PAGE_THEME, svg
    from asglight.judging.bench.page import page
    from asglight.judging.pictures.layout import DARK, save

    write_json(folder / "bench.json", document)
    pictures: dict[str, dict[str, str]] = {}
    records = document["inputs"]
    for record in report.follow(records, "drawing", len(records)):
        drawn = pictures.setdefault(record["name"], {})
        for name, draw in bench_plots.pictures(record).items():
            save(draw(record, DARK), folder / f"{record['name']}.{name}.png")
            drawn[name] = svg(draw(record, PAGE_THEME))
    write_text(folder / "bench.html", page(document, pictures))


def print_summary(
    document: dict[str, Any], folder: Path, worse: Sequence[bench_gate.Worse] | None
) -> None:
    """Print the errors at one number of floats, where the page is, and what got worse."""
    from asglight.judging.bench.page import ahead_on_the_map, ahead_on_the_sequence

    for record in document["inputs"]:
        print(f"{record['name']}, {record['floats']} floats")
        print(fits_table(record))
        print(ahead_on_the_map(record))
        if "sequence" in record:
            print(f"\nfollowing {counted(len(record['frames']), 'frame')}, means over them")
            print(following_table(record["sequence"]["methods"]))
            print(ahead_on_the_sequence(record))
        print()
    print(f"{shown(folder / 'bench.html')}: everything, in one page")
    if worse is not None:
        print(verdict(worse))


def fits_table(record: dict[str, Any]) -> str:
    """Return time and errors of every method at one number of floats."""
    rows = []
    for fit in record["fits"]:
        if fit["lobes"] == record["lobes"]:
            last = fit["points"][-1]
            errors = [f"{last[name]:.4f}" for name in SHOWN]
            rows.append([fit["method"], f"{last['cpu_seconds']:.2f}", *errors])
    return table(["method", "CPU s", *SHOWN], rows)


def following_table(methods: dict[str, Any]) -> str:
    """Return time, errors and flicker of every method on a sequence."""
    rows = [
        [
            name,
            f"{found['next_cpu_seconds']:.3f}",
            *(f"{found['mean'][metric]:.4f}" for metric in (*SHOWN, "flicker")),
            str(found["jumps"]),
        ]
        for name, found in methods.items()
    ]
    return table(["method", "CPU s a next frame", *SHOWN, "flicker", "jumps"], rows)


def verdict(worse: Sequence[bench_gate.Worse]) -> str:
    """Return what is worse than the baseline, a line each."""
    if not worse:
        return "gate: nothing is worse than the baseline"
    lines = [
        f"gate: {each.input}: {each.metric} is {each.now:.4g}, was {each.before:.4g}; at most "
        f"{each.ratio_max:g} times as much is allowed"
        for each in worse
    ]
    return "\n".join(lines)
