# SPDX-License-Identifier: Apache-2.0
"""Files and functions that are read at one go: CONTRIBUTING's limits."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import ROOT

FILE_LINES, FUNCTION_LINES = 400, 70
"""Neither is reached; a docstring counts."""

ROOMS = ("asglight", "benchmarks", "dcc", "examples", "integrations", "soak", "tests", "website")


def sources() -> list[Path]:
    return [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]


def functions_of(node: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Yield functions in statements: expressions, most of a tree, hold none."""
    for field in ("body", "orelse", "finalbody", "handlers", "cases"):
        for statement in getattr(node, field, ()):
            if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
                yield statement
            yield from functions_of(statement)


def too_long(name: str, text: str) -> Iterator[str]:
    """Yield what of a file is over the limits."""
    if (lines := len(text.splitlines())) >= FILE_LINES:
        yield f"{name}: {lines} lines"
    if lines < FUNCTION_LINES:  # nor is a function
        return
    for node in functions_of(ast.parse(text)):
        assert node.end_lineno is not None
        if (lines := node.end_lineno - node.lineno + 1) >= FUNCTION_LINES:
            yield f"{name}: {node.name}: {lines} lines"


def test_no_file_and_no_function_is_too_long() -> None:
    found = {str(path.relative_to(ROOT)): path.read_text() for path in sources()}
    assert len(found) > 500
    assert not [line for name, text in found.items() for line in too_long(name, text)]


@pytest.mark.parametrize(
    ("text", "over"),
    [
        ("x = 1\n" * 399, []),
        ("x = 1\n" * 400, ["a.py: 400 lines"]),
        ("def f():\n" + "    pass\n" * 68, []),
        ("class A:\n  async def f(self):\n" + "    pass\n" * 69, ["a.py: f: 70 lines"]),
        ("if 1:\n  pass\nelse:\n  def f():\n" + "    pass\n" * 69, ["a.py: f: 70 lines"]),
        (
            "try:\n  pass\nexcept A:\n  def f():\n" + "    pass\n" * 69,
            ["a.py: f: 70 lines"],
        ),
        ('def f():\n    """One.\n' + "\n" * 67 + '    """\n', ["a.py: f: 70 lines"]),
    ],
)
def test_what_is_too_long_is_found(text: str, over: list[str]) -> None:
    assert list(too_long("a.py", text)) == over
