# SPDX-License-Identifier: Apache-2.0
"""The rooms of benchmarks/ as modules."""

import importlib
import subprocess
from types import SimpleNamespace
from typing import Any

import pytest
from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


def module(name: str) -> Any:
    """Import a module of a room of benchmarks/, `gpu.table`; skip where benchmarks/ is not."""
    if not BENCHMARKS.is_dir():
        pytest.skip("benchmarks/ is in the repository alone", allow_module_level=True)
    return importlib.import_module(f"benchmarks.{name}")


def float32_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `steps/rounding.py` do in this process what needs no arithmetic but the usual."""
    worker = module("steps.rounding_worker")

    def run(words: list[str], **options: Any) -> None:
        arguments = words[words.index("benchmarks.steps.rounding_worker") + 1 :]
        if arguments[0] == "float32":
            worker.main(arguments)
        else:
            subprocess.run(words, **options)

    monkeypatch.setattr(module("steps.rounding"), "subprocess", SimpleNamespace(run=run))
