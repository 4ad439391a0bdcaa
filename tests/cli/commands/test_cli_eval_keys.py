# SPDX-License-Identifier: Apache-2.0
"""`asglight eval` of a stage that opens with its keys: these and the rest are judged."""

import json
from pathlib import Path

import pytest
import torch
from bench_scripts import module
from keyed_stages import images, write
from pxr import Usd, UsdLux

from asglight.cli.main import main
from asglight.judging.metrics import frame_errors, map_errors

judge = module("keyed.seen")
FRAMES = (1001, 1002)


def evaluated(stage: Path, capsys: pytest.CaptureFixture[str]) -> dict:
    reference = str(stage.parent / "sky.####.exr")
    words = ["eval", str(stage), "--reference", reference, "--frames", "1001-1002", "--json"]
    assert main(words) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("texture", [False, True])
def test_keys_and_rest_are_judged_as_usd_says_what_they_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], texture: bool
) -> None:
    maps = images(tmp_path, FRAMES)
    write(tmp_path, frames=FRAMES, texture=texture)
    found = evaluated(tmp_path / "shot.usda", capsys)
    assert found["judged"] == "keys and rest"
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    for row in found["frames"]:
        height, width = maps[row["frame"]].shape[:2]
        seen = torch.from_numpy(judge.seen(stage, row["frame"], height, width)).float()
        wanted = map_errors(seen, maps[row["frame"]]).values
        assert row["env"] == pytest.approx(wanted["env"], abs=0.004)
        for name in ("flux", "irr", "r0.5", "r0.25"):
            assert row[name] == pytest.approx(wanted[name], abs=0.0005), name
        assert row["env"] < (0.03 if texture else 0.15)


def test_a_key_that_is_dimmed_in_a_layer_is_judged_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images(tmp_path, FRAMES)
    write(tmp_path, frames=FRAMES)
    layer = Usd.Stage.CreateNew(str(tmp_path / "dim.usda"))
    layer.GetRootLayer().subLayerPaths = ["./shot.usda"]
    layer.SetDefaultPrim(layer.GetPrimAtPath("/AsgRig"))
    (key,) = layer.GetPrimAtPath("/AsgRig/Keys").GetChildren()
    UsdLux.LightAPI(key).CreateExposureAttr(-1.0)
    layer.Save()
    before, after = (evaluated(tmp_path / name, capsys) for name in ("shot.usda", "dim.usda"))
    assert before["mean"]["flux"] < 2e-4
    assert after["mean"]["flux"] > 0.02  # half of the lamp


@pytest.mark.parametrize("options", [{"representations": ("cards", "keys")}, {"lights": "distant"}])
def test_a_stage_that_opens_with_other_lights_has_its_lobes_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: dict
) -> None:
    from asglight.usd import read_usd
    from asglight.usd.options import KeyLights

    maps = images(tmp_path, FRAMES)
    options = {k: KeyLights(v) if k == "lights" else v for k, v in options.items()}
    write(tmp_path, frames=FRAMES, **options)
    found = evaluated(tmp_path / "shot.usda", capsys)
    assert found["judged"] == "lobes"
    lobes = read_usd(tmp_path / "shot.usda").at(1001)
    # frames that are judged together are summed in another order
    expected = frame_errors(lobes, maps[1001]).values["irr"]
    assert found["frames"][0]["irr"] == pytest.approx(expected, rel=1e-6)


def test_the_table_ends_with_what_was_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    images(tmp_path, FRAMES)
    write(tmp_path, frames=FRAMES)
    words = [str(tmp_path / "shot.usda"), "--reference", str(tmp_path / "sky.####.exr")]
    assert main(["eval", *words, "--frames", "1001"]) == 0
    assert capsys.readouterr().out.endswith("\njudged: keys and rest, which the stage opens with\n")
