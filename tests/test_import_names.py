# SPDX-License-Identifier: Apache-2.0
"""Names that a file imports are there. Pyright is not asked, for pxr has no stubs."""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import ROOT

ROOMS = ("asglight", "benchmarks", "dcc", "soak", "website")
ELSEWHERE = ("dcc/blender_render.py", "dcc/mitsuba_render.py", "render.py", "in_tinyusdz.py")
"""Files that run where bpy, mitsuba or tinyusdz are."""


def taken(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the modules of the project, and the names, that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in ROOMS:
            yield from ((node.module or "", name.name) for name in node.names)


def is_there(module: str, name: str) -> bool:
    if hasattr(importlib.import_module(module), name):
        return True
    try:
        importlib.import_module(f"{module}.{name}")
    except ModuleNotFoundError:
        return False
    return True


@pytest.mark.parametrize("room", ROOMS)
def test_imported_names_are_there(room: str) -> None:
    files = [path for path in (ROOT / room).rglob("*.py") if not str(path).endswith(ELSEWHERE)]
    found = {pair for path in files for pair in taken(path)}
    assert len(found) > 3
    assert not sorted(pair for pair in found if not is_there(*pair))


def test_a_name_that_is_not_there_is_told() -> None:
    assert is_there("asglight.lobes", "Lobes")
    assert is_there("asglight", "lobes")
    assert not is_there("asglight.lobes", "Lamps")
