# SPDX-License-Identifier: Apache-2.0
r"""Measure whole commands as ratios of times of one run, and hold them against the baseline.

    python -m benchmarks.command -o command-output
    python -m benchmarks.command -o command-output --bless          # write the baseline anew

Writes command.json, with wall and processor seconds and peak memory of every run, and prints a
table. Exit status: 0 done, 1 a command failed, 2 an option or the baseline is at fault, 3 a ratio
is worse than the baseline's by more than the gate allows.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from asglight.cli.folders import made_folder, write_json
from asglight.cli.options.parser import one_line
from asglight.errors import InputError
from asglight.judging.machine import machine
from benchmarks.command import gate
from benchmarks.command.measures import RATIOS, SHORT, Found, Sizes, measured, ratios
from benchmarks.command.runs import CommandFailed

BASELINE = Path(__file__).with_name("baseline.json")


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write, compare."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.command",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("-o", "--output", type=Path, default=Path("command-output"), metavar="DIR")
    add("--baseline", type=Path, default=BASELINE, metavar="FILE", help="(that of this folder)")
    add("--bless", action="store_true", help="write the baseline anew instead of comparing")
    add(
        "--times",
        type=int,
        default=3,
        metavar="N",
        help="runs of each command, of which the least counts (3)",
    )
    add("--short", action="store_true", help="as little as can be: a trial")
    options = parser.parse_args(argv)
    if options.times < 1:
        parser.error(f"--times: {options.times}; expected 1 or more")
    if options.bless and options.short and options.baseline.resolve() == BASELINE.resolve():
        parser.error(
            "--bless: --short would put a trial in place of the baseline; expected one of the two, "
            "or --baseline FILE"
        )
    sizes = SHORT if options.short else Sizes(times=options.times)
    before: dict[str, float] = {}
    try:
        if not options.bless:  # before any time is spent
            before = gate.read(options.baseline, list(RATIOS), sizes.as_json())
        output = made_folder(options.output)
    except InputError as error:
        parser.error(one_line(str(error)))
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        try:
            found = measured(Path(folder), sizes)
        except CommandFailed as error:
            print(f"command: {one_line(str(error))}", file=sys.stderr)
            return 1
    now = ratios(found)
    runs = {name: [run.as_json() for run in own] for name, own in found.items()}
    document = {"machine": machine(), "short": options.short, "ratios": now, "commands": runs}
    write_json(output / "command.json", document)
    print(table(found, now, before))
    if options.bless:
        write_json(options.baseline, gate.as_baseline(now, sizes.as_json()))
        return 0
    lines = gate.worse(before, now)
    print("".join(f"worse: {line}\n" for line in lines), end="")
    return 3 if lines else 0


def table(found: Found, now: Mapping[str, float], before: Mapping[str, float]) -> str:
    """Return a table of the ratios and one of the commands, as Markdown."""
    lines = ["| ratio | now | baseline |", "|---|--:|--:|"]
    for name, value in now.items():
        earlier = f"{before[name]:.2f}" if name in before else "–"
        lines.append(f"| {name} | {value:.2f} | {earlier} |")
    lines += ["", "| command | wall, s | CPU, s | peak, MB |", "|---|--:|--:|--:|"]
    for name, own in found.items():
        least = min(own, key=lambda run: run.wall)
        peak = max(run.peak for run in own) / 1e6
        lines.append(f"| {name} | {least.wall:.2f} | {least.cpu:.2f} | {peak:.0f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
