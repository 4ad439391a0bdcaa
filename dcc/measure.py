# SPDX-License-Identifier: Apache-2.0
"""Render exported stages in Blender's Cycles and Mitsuba 3 and hold them against the integrals.

Tables go to standard output, all numbers to dcc.json in the output folder, progress to standard
error. The exit status is 1 where a row is above its limit, 2 where something is missing.
"""

import argparse
import json
import sys
from collections.abc import Sequence

import torch

from asglight.errors import InputError
from dcc import in_blender, in_mitsuba, rows, shots, tables


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write and print; return the exit status."""
    parser = shots.parser("dcc", __doc__, "dcc-output")
    parser.add_argument("--frames", type=int, default=3, metavar="N", help="of a sequence (3)")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)  # the renderers have the cores
    try:
        return run(options)
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2


def run(options: argparse.Namespace) -> int:
    """Measure as the options say."""
    output = options.output
    output.mkdir(parents=True, exist_ok=True)
    if options.short:
        chosen = [shots.built_in(output)]
    else:
        chosen = shots.from_sequences(options.sequences, options.frames, output)
    task = in_blender.Task(chosen, output, options.size, options.samples)
    in_blender.render(task)
    balls, facing = in_blender.judged(task)
    versions = {"Blender": in_blender.version(task)}
    if not options.short:
        in_mitsuba.render(task)
        balls += in_mitsuba.judged(task)
        versions["Mitsuba"] = in_mitsuba.version(task)
    document = {
        "size": options.size,
        "samples": options.samples,
        "versions": versions,
        **rows.as_json(balls, facing),
    }
    (output / "dcc.json").write_text(json.dumps(document, indent=1) + "\n")
    print(tables.markdown(balls, facing))
    failed = rows.failures(balls, facing)
    for line in failed:
        print(f"dcc: {line}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
