# SPDX-License-Identifier: Apache-2.0
"""Fit each map with `fast` and with the EM peer, on one thread; print a Markdown table.

    python benchmarks/maps.py ../shared/hdri/*.exr

Each cell is `ours / EM`; the last column is CPU seconds of the fit.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit_first_frame
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong
from asglight.judging.metrics import METRIC_NAMES, frame_errors
from asglight.lobes import Form, Lobes
from asglight.peers import vmf_em


def judged(fit: Callable[[Tensor], Lobes], reference: Tensor) -> list[float]:
    """Return the errors of a method on a map, and its CPU seconds."""
    before = time.process_time()
    lobes = fit(reference)
    seconds = time.process_time() - before
    return [*frame_errors(lobes, reference).values.values(), seconds]


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
        ours = judged(lambda r: fit_first_frame(r, options.lobes, Form.ASG).lobes, reference)
        peer = judged(lambda r: vmf_em.fit(r, options.lobes), reference)
        digits = [3, 4, 4, 4, 4, 3, 1]
        cells = [f"{a:.{n}f} / {b:.{n}f} |" for a, b, n in zip(ours, peer, digits, strict=True)]
        print(f"| {path.stem} |", *cells, flush=True)


if __name__ == "__main__":
    main()
