# SPDX-License-Identifier: Apache-2.0
"""The architecture as ARCHITECTURE.md draws it: which room may import which."""

import ast
import functools
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from places import ROOT

PACKAGE = ROOT / "asglight"

ALLOWED = {
    "sphere": set(),
    "lobes": {"sphere"},
    "shading": {"sphere", "lobes"},
    "fitting": {"sphere", "lobes", "shading"},
    "images": {"sphere"},
    "keys": {"sphere", "lobes", "shading"},
    "usd": {"sphere", "lobes", "images"},
    "peers": {"sphere", "lobes"},
    "sky": {"sphere", "images"},
    "judging": {"sphere", "lobes", "shading", "fitting", "images", "keys", "usd", "peers"},
    "shots": {"sphere", "lobes", "fitting", "images", "keys", "usd"},
    "arrays": {"sphere", "lobes", "shading", "fitting", "images", "judging", "shots"},
    "export": {"sphere", "lobes", "shading", "images"},
    "viewer": {"sphere", "lobes", "shading", "usd", "images"},
    "page": {"sphere", "lobes", "shading", "images", "judging", "viewer"},
    "cli": {"sphere", "lobes", "shading", "fitting", "images", "usd", "peers", "judging", "sky"}
    | {"shots", "arrays", "export", "viewer", "page", "keys"},
}
"""Every room may also import asglight.errors, asglight.luminance, asglight.shader_files,
asglight.threads, asglight.c_library, and asglight itself (for its version)."""

ONLY_IN = {"pxr": {"usd"}, "moderngl": {"viewer"}, "imgui_bundle": {"viewer"}}

FILES_MAX = 17
"""Python files of a folder."""

FARM = PACKAGE / "shots" / "parts" / "farm.py"
"""The one file that knows Dask, which few users have."""


@functools.cache
def tree_of(source: Path) -> ast.Module:
    return ast.parse(source.read_text())


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield every statement, also inside functions: expressions hold none."""
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        for statement in getattr(node, field, ()):
            yield statement
            yield from statements(statement)


@functools.cache
def imported_modules(source: Path) -> set[str]:
    """Return the dotted names of every import statement, also inside functions."""
    names: set[str] = set()
    for node in statements(tree_of(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{source}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def sources() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room(source: Path) -> str | None:
    parts = source.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else None


@pytest.mark.parametrize("source", sources(), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_room_imports_only_the_rooms_it_may(source: Path) -> None:
    own = room(source)
    for name in imported_modules(source):
        top, *rest = name.split(".")
        if top in ONLY_IN:
            assert own in ONLY_IN[top], f"{source.name} imports {top}"
        if top == "asglight" and rest and (PACKAGE / rest[0]).is_dir() and own is not None:
            assert rest[0] == own or rest[0] in ALLOWED[own], f"{source.name} imports {name}"


def test_one_file_knows_dask_and_only_the_command_line_knows_that_file() -> None:
    for source in sources():
        names = imported_modules(source)
        tops = {name.partition(".")[0] for name in names}
        assert source == FARM or not {"dask", "distributed"} & tops, source
        uses = any(name.startswith("asglight.shots.parts.farm") for name in names)
        assert not uses or room(source) == "cli", source


def test_every_room_has_its_rule() -> None:
    rooms = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").is_file()}
    assert rooms <= ALLOWED.keys()


def test_the_table_of_the_architecture_is_what_is_held() -> None:
    rows = re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", (ROOT / "ARCHITECTURE.md").read_text(), re.M)
    said = {name: set(re.findall(r"\w+", may)) for name, may in rows}
    assert said.pop("cli") == {"all"}
    assert ALLOWED["cli"] == said.keys()
    assert said == {name: may for name, may in ALLOWED.items() if name != "cli"}


def test_files_do_not_import_each_other_in_a_circle() -> None:
    """When they are loaded; what is imported where it is used is no circle."""
    modules = {_module(source): source for source in sources()}
    needs = {
        module: {
            name if name in modules else name.rpartition(".")[0]
            for statement in tree_of(source).body
            if isinstance(statement, ast.ImportFrom)
            for name in (f"{statement.module}.{alias.name}" for alias in statement.names)
        }
        for module, source in modules.items()
    }
    order = TopologicalSorter({m: n & modules.keys() - {m} for m, n in needs.items()})
    # raises CycleError, which names the circle
    assert set(order.static_order()) == modules.keys()


def _module(source: Path) -> str:
    parts = source.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_a_folder_holds_what_a_newcomer_can_take_in() -> None:
    """About sixteen files; the command line's shared parts are the most."""
    count = {folder: len(list(folder.glob("*.py"))) for folder in (*PACKAGE.rglob("*/"), PACKAGE)}
    assert max(count.values()) <= FILES_MAX, max(count, key=lambda folder: count[folder])
