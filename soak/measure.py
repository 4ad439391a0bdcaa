# SPDX-License-Identifier: Apache-2.0
"""Fuzz, faults and scale one after the other, bounded, as one page and one JSON file.

python -m soak.measure -o soak-output
python -m soak.measure --short -o soak-output       # a hundredth of it, in a minute
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from asglight.cli.folders import write_text
from soak import faults, fuzz, scale

FILES = 100_000
KILLS = 50
OTHERS = 10
MINUTES = 15.0
"""Of fuzzing at most; on two idle cores faults take three minutes and scale ten."""

SHARES = {"files": 0.01, "kills": 0.08, "others": 0.1}
"""Of each that the short form does."""

Found = TypeVar("Found")


@dataclass(frozen=True)
class Took:
    """What a part took.

    Attributes:
        part: Its title.
        seconds: On the wall.
        cpu_seconds: Of this process and of those that it waited for.
    """

    part: str
    seconds: float
    cpu_seconds: float


class Parts:
    """Parts done one after the other, each told of when it ends."""

    def __init__(self) -> None:
        """Begin with none."""
        self.took: list[Took] = []

    def done(self, part: str, do: Callable[[], Found]) -> Found:
        """Do a part."""
        begin, cpu = time.monotonic(), _cpu_seconds()
        found = do()
        self.took.append(Took(part, time.monotonic() - begin, _cpu_seconds() - cpu))
        print(f"{_line(self.took[-1])}.", file=sys.stderr, flush=True)
        return found


def _line(took: Took) -> str:
    return f"{took.part}: {took.seconds:.0f} s, {took.cpu_seconds:.0f} s of processor time"


def _cpu_seconds() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def measure(output: Path, *, short: bool, seed: int) -> dict[str, Any]:
    """Do everything, and return what was found as JSON values, with the page under `page`."""
    output.mkdir(parents=True, exist_ok=True)
    share = SHARES if short else dict.fromkeys(SHARES, 1.0)
    begin, parts = time.monotonic(), Parts()
    files, kills, others = (
        int(whole * share[name])
        for name, whole in (("files", FILES), ("kills", KILLS), ("others", OTHERS))
    )
    found = parts.done("Damaged files", lambda: fuzz.fuzz_all(files, seed, output, MINUTES, jobs=2))
    told = parts.done("Faults", lambda: faults.faults(output / "faults", kills, others, seed))
    rows, failed = (
        ([], []) if short else parts.done("Scale", lambda: _scale_or_why(output / "scale"))
    )
    wrong = [line for one in found for line in one.wrong()]
    wrong += [line for one in told for line in one.wrong] + failed
    tables = {"Damaged files": fuzz.as_table(found), "Faults": faults.as_table(told)}
    if rows:
        tables["Scale"] = scale.as_table(rows)
    page = "\n\n".join(f"## {title}\n\n{table}" for title, table in tables.items())
    lines = "\n".join(f"- {_line(each)}" for each in parts.took)
    return {
        "page": f"# Soak, seed {seed}, {time.monotonic() - begin:.0f} s\n\n{lines}\n\n{page}\n",
        "took": [vars(each) for each in parts.took],
        "fuzz": [vars(one) for one in found],
        "faults": [vars(one) for one in told],
        "scale": [vars(row) for row in rows],
        "wrong": wrong,
    }


def _scale_or_why(folder: Path) -> tuple[list[scale.Measured], list[str]]:
    """Return the measurements of scale; none and why where one failed, so that the rest is kept."""
    try:
        return scale.scale(folder), []
    except RuntimeError as error:
        return [], [str(error)]


def main() -> int:
    """Do everything, write it, and tell by the exit status whether something is wrong."""
    parser = argparse.ArgumentParser(description="Fuzz, faults and scale, bounded.")
    parser.add_argument("--short", action="store_true", help="a little of each, without scale")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path("soak-output"))
    arguments = parser.parse_args()
    document = measure(arguments.output, short=arguments.short, seed=arguments.seed)
    write_text(arguments.output / "soak.md", document.pop("page"))
    write_text(arguments.output / "soak.json", json.dumps(document, indent=1))
    print((arguments.output / "soak.md").read_text())
    for line in document["wrong"]:
        print(f"wrong: {line}", file=sys.stderr)
    return 1 if document["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main())
