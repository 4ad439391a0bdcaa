# SPDX-License-Identifier: Apache-2.0
"""Scripts that are run as files: no name of theirs hides a module that the script imports."""

import ast
from pathlib import Path

import pytest

from tests.support.places import ROOT

SCRIPTS = sorted(
    path for room in ("benchmarks", "dcc", "soak") for path in (ROOT / room).rglob("*.py")
)


def imported(source: str) -> set[str]:
    """Return the top-level names that a source imports."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {name.name.partition(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def test_what_is_imported_is_found() -> None:
    assert imported("import a.b\nfrom c import d\nfrom . import e") == {"a", "c"}


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in SCRIPTS}), ids=lambda each: each.name
)
def test_no_script_hides_a_module_that_its_room_imports(folder: Path) -> None:
    beside = [path for path in SCRIPTS if path.parent == folder]
    names = set().union(*(imported(path.read_text()) for path in beside))
    assert not names & {path.stem for path in beside}
