# SPDX-License-Identifier: Apache-2.0
"""The machine that `fit.py` runs on."""

import os
import platform
import sys
from pathlib import Path
from typing import Any

import torch

OPENMP_SETTINGS = ("OMP_NUM_THREADS", "OMP_WAIT_POLICY", "GOMP_SPINCOUNT")
"""Environment variables that change how long small steps take."""

BUSY_LOAD = 0.5
"""Load for each core above which others are at work: one core of two."""


def machine() -> dict[str, Any]:
    """Return what the seconds depend on."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "openmp": {name: os.environ[name] for name in OPENMP_SETTINGS if name in os.environ},
        "python": platform.python_version(),
        "system": platform.platform(),
    }


def warn_where_busy(at: dict[str, Any]) -> None:
    """Say so where other programs run: two threads of which one must wait run at a crawl."""
    if at["load"] > BUSY_LOAD * at["cores"]:
        print(
            f"bench-fit: load {at['load']} on {at['cores']} cores: times will be too long. Wait, "
            "or give --threads 1.",
            file=sys.stderr,
        )


def _processor() -> str:
    """Return the model of the processor; Linux tells it in /proc alone."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()
