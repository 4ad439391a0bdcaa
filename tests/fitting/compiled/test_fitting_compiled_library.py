# SPDX-License-Identifier: Apache-2.0
"""The compiled library: what it serves, which one is used, how it is made, what is told if not."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from adaptive_cases import plain_cells
from lobe_cases import DOUBLE, alike

from asglight import c_library as library
from asglight.fitting import compiled
from asglight.fitting.loss import lobe_images
from asglight.lobes import Form, Lobes

pytestmark = pytest.mark.skipif(
    compiled.LIBRARY is None and library.compiler() is None, reason="there is no C compiler"
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the library into a folder of its own."""
    target = tmp_path_factory.mktemp("library") / compiled.NAME
    assert library.compile_library(Path(compiled.__file__).parent, target) is None
    return target


@pytest.mark.parametrize(
    "other",
    [
        lambda lobes: lobes.to(DOUBLE),
        lambda lobes: replace(lobes, form=Form.SG),
        lambda lobes: replace(lobes, amplitude=lobes.amplitude.int()),
        lambda lobes: replace(lobes, sharpness=lobes.sharpness.requires_grad_()),
    ],
)
def test_other_lobes_are_left_to_torch(other: Callable[[Lobes], Lobes]) -> None:
    places = plain_cells(32)
    assert compiled.serves(alike(Form.ASG), places)
    assert not compiled.serves(other(alike(Form.ASG)), places)


def test_grids_with_an_odd_number_of_rows_are_left_to_torch() -> None:
    assert not compiled.serves(alike(Form.ASG), plain_cells(15))


def test_without_the_library_steps_are_those_of_torch(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "__init__.py"))
    assert compiled.load() is None
    (tmp_path / compiled.NAME).write_bytes(b"of another system")
    assert compiled.load() is None


def test_a_library_of_other_sources_is_not_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, made: Path
) -> None:
    for source in (*Path(compiled.__file__).parent.glob("*.[ch]"), made):
        shutil.copy(source, tmp_path)
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "__init__.py"))
    assert compiled.load() is not None
    with (tmp_path / "steps.c").open("a") as changed:
        changed.write("/* another */\n")
    assert compiled.load() is None


def test_a_processor_that_is_too_old_is_left_to_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "DEFAULT")
    assert compiled.load() is None


@pytest.mark.skipif(
    library.platform.machine() not in library.X86, reason="other processors are left as they are"
)
def test_numbers_below_the_smallest_normal_one_are_zero_in_calls_only() -> None:
    assert compiled.LIBRARY is not None
    small = torch.full((8,), 1e-39)
    assert (small * 0.5 > 0).all()
    before = compiled.LIBRARY.asglight_begin(1)
    within = small * 0.5, small * 1e10
    compiled.LIBRARY.asglight_end(before)
    assert all((each == 0).all() for each in within)
    lobe_images.images(alike(Form.ASG), plain_cells(32))
    assert (small * 0.5 > 0).all()


def test_the_library_is_compiled_and_put_in_place_whole(made: Path) -> None:
    assert [path.name for path in made.parent.iterdir()] == [compiled.NAME]
    code = f"import ctypes; ctypes.CDLL({str(made)!r}).asglight_probe"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("compiler", "told"),
    [("no-such-compiler", "No such file"), ("false", "exit status 1")],
)
def test_a_compiler_that_fails_is_told_and_changes_nothing(
    compiler: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)
    target = tmp_path / compiled.NAME
    target.write_bytes(b"before")
    failure = library.compile_library(Path(compiled.__file__).parent, target)
    assert failure is not None
    assert compiler in failure
    assert told in failure
    assert target.read_bytes() == b"before"


def test_a_machine_without_a_compiler_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", os.fspath(tmp_path))
    failure = library.compile_library(tmp_path, tmp_path / compiled.NAME)
    assert failure == "no C compiler was found (cc, gcc, or what CC names)"
