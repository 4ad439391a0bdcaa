# SPDX-License-Identifier: Apache-2.0
"""The wheel: what it holds, and that it works in an environment of its own."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet
from places import ROOT

import asglight
from asglight import c_library
from asglight.fitting import compiled

DEMO = """\
import json, sys
import asglight
from asglight.cli.commands import demo
from asglight.cli.main import main
from asglight.fitting import compiled
from asglight.sky import SkyConfig

demo.CONFIG = SkyConfig(frames=(1001, 1002))
demo.HEIGHT = 16
demo.draw_balls = lambda *of: None
status = main(["demo", "-o", "out"])
facts = {"status": status, "file": asglight.__file__, "compiled": compiled.LIBRARY is not None}
open("facts.json", "w").write(json.dumps(facts))
"""
"""The demo of two small frames, without balls; the whole takes minutes (`make release`)."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT],
        check=True,
        capture_output=True,
    )
    (path,) = folder.glob("*.whl")
    return path


def test_the_wheel_holds_shaders_schema_types_and_viewer(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    shaders = {f"asglight/{path.relative_to(ROOT)}" for path in (ROOT / "shaders").rglob("*.*")}
    schema = {
        f"asglight/usd/resources/{name}"
        for name in ("plugInfo.json", "generatedSchema.usda", "schema.usda")
    }
    modules = {str(path.relative_to(ROOT)) for path in (ROOT / "asglight").rglob("*.py")}
    page = {f"asglight/page/parts/page.{kind}" for kind in ("html", "css", "js")}
    assert shaders
    assert shaders | schema | modules | page <= names
    assert {"asglight/viewer.py", "asglight/py.typed"} <= names
    assert not any(name.startswith(("tests/", "viewer.py")) for name in names)
    licences = f"asglight-{asglight.__version__}.dist-info/licenses"
    assert {f"{licences}/LICENSE", f"{licences}/LICENSES.md"} <= names


def test_one_wheel_serves_every_version_of_python(wheel: Path) -> None:
    name, version, python, abi, platform = wheel.stem.split("-")
    assert (name, version, python, abi) == ("asglight", asglight.__version__, "py3", "none")
    assert (platform == "any") == (c_library.compiler() is None or sys.platform == "win32")


def test_without_a_compiler_the_wheel_is_for_every_machine(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, ROOT]
    environment = {**os.environ, "CC": "no-such-compiler"}
    done = subprocess.run(line, env=environment, check=True, capture_output=True, text=True)
    (path,) = tmp_path.glob("*.whl")
    assert path.name == f"asglight-{asglight.__version__}-py3-none-any.whl"
    assert not any(name.endswith(".so") for name in zipfile.ZipFile(path).namelist())
    assert "all works, and fits take about three times as long" in done.stdout + done.stderr


@pytest.mark.slow
def test_the_demo_runs_from_the_wheel_in_a_clean_environment(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env", with_pip=False)
    python = tmp_path / "env" / "bin" / "python"
    options = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check"]
    options.append("--no-compile")  # most of it is not run
    line = [sys.executable, "-m", "pip", "--python", python, "install", *options, wheel]
    subprocess.run(line, check=True)
    # what it needs is taken from here; lines of .pth files there, and so an asglight, are not
    found = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = subprocess.run([python, "-c", found], capture_output=True, text=True, check=True)
    here = {sysconfig.get_path(name) for name in ("purelib", "platlib")}
    Path(site.stdout.strip(), "needs.pth").write_text("".join(f"{path}\n" for path in here))
    outside = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    without_compiler = {**outside, "PATH": "", "CC": ""}
    done = subprocess.run(
        [python, "-c", DEMO], cwd=tmp_path, env=without_compiler, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert facts["status"] == 0
    assert Path(facts["file"]).is_relative_to(tmp_path / "env")
    assert facts["compiled"] == (compiled.LIBRARY is not None)  # as where there is a compiler
    assert (tmp_path / "out" / "contact-sheet.png").is_file()
    command = tmp_path / "env" / "bin" / "asglight"
    told = subprocess.run(
        [command, "--version"], env=outside, capture_output=True, text=True, check=True
    )
    assert told.stdout == f"asglight {asglight.__version__}\n"


def test_every_requirement_has_its_licence_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    users = set(project["optional-dependencies"]) - {"dev", "docs"}
    stated = [*project["dependencies"]]
    stated += [line for name in users for line in project["optional-dependencies"][name]]
    names = {re.split(r"[\[><=~!]", line)[0] for line in stated}
    listed = re.findall(r"^\| ([\w-]+) \| [A-Z]", (ROOT / "LICENSES.md").read_text(), re.MULTILINE)
    assert set(listed) - {"package"} >= names


def test_the_citation_is_of_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {asglight.__version__}\n" in text
    assert f"\n## {asglight.__version__} - " in (ROOT / "CHANGELOG.md").read_text()


def test_importing_asglight_loads_nothing_of_others() -> None:
    code = "import sys; old = set(sys.modules); import asglight; print(*set(sys.modules) - old)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    others = {name.partition(".")[0] for name in done.stdout.split()} - sys.stdlib_module_names
    assert others == {"asglight"}


def test_pinned_versions_run_on_the_oldest_python_that_asglight_does() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=") + ".0"
    pins = re.findall(r"^([^#=\s]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    assert len(pins) > 50
    needed = {
        f"{name} {version}": metadata.metadata(name).get("Requires-Python", "")
        for name, version in pins
    }
    newer = {pin: asked for pin, asked in needed.items() if oldest not in SpecifierSet(asked)}
    assert not newer  # `make setup` on Debian 12, whose Python is 3.11.2
