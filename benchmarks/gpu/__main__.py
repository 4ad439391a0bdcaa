# SPDX-License-Identifier: Apache-2.0
r"""Measure everything that asglight does on a GPU, within eight minutes.

    python -m benchmarks.gpu -o gpu-output
    python -m benchmarks.gpu -o gpu-output --device cpu --short     # a trial of the measures

Writes gpu.json and gpu.md after each measure. Exit status: 0 all measures done, 1 one failed or ran
out of time, 2 the device or an option is at fault, 3 all done and a goal missed.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from asglight.cli.folders import made_folder, write_json, write_text
from asglight.cli.options.parser import one_line
from asglight.errors import InputError
from asglight.judging.machine import machine
from benchmarks.gpu.plan import DEADLINE, MEASURES
from benchmarks.gpu.rows import Given
from benchmarks.gpu.running import State, taken
from benchmarks.gpu.table import table


def main(argv: Sequence[str] | None = None) -> int:
    """Take the measures, write what was found, print the table."""
    begin = time.monotonic()
    names = [measure.name for measure in MEASURES]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.gpu",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("-o", "--output", type=Path, default=Path("gpu-output"), metavar="DIR", help="(gpu-output)")
    add("--device", default="cuda", help="where torch computes (cuda)")
    add("--short", action="store_true", help="as little as can be: a trial")
    add("--measures", nargs="+", choices=names, default=names, metavar="NAME", help="(all)")
    add("--maps", type=Path, default=Path("../shared/hdri"), metavar="DIR", help="latlong EXRs")
    add("--sequence", type=Path, default=Path("../shared/sequences/day"), metavar="DIR")
    add("--deadline", type=float, default=DEADLINE, metavar="S", help="seconds in all (480)")
    options = parser.parse_args(argv)
    if options.device.startswith("cuda") and not torch.cuda.is_available():
        parser.error(
            f"--device {options.device}: torch {torch.__version__} finds no CUDA device here; "
            "install a torch built for CUDA and its driver, or try --device cpu --short."
        )
    try:
        folder = made_folder(options.output)
    except InputError as error:
        parser.error(one_line(str(error)))
    given = Given(
        options.device, options.short, options.maps.resolve(), options.sequence.resolve(), 0.0
    )
    document: dict[str, Any] = {
        "device": _device(options.device),
        "short": options.short,
        "machine": machine(),
        "seconds": 0.0,
        "measures": {},
    }
    for measure in (each for each in MEASURES if each.name in options.measures):
        left = options.deadline - (time.monotonic() - begin)
        found = taken(measure, given, left)
        document["measures"][measure.name] = found
        document["seconds"] = round(time.monotonic() - begin, 1)
        last = found["why"].splitlines()[-1] if found["why"] else ""
        said = f"gpu: {measure.name}: {found['state']} after {found['seconds']} s"
        print(f"{said}{': ' + last if last else ''}", file=sys.stderr)
        write_json(folder / "gpu.json", document)
        write_text(folder / "gpu.md", table(document))
    print(table(document), end="")
    return status_of(document)


def status_of(document: dict[str, Any]) -> int:
    """Return the exit status of a run."""
    measures = document["measures"].values()
    if any(measure["state"] != State.DONE for measure in measures):
        return 1
    return 3 if any(row["missed"] for measure in measures for row in measure["rows"]) else 0


def _device(name: str) -> str:
    if not name.startswith("cuda"):
        return name
    found = torch.cuda.get_device_properties(name)
    return f"{found.name}, {found.total_memory / 2**30:.0f} GiB, CUDA {torch.version.cuda}"


if __name__ == "__main__":
    sys.exit(main())
