# SPDX-License-Identifier: Apache-2.0
"""What the arrays of PhySG and NeRD keep of a fit: errors against the map, before and in the array.

    python -m benchmarks.stages.sg_arrays ../shared/hdri/lobby.exr

Each map is fitted as `asg` and as `sg` with `fast`; both are brought into the arrays of both
programs (asglight/export/sg_array.py) and judged as fits are.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from torch import Tensor

from asglight.export.sg_array import SgLayout, as_shown
from asglight.fitting.options import LOBES, FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form, Lobes
from benchmarks.given import read_map, refused_in_a_line

SHOWN = ("env", "irr", "r0.5", "r0.25")
CALLED = {SgLayout.PHYSG: "PhySG's array", SgLayout.NERD: "NeRD's array"}


def main(argv: Sequence[str] | None = None) -> int:
    """Fit every map in both forms and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.stages.sg_arrays", description=__doc__
    )
    parser.add_argument("maps", nargs="+", type=Path, metavar="IMAGE", help="latlong maps")
    parser.add_argument("--lobes", type=int, default=LOBES, metavar="N", help=f"({LOBES})")
    options = parser.parse_args(argv)
    print(f"| map | fitted as | shown by | {' | '.join(SHOWN)} |")
    print(f"|{' --- |' * 3}{' ---: |' * len(SHOWN)}")
    for path in options.maps:
        with refused_in_a_line(parser):
            reference = read_map(path)
        for form in (Form.ASG, Form.SG):
            lobes = fit_frame(reference, FitOptions(options.lobes, form=form), None).lobes
            for name, errors in rows(lobes, reference):
                print(f"| {path.stem} | {form} | {name} | {' | '.join(errors)} |", flush=True)
    return 0


def rows(lobes: Lobes, reference: Tensor) -> Iterator[tuple[str, list[str]]]:
    """Judge lobes as they are, and as each array holds them.

    Args:
        lobes: Of one frame.  [N, .]
        reference: Repaired radiance.  [H, W, 3]
    """
    shown = {"the fit": lobes} | {name: as_shown(lobes, one) for one, name in CALLED.items()}
    for name, held in shown.items():
        errors = frame_errors(held, reference).values
        yield name, [f"{errors[metric]:.4f}" for metric in SHOWN]


if __name__ == "__main__":
    raise SystemExit(main())
