# SPDX-License-Identifier: Apache-2.0
"""Fit each map with `fast` on one thread; print its errors and CPU seconds as a Markdown table.

python benchmarks/maps.py ../shared/hdri/*.exr
"""

import argparse
import time
from pathlib import Path

import torch

from asglight.fitting.first_frame import fit_first_frame
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong
from asglight.judging.metrics import METRIC_NAMES, frame_errors
from asglight.lobes import Form


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("maps", type=Path, nargs="+")
    parser.add_argument("--lobes", type=int, default=15)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| map |", *(f"{name} |" for name in METRIC_NAMES), "CPU s |")
    print("|---|" + "---|" * (len(METRIC_NAMES) + 1))
    for path in options.maps:
        reference = read_latlong(path, height=FIT_HEIGHT).radiance
        before = time.process_time()
        lobes = fit_first_frame(reference, options.lobes, Form.ASG).lobes
        seconds = time.process_time() - before
        values = frame_errors(lobes, reference).values
        cells = [f"{values[name]:.4f} |" for name in METRIC_NAMES]
        print(f"| {path.stem} |", *cells, f"{seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
