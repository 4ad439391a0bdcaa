# SPDX-License-Identifier: Apache-2.0
"""`asglight stress`: stiff, extreme and broken input, measured, with a verdict for each case."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asglight.cli.folders import made_folder, write_json, write_text
from asglight.cli.options.parser import add_json_option
from asglight.cli.printing import print_json, table
from asglight.cli.progress import reporter
from asglight.errors import InputError

if TYPE_CHECKING:
    from asglight.judging.stress.run import Result, Tools

EXAMPLE = """asglight stress -o stress-output
some of it: asglight stress --only time radiance/one-texel
a tenth:    asglight stress --sample 0.1"""

EXPLANATION = """\
Fits a hundred inputs that are hard on numbers and prints the measured errors of each: stiff lobes,
radiance from 1e-45 to 1e30, maps of 1 x 2 to 4,096 x 8,192, flashes, cuts and strobes, damaged
files, and known lobes that have to be found again. Takes three to five minutes.
docs/results/stress.md says what the columns mean. Exits with 3 where a case fails."""

FAILED = 3
"""Exit status: the run is done, and a case fails."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `stress`."""
    parser.description = f"{parser.description}\n\n{EXPLANATION}"
    only = (
        "groups or cases: stiff, radiance, shape, time, broken, recovery, time/cut (default: all)"
    )
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("--only", nargs="+", default=(), metavar="NAME", help=only)
    sample = "the group time, and this share of the other cases, drawn by chance"
    chosen.add_argument("--sample", type=float, metavar="SHARE", help=sample)
    folder = "folder for the table as Markdown, and every number: stress.md, stress.json"
    parser.add_argument("-o", "--output", metavar="DIR", help=folder)
    add_json_option(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the cases; print the table or JSON; write both where asked."""
    from asglight.judging.stress import cases as stress_cases
    from asglight.judging.stress import page as stress_page
    from asglight.judging.stress import run as stress
    from asglight.judging.stress.run import Verdict

    only = arguments.only
    if arguments.sample is not None:
        only = stress_cases.sampled(arguments.sample)
    cases = stress_cases.chosen(only)
    folder = None if arguments.output is None else made_folder(Path(arguments.output))
    tools = tools_at_hand()
    with reporter() as report:
        results = [
            stress.run_case(case, tools) for case in report.follow(cases, "stress", len(cases))
        ]
    command = " ".join(["asglight stress", *(["--only", *only] if only else [])])
    document = stress.as_document(results, tools, command)
    if folder is not None:
        write_text(folder / "stress.md", stress_page.page(results, tools, command))
        write_json(folder / "stress.json", document)
    if arguments.json:
        print_json(document)
    else:
        print_results(results, tools)
    return FAILED if any(result.verdict is Verdict.FAIL for result in results) else 0


def tools_at_hand() -> "Tools":
    """Return the fit and, where there is OpenGL, the viewer's shaders; else why there are none."""
    from asglight.judging.stress.run import Tools
    from asglight.shots import fit_sequence

    try:
        from asglight.viewer.gl.context import standalone_context
        from asglight.viewer.gl.lobe_probe import LobeProbe

        return Tools(fit_sequence, LobeProbe(standalone_context()))
    except ModuleNotFoundError as error:
        why = f"{error.name} is not installed. pip install asglight[view]"
    except InputError as error:
        why = str(error)
    return Tools(fit_sequence, None, why)


def print_results(results: Sequence["Result"], tools: "Tools") -> None:
    """Print a table for each group, the reasons below it, and the count of verdicts."""
    from asglight.judging.stress import page
    from asglight.judging.stress.case import Group

    for group in Group:
        own = [result for result in results if result.case.group is group]
        if not own:
            continue
        is_recovery = group is Group.RECOVERY
        head, *heads, last = page.HEADS
        heads = [*heads, *(page.RECOVERY_HEADS if is_recovery else ())]
        rows: list[list[Any]] = []
        for result in own:
            *row, verdict = page.cells(result)
            rows.append([*row, *(page.recovery_cells(result) if is_recovery else []), verdict])
        print(f"{page.TITLES[group]}\n{table([head, *heads, last], rows)}")
        for result in own:
            for text in page.reasons(result):
                print(f"  {result.case.name}: {text}")
        print()
    print(page.opengl(tools))
    print(page.summary(results))
