# SPDX-License-Identifier: Apache-2.0
"""`asglight export`: what it writes and says, and what it refuses."""

import os
import re
from pathlib import Path

import pytest
import torch
from usd_tracks import contents, moving

from asglight.cli.main import main
from asglight.export import read_json
from asglight.export.environment import environment
from asglight.usd import read_usd, write_usd


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write a stage of three lobes in the frames 1001, 1002 and 1004, and go there."""
    monkeypatch.chdir(tmp_path)
    write_usd(moving([1001, 1002, 1004]), "shot.usda")
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
    text = re.sub(r'(def "lobe_01" \()', r"\1\n active = false", path.read_text())
    path.write_text(text)
    assert main(["export", stage, "--to", "json", "-o", "out.json"]) == 0
    assert re.findall(r'"name":"(\w+)"', Path("out.json").read_text()) == ["lobe_00", "lobe_02"]


@pytest.mark.parametrize(("options", "frame"), [((), 1001), (("--frame", "1004"), 1004)])
def test_glsl_holds_one_frame(
    stage: str, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], frame: int
) -> None:
    assert main(["export", stage, "--to", "glsl", "-o", "out.glsl", *options]) == 0
    assert Path("out.glsl").read_text() == environment(read_usd(stage).at(frame), frame)
    size = f"{os.path.getsize('out.glsl') / 1000:.3g} kB"
    assert capsys.readouterr().out == (
        f"out.glsl: 3 lobes of form asg, frame {frame} of 3 frames (1001-1002,1004), {size}\n"
    )


FAULTS = [
    ("export", "required: STAGE, --to, -o/--output"),
    ("export shot.usda -o a.json", "required: --to"),
    ("export shot.usda --to hlsl -o a.json", "--to: invalid choice: 'hlsl'"),
    ("export none.usda --to json -o a.json", "none.usda: no such file"),
    ("export shot.usda --to json -o shot.usda", "shot.usda: names a stage; expected a name such"),
    ("export shot.usda --to json -o .", r"\.: is a folder; expected a file to write"),
    ("export shot.usda --to json --frame 1001 -o a.json", "--frame: given with --to json"),
    (
        "export shot.usda --to glsl --frame 1003 -o a.glsl",
        "--frame 1003: not in shot.usda; expected",
    ),
    ("export shot.usda --to glsl --frame x -o a.glsl", "--frame: invalid int value: 'x'"),
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
def test_a_full_disk_leaves_the_old_file(
    stage: str, to: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    Path("out.txt").write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("asglight.images.output.os.replace", full)
    before = contents(Path())
    assert main(["export", stage, "--to", to, "-o", "out.txt"]) == 2
    assert "out.txt: cannot be written (No space left on device)" in capfd.readouterr().err
    assert contents(Path()) == before


@pytest.mark.skipif(not Path("/sys").is_dir(), reason="needs a folder that no one may write to")
def test_a_read_only_folder_is_one_line(stage: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["export", stage, "--to", "json", "-o", "/sys/out.json"]) == 2
    assert capfd.readouterr().err.startswith("asglight: /sys/out.json: cannot be written (")
