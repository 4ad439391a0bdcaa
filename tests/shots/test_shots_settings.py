# SPDX-License-Identifier: Apache-2.0
import dataclasses
import json
import math
from pathlib import Path

import pytest
import shot_files
import sky_files
import torch

import asglight
from asglight.errors import InputError
from asglight.fitting.options import LOBES, MAX_LOBES, FitOptions, Preset
from asglight.images import open_sequence
from asglight.lobes import Form
from asglight.shots.settings import check_fps, check_options, check_output, settings_of


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lobes": 0}, "lobes: 0; expected 1 to 512"),
        ({"lobes": 513}, "lobes: 513; expected 1 to 512"),
        ({"tolerance": 0.02, "max_lobes": 0}, "max lobes: 0; expected 1 to 512"),
        ({"tolerance": 0.02, "max_lobes": 513}, "max lobes: 513; expected 1 to 512"),
        ({"max_lobes": 20}, "max lobes: 20 without a tolerance; expected both or neither"),
        ({"tolerance": 0.0}, "tolerance: 0; expected a relative error above 0 and below 1"),
        ({"tolerance": 1.0}, "tolerance: 1; expected a relative error above 0 and below 1"),
        ({"tolerance": math.nan}, "tolerance: nan; expected a relative error"),
        (
            {"tolerance": 0.02, "lobes": 15},
            "lobes: 15 beside a tolerance, which finds their number; expected one of the two",
        ),
        (
            {"tolerance": 0.02, "preset": Preset.PAPER},
            "tolerance: given with --preset paper, .*; expected --preset live, fast or best",
        ),
        ({"seed": -1}, "seed: -1; expected 0 to"),
        ({"seed": 2**63}, "seed: 9223372036854775808; expected 0 to"),
        ({"paper_steps": (0, 5)}, "paper steps: 0,5; expected two whole numbers"),
        ({"paper_steps": ()}, "paper steps: none; expected two whole numbers"),
        ({"device": "tpu"}, "device: tpu; expected cpu, cuda"),
        ({"device": ""}, "device: none; expected cpu, cuda"),
        ({"device": "cpu:1"}, "device: cpu:1; expected cpu, cuda"),
        ({"device": "cuda:x"}, "device: cuda:x; expected cpu, cuda"),
    ],
)
def test_an_option_out_of_range_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_options(dataclasses.replace(FitOptions(), **change))


def test_the_defaults_and_the_limits_are_accepted() -> None:
    check_options(FitOptions())
    check_options(FitOptions(lobes=256, seed=2**63 - 1))
    check_options(FitOptions(tolerance=0.02, max_lobes=256))


def test_settled_options_leave_no_number_open() -> None:
    assert FitOptions().settled(1) == FitOptions(lobes=LOBES)
    assert FitOptions(lobes=4).settled(1) == FitOptions(lobes=4)
    assert FitOptions(tolerance=0.1).settled(1) == FitOptions(tolerance=0.1, max_lobes=MAX_LOBES)
    assert FitOptions(tolerance=0.1, max_lobes=9).settled(1).max_lobes == 9


def test_the_form_is_left_open_for_a_still_alone() -> None:
    assert FitOptions(form=None).settled(1).form is None
    assert FitOptions(form=None).settled(2).form is Form.ASG
    assert FitOptions(form=None, preroll=1001).settled(1).form is Form.ASG  # a part of a shot
    assert FitOptions(form=Form.FLAT).settled(2).form is Form.FLAT


def test_cuda_without_a_device_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"finds no CUDA device here; .* Use --device cpu"):
        check_options(FitOptions(device="cuda"))


def test_a_cuda_device_beyond_the_last_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    check_options(FitOptions(device="cuda:1"))
    with pytest.raises(InputError, match="device: cuda:2; expected cuda:0 to cuda:1"):
        check_options(FitOptions(device="cuda:2"))


@pytest.mark.parametrize("fps", [0.0, -24.0, float("nan"), float("inf")])
def test_a_frame_rate_that_is_none_is_refused(fps: float) -> None:
    with pytest.raises(InputError, match=r"fps: .*; expected a number above 0"):
        check_fps(fps)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("shot.exr", r"its extension is \.exr; expected \.usda, \.usdc, \.usd or \.usdz"),
        ("shot", "its extension is missing; expected"),
        ("folder.usd", "is a folder; expected a file"),
        ("nowhere/shot.usda", r"there is no folder .*nowhere; expected one"),
        ("file.txt/shot.usda", r"there is no folder .*file\.txt; expected one"),
        (f"{'x' * 300}/shot.usda", "there is no folder"),
    ],
)
def test_an_output_that_cannot_be_is_refused(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder.usd").mkdir()
    (tmp_path / "file.txt").touch()
    with pytest.raises(InputError, match=message):
        check_output(tmp_path / name)


def test_the_settings_hold_every_option_as_json(tmp_path: Path) -> None:
    sequence = open_sequence(sky_files.write_sequence(tmp_path / "in"), missing="hold", height=256)
    settings = settings_of(sequence, shot_files.OPTIONS, 23.976)
    assert json.loads(json.dumps(settings)) == settings
    options = {field.name for field in dataclasses.fields(FitOptions)}
    assert options - {"moving"} <= settings.keys()
    assert settings["asglight"] == asglight.__version__
    assert settings["source"] == str(tmp_path / "in" / "sky.####.exr")
    assert settings["frames"] == [1001, 1002, 1003, 1004]
    assert (settings["missing"], settings["height"], settings["fps"]) == ("hold", 256, 23.976)
