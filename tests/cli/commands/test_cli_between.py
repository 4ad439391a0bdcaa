# SPDX-License-Identifier: Apache-2.0
"""`asglight eval --between`: a lamp that turns, whose stage is right between its frames."""

import json
import math
from pathlib import Path

import pytest
import torch
from pxr import Usd, UsdGeom, UsdLux

from asglight.cli.main import main
from asglight.images import write_exr
from asglight.lobes import Lobes, LobeTracks, frames, texels
from asglight.usd import write_usd

HEIGHT = 32
METADATA = {"lobes": 1, "preset": "live", "form": "asg", "seed": 0, "paper_steps": [10, 5]}


def lamp(longitude_deg: float) -> Lobes:
    angle = math.radians(longitude_deg)
    axis_z = torch.tensor([[math.sin(angle), 0.0, math.cos(angle)]])
    return Lobes(frames.axes_around(axis_z), torch.full((1, 2), 60.0), torch.ones(1, 3))


def written(folder: Path, numbers: range, metadata: dict[str, object]) -> Path:
    """Write a lamp that turns by 5 degrees a frame."""
    lobes = [lamp(5.0 * number) for number in numbers]
    tracks = LobeTracks(
        tuple(numbers),
        24.0,
        Lobes(
            torch.stack([one.axes for one in lobes]),
            torch.stack([one.sharpness for one in lobes]),
            torch.stack([one.amplitude for one in lobes]),
        ),
        metadata,
    )
    path = folder / "lamp.usda"
    write_usd(tracks, path)
    return path


@pytest.fixture
def images(tmp_path: Path) -> Path:
    folder = tmp_path / "lamp"
    folder.mkdir()
    for number in range(1, 6):
        radiance = texels.texel_means(lamp(5.0 * number), HEIGHT, 2 * HEIGHT)
        write_exr(folder / f"lamp.{number:04d}.exr", radiance)
    return folder


def evaluated(capsys, *arguments: object) -> dict:
    assert main(["eval", *map(str, arguments), "--between", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_stage_of_every_second_frame_is_judged_at_the_others(images, tmp_path, capsys) -> None:
    stage = written(tmp_path, range(1, 6, 2), {})
    found = evaluated(capsys, stage, "--reference", images)
    assert found["left_out"] == [2, 4]
    assert found["fitted_anew"] is False
    # the images are half floats
    assert max(found["mean"]["stage"].values()) < 1e-3
    assert max(found["mean"]["rule"].values()) < 1e-3
    assert found["ratios"]["stage"]["r0.25"] < 0.05


def test_a_lobe_that_is_invisible_does_not_light_between_frames(images, tmp_path, capsys) -> None:
    path = written(tmp_path, range(1, 6, 2), {})
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Imageable(stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00")).MakeInvisible()
    stage.Save()
    mean = evaluated(capsys, path, "--reference", images)["mean"]
    assert mean["stage"]["flux"] == mean["rule"]["flux"] == 1.0  # none of the lamp's light


def test_what_lobes_cannot_hold_is_said(images, tmp_path, capsys) -> None:
    path = written(tmp_path, range(1, 6, 2), {})
    stage = Usd.Stage.Open(str(path))
    light = stage.GetPrimAtPath("/AsgRig/Lobes/lobe_00/tall")
    UsdLux.LightAPI(light).CreateFiltersRel().AddTarget("/Blocker")
    stage.Save()
    assert main(["eval", str(path), "--reference", str(images), "--between"]) == 0
    error = capsys.readouterr().err
    assert f"asglight: {path}: not read: {light.GetPath()}: has light filters" in error


def test_a_stage_of_all_frames_is_fitted_anew_without_every_second_one(
    images, tmp_path, capsys
) -> None:
    stage = written(tmp_path, range(1, 6), METADATA)
    assert main(["eval", str(stage), "--reference", str(images), "--between"]) == 0
    text = capsys.readouterr().out
    assert "mean of 2 frames left out, the others fitted anew" in text
    assert all(way in text for way in ("stage", "rule", "fits", "maps"))


def test_a_stage_that_was_not_fitted_cannot_be_fitted_anew(images, tmp_path, capsys) -> None:
    stage = written(tmp_path, range(1, 6), {})
    assert main(["eval", str(stage), "--reference", str(images), "--between"]) == 2
    assert "does not say how it was fitted" in capsys.readouterr().err


def test_two_frames_are_too_few(images, tmp_path, capsys) -> None:
    stage = written(tmp_path, range(1, 3), METADATA)
    arguments = ["eval", str(stage), "--reference", str(images), "--between", "--frames", "1-2"]
    assert main(arguments) == 2
    assert "2 frames; expected 3 or more" in capsys.readouterr().err
