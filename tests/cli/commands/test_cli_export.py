# SPDX-License-Identifier: Apache-2.0
"""`asglight export`: what it writes and says, and what it refuses."""

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from usd_tracks import assert_same, contents, moving

from asglight.cli.main import main
from asglight.export import read_json
from asglight.export.environment import environment
from asglight.usd import read_usd, write_usd


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a stage of three lobes in the frames 1001, 1002 and 1004."""
    folder = tmp_path_factory.mktemp("written")
    write_usd(moving([1001, 1002, 1004]), folder / "shot.usda")
    return folder


@pytest.fixture
def stage(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Go to a copy of the stage."""
    monkeypatch.chdir(shutil.copytree(written, tmp_path, dirs_exist_ok=True))
    return "shot.usda"


def test_json_holds_the_tracks_of_the_stage(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", stage, "--to", "json", "-o", "out.json"]) == 0
    found, expected = read_json("out.json"), read_usd(stage)
    assert found.frames == expected.frames
    assert torch.equal(found.lobes.amplitude, expected.lobes.amplitude)
    size = f"{os.path.getsize('out.json') / 1000:.3g} kB"
    assert capsys.readouterr().out == (
        f"out.json: 3 lobes of form asg, 3 frames (1001-1002,1004) at 24 fps, {size}\n"
    )


def test_json_names_the_lobes_as_the_stage_does(stage: str) -> None:
    path = Path(stage)
    # A lobe that was deactivated by hand is gone, and the others keep their names.
    text = re.sub(r'(def \w+ "lobe_01" \()', r"\1\n active = false", path.read_text())
    path.write_text(text)
    assert main(["export", stage, "--to", "json", "-o", "out.json"]) == 0
    assert re.findall(r'"name":"(\w+)"', Path("out.json").read_text()) == ["lobe_00", "lobe_02"]


def test_a_representation_is_added_to_the_stage(
    stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = read_usd(stage)
    assert main(["export", stage, "--to", "distant", "-o", "other.usda"]) == 0
    assert main(["export", stage, "--to", "dome"]) == 0
    other, same = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"other\.usda: cards, distant; \d images?, [\d.]+ kB", other)
    images = len(list(Path("shot_dome").glob("*.exr")))
    assert same.startswith(f"shot.usda: cards, dome; {images} images, ")
    assert Path("shot_dome", "shot.1004.exr").is_file()
    assert not Path("other_dome", "other.1004.exr").exists()
    assert_same(read_usd(stage), before)
    capsys.readouterr()
    assert main(["info", stage]) == 0
    assert "representation: cards (also dome)\n" in capsys.readouterr().out


@pytest.mark.parametrize("option", ["--frames", "--frame"])
def test_frames_are_chosen(stage: str, option: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["export", stage, "--to", "json", "-o", "out.json", option, "1002-1004x2"]
    assert main(line) == 0
    found, every = read_json("out.json"), read_usd(stage)
    assert found.frames == (1002, 1004)
    assert torch.equal(found.lobes.amplitude, every.lobes.amplitude[1:])
    assert "2 frames (1002,1004) at 24 fps" in capsys.readouterr().out


def test_glsl_of_one_frame_is_one_file(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["export", stage, "--to", "glsl", "-o", "out.glsl", "--frame", "1004"]
    assert main(line) == 0
    tracks = read_usd(stage)
    one = replace(tracks, frames=(1004,), lobes=tracks.lobes[2:])
    assert Path("out.glsl").read_text() == environment(one, "").text
    assert "frame 1004." in Path("out.glsl").read_text()
    assert not Path("out.f32").exists()
    size = f"{os.path.getsize('out.glsl') / 1000:.3g} kB"
    assert capsys.readouterr().out == (
        f"out.glsl: 3 lobes of form asg, 1 frame (1004) at 24 fps, {size}\n"
    )


def test_glsl_of_a_shot_has_a_file_with_its_frames(
    stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", stage, "--to", "glsl", "-o", "out.glsl"]) == 0
    made = environment(read_usd(stage), "out.f32")
    assert Path("out.glsl").read_text() == made.text
    assert "uniform block AsglightFrame: 240 bytes" in made.text
    assert "out.f32 holds" in made.text
    assert made.blocks is not None
    found = np.fromfile("out.f32", "<f4").reshape(3, 5, 3, 4)
    np.testing.assert_array_equal(found.reshape(3, -1, 4), made.blocks)
    lobes = read_usd(stage).lobes
    np.testing.assert_array_equal(found[:, 4, :, :3], lobes.amplitude)
    np.testing.assert_array_equal(found[:, 2, :, :3], lobes.axis_z)
    assert capsys.readouterr().out.startswith(
        "out.glsl, out.f32: 3 lobes of form asg, 3 frames (1001-1002,1004) at 24 fps, "
    )


FAULTS = [
    ("export", "required: STAGE, --to"),
    ("export shot.usda --to json", "output: none for json; expected a file. Add -o FILE"),
    ("export shot.usda --to dome --frame 1001", "frames: 1001 with --to dome, which is of all fra"),
    ("export shot.usda -o a.json", "required: --to"),
    ("export shot.usda --to hlsl -o a.json", "--to: invalid choice: 'hlsl'"),
    ("export none.usda --to json -o a.json", "none.usda: no such file"),
    (
        "export shot.usda --to json -o shot.usda",
        "shot.usda: has the suffix of another",
    ),
    (
        "export shot.usda --to glsl -o shot.f32",
        "shot.f32: has the suffix of another",
    ),
    ("export shot.usda --to json -o .", r"\.: is a folder; expected a file to write"),
    (
        "export shot.usda --to glsl --frame 1003 -o a.glsl",
        "frames: 1003 not in shot.usda; expected some of 1001, 1002, 1004",
    ),
    ("export shot.usda --to json --frames x -o a.json", "frames: x; expected whole frames such as"),
    (
        "export shot.usda --to json -o none/a.json",
        r"none/a.json: cannot be written \(no folder none",
    ),
    (
        "export shot.usda --to glsl -o none/a.glsl",
        r"none/a.glsl: cannot be written \(no folder none",
    ),
]


@pytest.mark.parametrize(("line", "message"), FAULTS, ids=[line for line, _ in FAULTS])
def test_a_fault_is_one_line_and_changes_nothing(
    stage: str, capfd: pytest.CaptureFixture[str], line: str, message: str
) -> None:
    before = contents(Path())
    assert main(line.split()) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("asglight: ")
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert contents(Path()) == before


@pytest.mark.parametrize("to", ["json", "glsl"])
def test_a_full_disk_leaves_the_old_files(
    stage: str, to: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for suffix in (".txt", ".f32"):
        Path(f"out{suffix}").write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("asglight.images.output.os.replace", full)
    before = contents(Path())
    assert main(["export", stage, "--to", to, "-o", "out.txt"]) == 2
    name = {"json": "out.txt", "glsl": "out.f32"}[to]  # the first to be renamed
    assert f"{name}: cannot be written (No space left on device)" in capfd.readouterr().err
    assert contents(Path()) == before


@pytest.mark.skipif(not Path("/sys").is_dir(), reason="needs a folder that no one may write to")
def test_a_read_only_folder_is_one_line(stage: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["export", stage, "--to", "json", "-o", "/sys/out.json"]) == 2
    assert capfd.readouterr().err.startswith("asglight: /sys/out.json: cannot be written (")
