# SPDX-License-Identifier: Apache-2.0
"""The growth that `asglight bench --full` measures, without its other hours: docs/results/bench.md.

    python -m benchmarks.steps.growth ../shared/hdri/lobby.exr -o growth.json

Two parts. `texels`: `fast`, a next frame of `live`, and EM on the map at 64 to 4,096 columns.
`frames`: `live` on 10,000 frames, each turned by one texel more than the one before. Seconds are
CPU seconds of one thread.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from torch import Tensor

from asglight.cli.folders import write_text
from asglight.cli.progress import reporter
from asglight.judging.bench import scaling as bench_scaling
from asglight.judging.bench.plan import Effort, Plan, plan_of
from asglight.judging.compare.maps import Follow
from benchmarks.given import read_map, refused_in_a_line

Account = dict[str, Any]


def texels(path: Path, plan: Plan, follow: Follow) -> Account:
    """Measure by size: coarser maps are averages of the file, in finer ones its texels split."""
    source = read_map(path, max(plan.widths) // 2)
    return bench_scaling.by_texels(source, plan, follow)


def frames(path: Path, plan: Plan, follow: Follow) -> Account:
    """Measure by length, at the size that is fitted."""
    still: list[Tensor] = [read_map(path)]
    return bench_scaling.by_frames(still, plan, follow)


PARTS: dict[str, Callable[[Path, Plan, Follow], Account]] = {"texels": texels, "frames": frames}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print a table of each part, and write JSON after each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.steps.growth", description=__doc__)
    add = parser.add_argument
    add("map", type=Path, metavar="IMAGE", help="a latlong map")
    add("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="what (default: all)")
    add("-o", "--output", type=Path, metavar="FILE", help="the same numbers as JSON")
    options = parser.parse_args(argv)
    found: dict[str, Account] = {}
    with refused_in_a_line(parser), reporter() as report:
        for part in options.parts:
            found[part] = PARTS[part](options.map, plan_of(Effort.FULL), report.follow)
            if options.output is not None:
                write_text(options.output, json.dumps(found, indent=1) + "\n")
    print("\n\n".join(table(account) for account in found.values()))
    return 0


def table(account: Account) -> str:
    """Return a column a size: seconds and megabytes of each method, and what it grows with."""
    methods = account["methods"]
    sizes = next(iter(methods.values()))["sizes"]
    lines = [f"| {account['unit']} | {' | '.join(f'{size:,}' for size in sizes)} | exponent |"]
    lines.append(f"|---|{'--:|' * (len(sizes) + 1)}")
    for name, measured in methods.items():
        law = measured["law"]
        seconds = [f"{value:.2f}" for value in measured["cpu_seconds"]]
        slope = "–" if law is None else f"{law['exponent']:.2f} ± {law['standard_error']:.2f}"
        lines.append(f"| {name}, CPU s | {' | '.join(seconds)} | {slope} |")
        if any(measured["peak_bytes"]):
            known = measured["peak_bytes"]
            peaks = ["–" if peak is None else f"{peak / 1e6:.0f}" for peak in known]
            lines.append(f"| {name}, peak MB | {' | '.join(peaks)} | |")
        if "r0.25" in measured:
            drift = [f"{error:.4f}" for error in measured["r0.25"]]
            lines.append(f"| {name}, r0.25 | {' | '.join(drift)} | |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
