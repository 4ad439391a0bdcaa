# SPDX-License-Identifier: Apache-2.0
"""The rooms of benchmarks/ as modules."""

import importlib
from typing import Any

import pytest
from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


def module(name: str) -> Any:
    """Import a module of a room of benchmarks/, `gpu.table`; skip where benchmarks/ is not."""
    if not BENCHMARKS.is_dir():
        pytest.skip("benchmarks/ is in the repository alone", allow_module_level=True)
    return importlib.import_module(f"benchmarks.{name}")
