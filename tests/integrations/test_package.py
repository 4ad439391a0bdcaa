# SPDX-License-Identifier: Apache-2.0
"""The zip of the Blender extension: what Blender asks of it, and what it must not do."""

import ast
import runpy
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import SimpleNamespace

import pytest

import asglight
from integrations import package

ABSENT = {"socket", "urllib", "http", "requests", "ssl", "torch", "asglight", "OpenEXR"}
"""No network, no torch; asglight is a command of its own."""


def test_the_zip_holds_the_extension_and_its_licence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert package.main(["-o", str(tmp_path)]) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path.parent == tmp_path
    first = path.read_bytes()
    assert package.packed(tmp_path).read_bytes() == first  # the same whenever it is made
    with zipfile.ZipFile(path) as held:
        names = set(held.namelist())
        manifest = tomllib.loads(held.read("blender_manifest.toml").decode())
        assert "GNU GENERAL PUBLIC LICENSE" in held.read("LICENSE").decode()
        init = held.read("__init__.py").decode()
    sources = {p.relative_to(package.FOLDER).as_posix() for p in package.FOLDER.rglob("*.py")}
    assert names == sources | {"blender_manifest.toml", "LICENSE"}
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "network" not in manifest["permissions"]
    assert all(not words.endswith(".") for words in manifest["permissions"].values())
    assert manifest["version"] == asglight.__version__
    line = ["make", "--no-print-directory", "-C", package.FOLDER.parents[1], "-f", "-", "told"]
    told = "include Makefile\ntold: ; @echo $(EXTENSION)\n"
    named = subprocess.run(line, input=told, capture_output=True, text=True, check=True)
    assert named.stdout.strip() == f"dist/{path.name}"
    assert "def register()" in init
    assert "def unregister()" in init


@pytest.mark.parametrize("source", sorted(package.FOLDER.rglob("*.py")), ids=lambda p: p.name)
def test_every_file_is_free_and_talks_to_nobody(source: Path) -> None:
    text = source.read_text()
    assert text.startswith("# SPDX-License-Identifier: GPL-3.0-or-later\n")
    names = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    assert not names & ABSENT
    if source.parent.name == "plain":
        assert not names & {"bpy", "bpy_extras", "mathutils"}


def test_a_blender_without_usd_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    blender = SimpleNamespace(app=SimpleNamespace(usd=SimpleNamespace(supported=False)))
    monkeypatch.setitem(sys.modules, "bpy", blender)
    with pytest.raises(ImportError, match="asglight: this Blender was built without USD; expected"):
        runpy.run_path(str(package.FOLDER / "registration.py"))
