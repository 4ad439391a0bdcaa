# SPDX-License-Identifier: Apache-2.0
"""The wheel holds what an installed asglight needs beside its modules."""

import subprocess
import sys
import zipfile
from pathlib import Path

from places import ROOT


def test_the_wheel_holds_shaders_schema_and_viewer(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, ROOT],
        check=True,
        capture_output=True,
    )
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    shaders = {f"asglight/{path.relative_to(ROOT)}" for path in (ROOT / "shaders").rglob("*.*")}
    schema = {
        f"asglight/usd/resources/{name}"
        for name in ("plugInfo.json", "generatedSchema.usda", "schema.usda")
    }
    modules = {str(path.relative_to(ROOT)) for path in (ROOT / "asglight").rglob("*.py")}
    page = {f"asglight/page/parts/page.{kind}" for kind in ("html", "css", "js")}
    assert shaders
    assert shaders | schema | modules | page | {"asglight/viewer.py"} <= names
    assert not any(name.startswith(("tests/", "viewer.py")) for name in names)
