# SPDX-License-Identifier: Apache-2.0
"""A record of the bench as bench.json holds it, with round numbers and in no time."""

from typing import Any

from asglight.judging.bench.plan import CROWDED
from asglight.judging.bench.power_law import power_law

METRICS = ("env", "flux", "irr", "irrMax", "r0.5", "r0.25")


def point(steps: int, seconds: float, error: float) -> dict[str, float]:
    times = {"wall_seconds": 2 * seconds, "cpu_seconds": seconds}
    return {"steps": steps} | times | {"energy": 1.0} | dict.fromkeys(METRICS, error)


def fit(method: str, lobes: int, *points: dict[str, float], published: int = 0) -> dict[str, Any]:
    return {
        "method": method,
        "title": method,
        "lobes": lobes,
        "floats": 8 * lobes,
        "published_steps": published,
        "peak_bytes": 1_000_000 * lobes,
        "points": list(points),
    }


def grown(sizes: list[int], seconds: list[float]) -> dict[str, Any]:
    law = power_law(sizes, seconds)
    return {
        "sizes": sizes,
        "cpu_seconds": seconds,
        "peak_bytes": [None] * len(sizes),
        "law": None if law is None else vars(law),
    }


def still(name: str = "sky") -> dict[str, Any]:
    """Return the record of a map: fast at 2 and 15 lobes, best, the paper, EM and harmonics."""
    sizes, seconds = [10, 100, 1000], [1.0, 2.0, 4.0]
    frames = {"live, a next frame": grown(sizes, seconds) | {"r0.25": [0.1, 0.1, 0.2]}}
    return {
        "name": name,
        "path": f"{name}.exr",
        "frames": [7],
        "rows": 16,
        "columns": 32,
        "mean_radiance": 0.5,
        "lobes": 15,
        "floats": 120,
        "fits": [
            fit("fast", 2, point(9, 0.5, 0.5)),
            fit("fast", 15, point(1, 0.5, 0.5), point(9, 2.0, 0.02)),
            fit("best", 15, point(1, 1.0, 0.6), point(90, 8.0, 0.01)),
            fit("paper", 15, point(60, 4.0, 0.8), point(240, 16.0, 0.3), published=24_000),
            fit("em", 15, point(0, 1.0, 0.04)),
            fit("sh", 15, point(0, 0.1, 0.2)),
        ],
        "races": {"fast": [2.0, 2.2, 2.1], "em": [1.0, 1.1, 1.2], CROWDED: [8.0, 9.0, 8.4]},
        "scaling": {
            "texels": {
                "unit": "texels",
                "source_columns": 32,
                "methods": {"fast": grown(sizes, seconds) | {"peak_bytes": [10, 20, 30]}},
            },
            "lobes": {"unit": "lobes", "methods": {"fast": grown([2, 15], [0.5, 2.0])}},
            "frames": {"unit": "frames", "methods": frames, "peak_bytes": None},
        },
    }


def sequence(name: str = "shot", frames: tuple[int, ...] = (7, 8, 9)) -> dict[str, Any]:
    """Return the record of a sequence."""
    errors = {"live": 0.03, "fast": 0.02, "best": 0.01, "independent": 0.02, "em": 0.04}
    methods = {
        method: {
            "title": method,
            "wall_seconds": [2.0, *[1.0] * (len(frames) - 1)],
            "cpu_seconds": [2.0, *[0.5] * (len(frames) - 1)],
            "next_cpu_seconds": 0.5,
            "peak_bytes": None,
            "jumps": 0,
            "errors": {metric: [error] * len(frames) for metric in METRICS},
            "mean": dict.fromkeys((*METRICS, "flicker"), error),
        }
        for method, error in (errors | {"paper": 0.5}).items()
    }
    own = {"frames": list(frames), "sequence": {"paper_steps": [240, 60], "methods": methods}}
    return still(name) | own


def document(*records: dict[str, Any]) -> dict[str, Any]:
    machine = {"processor": "a chip", "cores": 2, "load": 0.1, "torch": "2", "python": "3"}
    return {
        "asglight_bench": 1,
        "version": "0",
        "command": "asglight bench sky.exr",
        "effort": "quick",
        "lobes": 15,
        "paper_steps": 240,
        "machine": machine,
        "inputs": list(records),
    }
