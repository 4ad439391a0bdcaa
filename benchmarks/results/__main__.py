# SPDX-License-Identifier: Apache-2.0
"""`make results`: every table and picture of the Results pages and of README.md from scratch.

Examples:
    python -m benchmarks.results                      # all of it: many hours
    python -m benchmarks.results keys motion-tunnel   # some parts
    python -m benchmarks.results --list               # the parts, their commands, their minutes
    python -m benchmarks.results --check              # is every number of the pages in a part?
    python -m benchmarks.results --rename             # commands in pages as parts.toml has them
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from asglight.cli.options.parser import Parser, one_line
from asglight.errors import InputError
from benchmarks.results.parts import PARTS_FILE, PLACES, Part, chosen, read_parts
from benchmarks.results.running import PartError, broken, complaints, here, make, renamed

ROOT = Path(__file__).resolve().parents[2]


def main(argv: Sequence[str] | None = None) -> int:
    """Make the parts, or say what they are; 1 where a part failed or a page is wrong."""
    options = _parser().parse_args(argv)
    try:
        return run(options)
    except InputError as error:
        print(f"results: {one_line(str(error))}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m benchmarks.results",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("parts", nargs="*", metavar="PART", help="what to make (default: all)")
    add("--list", action="store_true", help="print the parts and run nothing")
    add("--check", action="store_true", help="look at the pages and run nothing")
    add("--rename", action="store_true", help="write the commands into the pages, run nothing")
    for name, usual in PLACES.items():
        add(f"--{name}", default=usual, metavar="DIR", help=f"(default: {usual})")
    add("-o", "--output", type=Path, default=Path("results-output"), metavar="DIR")
    add("--root", type=Path, default=ROOT, metavar="DIR", help="the repository")
    add("--parts-file", type=Path, default=PARTS_FILE, metavar="TOML", help="what there is to make")
    return parser


def run(options: argparse.Namespace) -> int:
    """Do what the options say."""
    parts = read_parts(options.parts_file)
    wanted = chosen(parts, options.parts)
    if options.list:
        print(
            "\n".join(f"{part.name:<16}{part.minutes:>5g} min  {part.shown()}" for part in wanted)
        )
        return 0
    if options.rename and not broken(options.root):
        renamed(options.root, parts)
    wrong = complaints(options.root, parts)
    if options.check or options.rename or wrong:
        return _said(wrong)
    return _said(made(wanted, options))


def made(wanted: Sequence[Part], options: argparse.Namespace) -> list[str]:
    """Make parts one after the other, and return what failed; the others go on."""
    console = Console(stderr=True, highlight=False)
    where = here(options.root)
    # what a command says of its input is in pages, which know no folders of a machine
    places = {name: os.path.relpath(getattr(options, name), options.root) for name in PLACES}
    failed: list[str] = []
    for number, part in enumerate(wanted, 1):
        console.print(f"{number}/{len(wanted)} {part.name}: {part.shown()}", markup=False)
        try:
            make(part, options.root, places, options.output.resolve() / part.name, where)
        except PartError as error:
            failed.append(f"{part.name}: {error}")
        except InputError as error:
            failed.append(f"{part.name}: {one_line(str(error))}")
    return failed


def _said(wrong: Sequence[str]) -> int:
    for line in wrong:
        print(f"results: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
