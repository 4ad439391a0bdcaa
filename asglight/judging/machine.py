# SPDX-License-Identifier: Apache-2.0
"""The machine that a measurement runs on."""

import os
import platform
from pathlib import Path
from typing import Any

import torch

from asglight.fitting import compiled

OPENMP_SETTINGS = ("OMP_NUM_THREADS", "OMP_WAIT_POLICY", "GOMP_SPINCOUNT")
"""Environment variables that change how long small steps take."""


def machine() -> dict[str, Any]:
    """Return what the seconds depend on."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "threads": torch.get_num_threads(),
        "steps": "torch" if compiled.LIBRARY is None else "compiled",
        "torch": torch.__version__,
        "openmp": {name: os.environ[name] for name in OPENMP_SETTINGS if name in os.environ},
        "python": platform.python_version(),
        "system": platform.platform(),
    }


def _processor() -> str:
    """Return the model of the processor; Linux tells it in /proc alone."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()
