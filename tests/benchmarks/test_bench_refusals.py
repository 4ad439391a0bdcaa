# SPDX-License-Identifier: Apache-2.0
"""Scripts of benchmarks/ whose input is the user's to mend: one line, exit status 2."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from bench_scripts import module

from asglight.images import write_exr

OF_FOLDERS = (
    *("steps.ridge", "steps.starts", "steps.rounding", "shots.method", "shots.hard_changes"),
    *("shaded.balls", "stages.representations", "fits.unseen"),
)
OF_FILES = ("steps.growth", "steps.flat_tops", "stages.sg_arrays", "keyed.measure")

SCRIPTS = {
    "shots.clean_scene": ("--still", "gone", "--sequence", "gone"),
    "shots.parts": ("gone",),
    "results.scrub": ("gone", "-o", "scrub.webp"),
    "keyed.sheet": ("gone", "-o", "sheet.png"),
    "shaded.reference": ("gone",),
}


@pytest.fixture(autouse=True)
def threads() -> Iterator[None]:
    """Give the other tests their threads back."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def refused(name: str, words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a script that refuses its input, and return the line that says why."""
    with pytest.raises(SystemExit) as ended:
        module(name).main(words)
    assert ended.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("name", OF_FOLDERS)
def test_a_map_that_cannot_be_read_is_named_in_a_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sky.exr").write_text("junk")
    line = refused(name, ["--maps", str(tmp_path)], capsys)
    assert "sky.exr: is text; expected an OpenEXR" in line


@pytest.mark.parametrize("name", OF_FILES)
def test_an_image_that_cannot_be_read_is_named_in_a_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sky.exr").write_text("junk")
    line = refused(name, [str(tmp_path / "sky.exr")], capsys)
    assert "sky.exr: is text; expected an OpenEXR" in line


@pytest.mark.parametrize("words", SCRIPTS.values(), ids=SCRIPTS)
def test_an_input_that_is_not_there_is_named_in_a_line(
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.chdir(tmp_path)
    line = refused(request.node.callspec.id, list(words), capsys)
    assert re.search(r"\bgone\b.*(is not there|No such file)", line)


def test_a_clean_scene_that_cannot_be_fitted_is_named_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_exr(tmp_path / "sky.1.exr", torch.ones(4, 8, 3))
    words = ["--still", str(tmp_path / "gone.exr"), "--sequence", str(tmp_path), "--repeats", "1"]
    line = refused("shots.clean_scene", words, capsys)
    assert "clean_scene: error:" in line
    assert "gone.exr: is not there" in line


@pytest.mark.parametrize("option", ["--frames", "--repeats"])
def test_a_count_of_none_is_refused(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused("shots.clean_scene", ["--still", "a", "--sequence", "b", option, "0"], capsys)
    assert f"argument {option}: '0'; expected a whole number from 1 on" in line


def test_a_map_of_production_that_cannot_be_read_is_named_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused("inputs.production", ["--map", str(tmp_path / "gone.exr")], capsys)
    assert "gone.exr: cannot be opened (No such file or directory)" in line


@pytest.mark.parametrize("name", OF_FOLDERS[:-1])  # the last takes .hdr files too
def test_a_folder_without_maps_is_named_in_a_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(name, ["--maps", str(tmp_path)], capsys)
    assert "has no .exr; expected latlong OpenEXR files" in line


@pytest.mark.parametrize("name", ["steps.rounding", "shots.method", "stages.representations"])
def test_a_black_map_is_named_in_a_line(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr(tmp_path / "cave.exr", torch.zeros(4, 8, 3))
    line = refused(name, ["--maps", str(tmp_path)], capsys)
    assert "cave.exr: is black; expected a map with some light in it." in line


def test_a_stage_that_is_not_there_is_named_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--stages", str(tmp_path / "gone.usda")]
    assert "gone.usda: no such file" in refused("stages.representations", words, capsys)


def test_no_stage_to_open_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["opening.py", str(tmp_path / "stages")])
    with pytest.raises(SystemExit, match="stages: no stage to open"):
        module("stages.opening").main()
