# SPDX-License-Identifier: Apache-2.0
"""Run the paper's recipe on one map to the end and record its loss against time.

    python benchmarks/paper_curve.py lobby.exr benchmarks/paper_lobby.json

The JSON holds rows (step, CPU seconds, wall seconds, loss), the final metrics and the final loss:
the base line of every speed figure.
"""

import argparse
import json
import time
from pathlib import Path

import torch

from asglight.fitting import paper
from asglight.fitting.options import FIT_HEIGHT
from asglight.images import read_latlong
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form


def recorded(step: int) -> bool:
    """Tell whether a step belongs in the curve: every one early, every hundredth later."""
    return step <= 10 or (step <= 1000 and step % 10 == 0) or step % 100 == 0


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--lobes", type=int, default=15)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=paper.FIRST_FRAME_STEPS)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    reference = read_latlong(options.map, height=FIT_HEIGHT).radiance
    start = paper.start(reference, options.lobes, Form.ASG, options.seed)
    rows: list[tuple[int, float, float, float]] = []
    cpu, wall = time.process_time(), time.perf_counter()

    def on_step(step: int, loss: float) -> None:
        if recorded(step):
            seconds = time.process_time() - cpu, time.perf_counter() - wall
            rows.append((step, round(seconds[0], 3), round(seconds[1], 3), loss))
        if step % 1000 == 0:
            print(f"step {step}/{options.steps}  loss {loss:.5f}", flush=True)

    lobes = paper.fit_frame(reference, start, steps=options.steps, on_step=on_step)
    result = {
        "map": options.map.name,
        "lobes": options.lobes,
        "seed": options.seed,
        "threads": options.threads,
        "torch": torch.__version__,
        "columns": ["step", "cpu_seconds", "wall_seconds", "loss"],
        "curve": rows,
        "loss": float(paper.frame_loss(lobes, paper.target(reference))),
        "metrics": frame_errors(lobes, reference).values,
    }
    options.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
