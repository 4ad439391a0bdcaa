# SPDX-License-Identifier: Apache-2.0
"""What the closed form is measured with: `benchmarks/shaded/`."""

import subprocess
from pathlib import Path

import pytest
import torch
from bench_scripts import module
from lobe_cases import alike

from asglight.lobes import Form
from asglight.shading import ggx_lobes

constants = module("shaded.constants")
balls = module("shaded.balls")
window = module("shaded.window")


@pytest.fixture(autouse=True)
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(constants, "POINTS", 8)
    for script in (constants, balls):
        monkeypatch.setattr(script, "SAMPLES", 16)


def test_the_constants_that_are_there_are_measured_and_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = constants.OUTPUT.read_bytes()
    constants.main(["--measure", "--scenes", "96"])
    header, _, *rows = capsys.readouterr().out.splitlines()
    assert header == "| roughness | asg | bingham | sg |"
    assert len(rows) == len(constants.REPORTED)
    means = [float(cell.split()[0]) for row in rows for cell in row.strip("| ").split(" | ")[1:]]
    # of another closed form the error would be of the size of the light; few samples leave noise
    assert max(means) < 15
    assert constants.OUTPUT.read_bytes() == before


def test_constants_come_back_from_their_module(tmp_path: Path) -> None:
    found = constants.shipped()
    again: dict[str, object] = {}
    exec(constants.module(found), again)
    for name in ("KERNEL", "SHARE", "DISC"):
        assert again[name] == getattr(constants.ggx_lobes_constants, name)
    assert ggx_lobes.TERMS == 3


def test_maps_have_rows_for_the_first_form_and_each_form_has_one_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(balls, "ROUGHNESS", (0.5,))
    monkeypatch.setattr(balls, "YAWS", (0,))
    # two lobes stand for the fit of any map
    monkeypatch.setattr(balls, "fitted", lambda _, form: alike(form, 2)[0].to(torch.float64))
    for name in ("one", "other"):
        (tmp_path / f"{name}.exr").touch()
    balls.main(["--maps", str(tmp_path), "--forms", "sg", "bingham", "--points", "8"])
    header, _, *rows = capsys.readouterr().out.splitlines()
    assert header == f"| {Form.SG} | 0.5 | Lambert |"
    names = [row.split(" | ")[0].strip("| ") for row in rows]
    assert names == ["one", "other", "**sg, all**", "**bingham, all**"]


@pytest.mark.parametrize(
    ("said", "told"),
    [("", "said nothing, status -9"), ("a traceback\nOSError: full\n", "OSError: full")],
)
def test_a_case_of_the_window_that_failed_says_why(
    said: str, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(words, -9, "", said)

    monkeypatch.setattr(window.subprocess, "run", run)
    window.main(["day.usda", "--reference", "day", "--cases", "idle"])
    assert capsys.readouterr().out.splitlines()[-1] == f"| idle | failed: {told} |"


def test_a_stage_that_has_no_first_picture_says_why(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"first picture: failed: asglight: .*gone.usda"):
        window.measured("first", tmp_path / "gone.usda", "")
