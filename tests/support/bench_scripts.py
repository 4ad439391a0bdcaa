# SPDX-License-Identifier: Apache-2.0
"""The scripts and rooms of benchmarks/ as modules."""

import importlib
import sys
from typing import Any

import pytest
from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


def module(name: str) -> Any:
    """Import a module of a room of benchmarks/, `gpu.table`; skip as `script`."""
    if not BENCHMARKS.is_dir():
        pytest.skip("benchmarks/ is in the repository alone", allow_module_level=True)
    return importlib.import_module(f"benchmarks.{name}")


def script(name: str) -> Any:
    """Import a script; skip the tests of the importing file where benchmarks/ is not."""
    if not BENCHMARKS.is_dir():
        pytest.skip("benchmarks/ is in the repository alone", allow_module_level=True)
    # for as long as it takes: a script there has the name of one in the repository's root
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BENCHMARKS))
