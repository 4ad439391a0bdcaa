# SPDX-License-Identifier: Apache-2.0
"""Flat lobes beside asg lobes of the same eight numbers: docs/results/parts-of-a-fit.md.

    python -m benchmarks.steps.flat_tops ../shared/hdri/*.exr

Each map is fitted with `fast` as asg, as flat, and as whichever it chooses (--form auto). One line
each: what was chosen, J, the errors of docs/results/measures.md, CPU seconds.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import torch

from asglight.fitting.options import AUTO, LOBES, FitOptions, form_of
from asglight.fitting.sequence import fit_frame
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form
from benchmarks.given import read_map, refused_in_a_line

SHOWN = ("env", "irr", "r0.5", "r0.25")
ASKED = (str(Form.ASG), str(Form.FLAT), AUTO)


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map three ways and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.steps.flat_tops", description=__doc__
    )
    parser.add_argument("maps", nargs="+", type=Path, metavar="IMAGE", help="latlong maps")
    parser.add_argument("--lobes", type=int, default=LOBES, metavar="N", help=f"({LOBES})")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    print(f"| map | asked | form | J | {' | '.join(SHOWN)} | CPU s |")
    print(f"|{' --- |' * 3}{' ---: |' * (2 + len(SHOWN))}")
    for path in options.maps:
        with refused_in_a_line(parser):
            reference = read_map(path)
        for name in ASKED:
            start = time.process_time()
            fit = fit_frame(reference, FitOptions(options.lobes, form=form_of(name)), None)
            spent = time.process_time() - start
            errors = frame_errors(fit.lobes, reference).values
            cells = [f"{errors[metric]:.4f}" for metric in SHOWN]
            row = [path.stem, name, fit.lobes.form, f"{fit.loss:.4f}", *cells, f"{spent:.1f}"]
            print(f"| {' | '.join(row)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
