# SPDX-License-Identifier: Apache-2.0
"""`asglight resample`: what it writes is the old light at the old times, as the old stage was."""

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd
from usd_tracks import assert_same, contents, moving, of_every_kind, still

from asglight.cli.main import main
from asglight.lobes import LobeTracks, asg, motion
from asglight.usd import read_usd, write_usd
from asglight.usd.read.read_options import read_options

METADATA = {
    "preset": "fast",
    "source": "sky.####.exr",
    "asglight": "0.1.0",
    "loss": [0.5] * 12,
    "repairs": {
        "negative_texels": 2,
        "nonfinite_texels": 1,
        "frames": [1001],
        "frames_filled": [],
    },
}
NAMES = ("sun", "window", "lamp")
SHOT = replace(of_every_kind(range(1001, 1013)), metadata=METADATA, names=NAMES)
OPTIONS = {
    "representations": ("dome", "cards", "distant"),
    "distance": 50.0,
    "dome_height": 16,
    "meters_per_unit": 0.01,
    "up_axis": "Z",
    "primary_path": "/World/Env",
    "colorspace": "ACEScg",
    "distant_lights": 3,
    "card_texture": True,
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a shot of three lobes, the broad one in the fill, and a still."""
    folder = tmp_path_factory.mktemp("written")
    write_usd(SHOT, folder / "shot.usda", dome_height=16)
    write_usd(still(), folder / "still.usda", dome_height=16)
    return folder


@pytest.fixture
def here(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Go to a copy of the stages."""
    monkeypatch.chdir(shutil.copytree(written, tmp_path, dirs_exist_ok=True))
    return tmp_path


def resample(line: str) -> int:
    return main(["resample", *line.split()])


def in_old_time(tracks: LobeTracks, step: float) -> LobeTracks:
    """Return what a shot of other frames should hold: the first shot's light at their times."""
    old = read_usd("shot.usda")
    times = [old.frames[0] + step * place for place in range(len(tracks.frames))]
    return replace(tracks, lobes=motion.at(old, times))


@pytest.mark.usefixtures("here")
def test_every_new_frame_is_the_light_of_its_old_time(capsys: pytest.CaptureFixture[str]) -> None:
    assert resample("shot.usda -o wall.usda --fps 60") == 0
    first, *rest = capsys.readouterr().out.splitlines()
    assert re.fullmatch(
        r"wall\.usda: 3 lobes of form asg, 30 frames \(1001-1030\) at 60 fps, [\d.]+ kB", first
    )
    assert rest == [
        "resampled: 1001-1012 of shot.usda at 24 fps",
        "before, repaired: 1 NaN and 2 negative texels set to 0 in 1 frame (1001)",
    ]
    found = read_usd("wall.usda")
    assert (found.frames, found.fps, found.names) == (tuple(range(1001, 1031)), 60.0, NAMES)
    assert_same(found, in_old_time(found, 0.4))
    images = sorted(path.name for path in Path("wall_dome").iterdir())
    assert images == [f"wall.fill.{frame}.exr" for frame in found.frames]


@pytest.mark.usefixtures("here")
def test_half_the_speed_of_some_frames(capsys: pytest.CaptureFixture[str]) -> None:
    line = "resample shot.usda -o slow.usdc --speed 0.5 --frames 1003-1004 --json"
    assert main(line.split()) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames"] == [1003, 1004, 1005, 1006]
    assert (document["fps"], document["lobes"], document["form"]) == (24.0, 3, "asg")
    images = sum(path.stat().st_size for path in Path("slow_dome").iterdir())
    assert document["bytes"] == os.path.getsize("slow.usdc") + images
    assert document["samples_between"] > 0
    found, old = read_usd("slow.usdc"), read_usd("shot.usda")
    wanted = motion.at(old, [1003, 1003.5, 1004, 1004.5])
    assert_same(found, replace(found, lobes=wanted))


@pytest.mark.usefixtures("here")
def test_there_and_back_is_the_same_shot() -> None:
    assert resample("shot.usda -o twice.usda --fps 48") == 0
    assert resample("twice.usda -o again.usda --fps 24") == 0
    found, old = read_usd("again.usda"), read_usd("shot.usda")
    assert found.names == old.names
    assert_same(replace(found, metadata=old.metadata), old)


@pytest.mark.usefixtures("here")
def test_the_stage_is_as_the_old_one_was() -> None:
    write_usd(SHOT, "other.usda", **OPTIONS)
    assert resample("other.usda -o new.usda --fps 30") == 0
    for name, value in OPTIONS.items():
        assert getattr(read_options("new.usda"), name) == (
            "lin_ap1_scene" if name == "colorspace" else value
        )
    assert resample("other.usda -o y.usda --fps 30 --up-axis Y --dome-height 8") == 0
    changed = read_options("y.usda")
    assert (changed.up_axis, changed.dome_height, changed.distance) == ("Y", 8, 50.0)


@pytest.mark.usefixtures("here")
def test_the_stage_remembers_what_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    assert resample("shot.usda -o a.usda --speed 0.5 --fps 48") == 0
    assert resample("a.usda -o b.usda --frames 1001-1010") == 0
    metadata = read_usd("b.usda").metadata
    assert (metadata["preset"], metadata["source"]) == ("fast", "sky.####.exr")
    assert not {"loss", "repairs"} & metadata.keys()  # true of the old frames only
    first, second = metadata["resampled"]
    assert first == {
        "source": "shot.usda",
        "fps": 24.0,
        "frames": [1001, 1012],
        "speed": 0.5,
        "loss": METADATA["loss"],
        "repairs": METADATA["repairs"],
    }
    assert (second["source"], second["fps"], second["frames"]) == ("a.usda", 48.0, [1001, 1010])
    capsys.readouterr()
    assert main(["info", "b.usda"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "resampled: 1001-1012 of shot.usda at 24 fps, at 0.5 times the speed" in lines
    assert "before, repaired: 1 NaN and 2 negative texels set to 0 in 1 frame (1001)" in lines


@pytest.mark.usefixtures("here")
def test_lights_edited_elsewhere_count_and_are_told_of(capsys: pytest.CaptureFixture[str]) -> None:
    stage = Usd.Stage.Open("shot.usda")
    attribute = stage.GetPrimAtPath("/AsgRig/Lobes/lamp").GetAttribute("inputs:intensity")
    for time in attribute.GetTimeSamples() or [Usd.TimeCode.Default()]:
        attribute.Set(2 * attribute.Get(time), time)
    stage.Save()
    assert resample("shot.usda -o new.usda --fps 60") == 0
    assert "edited: /AsgRig/Lobes/lamp: light x 2" in capsys.readouterr().out
    found = read_usd("new.usda")
    wanted = asg.flux(motion.at(SHOT, [1001 + 0.4 * place for place in range(30)]))
    flux = asg.flux(found.lobes)
    # lights are written within 1e-4 of each value; four of them make a flux
    np.testing.assert_allclose(flux[:, 2], 2 * wanted[:, 2], rtol=1e-3)
    np.testing.assert_allclose(flux[:, :2], wanted[:, :2], rtol=1e-5)


@pytest.mark.usefixtures("here")
def test_one_of_several_rigs_is_taken(capsys: pytest.CaptureFixture[str]) -> None:
    shot = moving(range(1001, 1004))
    write_usd(shot, "right.usda", primary_path="/Right")
    root = Usd.Stage.CreateNew("both.usda")
    root.GetRootLayer().subLayerPaths[:] = ["./shot.usda", "./right.usda"]
    root.SetStartTimeCode(1001)
    root.SetEndTimeCode(1003)
    root.SetTimeCodesPerSecond(24)
    root.Save()
    assert resample("both.usda -o one.usda --speed 0.5") == 2
    assert "--rig /AsgRig" in capsys.readouterr().err
    assert resample("both.usda -o one.usda --speed 0.5 --rig /Right") == 0
    assert read_options("one.usda").primary_path == "/Right"
    assert_same(
        read_usd("one.usda"),
        replace(
            read_usd("one.usda"),
            lobes=motion.at(read_usd("right.usda"), [1001, 1001.5, 1002, 1002.5, 1003, 1003]),
        ),
    )


@pytest.mark.usefixtures("here")
def test_a_layer_that_retimes_is_smaller_and_less_right() -> None:
    """Why there is none: USD interpolates what a stage has, near the rule and not on it."""
    offset = 1001 - 1001 * 60 / 24  # USD itself scales time by the two rates
    Path("layer.usda").write_text(
        f"#usda 1.0\n(\n    subLayers = [@./shot.usda@ (offset = {offset})]\n"
        '    defaultPrim = "AsgRig"\n    upAxis = "Y"\n    metersPerUnit = 1\n'
        "    startTimeCode = 1001\n    endTimeCode = 1030\n    timeCodesPerSecond = 60\n)\n"
    )
    assert resample("shot.usda -o wall.usda --fps 60") == 0
    wall, layer = read_usd("wall.usda"), read_usd("layer.usda")
    assert (layer.frames, layer.fps) == (wall.frames, wall.fps)
    wanted = asg.flux(in_old_time(wall, 0.4).lobes).sum(-1)
    faint = 0.01 * wanted.sum(-1, keepdim=True)  # a lobe with less counts as having that
    off, exact = (
        ((asg.flux(one.lobes).sum(-1) - wanted).abs() / wanted.maximum(faint)).max()
        for one in (layer, wall)
    )
    assert exact < 1e-5 < 1e-3 < off < 3e-3


FAULTS = [
    ("", "resample: nothing to change; expected another rate. Add --fps, --speed or --frames"),
    ("--fps 0", "fps: 0; expected a finite number above 0"),
    ("--fps x", "--fps: 'x' is no frame rate; expected a number such as 24, 23.976 or 24000/1001"),
    ("--speed -2", "speed: -2; expected a finite number above 0"),
    ("--speed 99", "frames: 1001 to 1012 become one at 99 a new frame; expected two or more"),
    ("--speed 1e-9", "frames: 1001 to 1012 become 1.2e+10 at .* expected at most 1,000,000"),
    ("--frames 900-1010", "frames: 900-1010 reaches beyond shot.usda; expected frames within 1001"),
    ("--frames 1001-1011x2", "frames: 1001-1011x2 leaves out frames; expected a first and a last"),
    ("--frames ,", "frames: ,; expected whole frames such as"),
]


@pytest.mark.parametrize(("options", "message"), FAULTS, ids=[one for one, _ in FAULTS])
def test_a_fault_is_one_line_and_changes_nothing(
    here: Path, options: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = contents(here)
    assert main(["resample", "shot.usda", "-o", "new.usda", *options.split()]) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert re.search(message.replace("+", r"\+"), err)
    assert contents(here) == before


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("still.usda -o new.usda", "still.usda: has one frame, 1001, whose light is the same at"),
        ("shot.usda -o shot.usdc", "shot.usdc: would overwrite shot.usda or the images of its do"),
        ("none.usda -o new.usda", "none.usda: no such file"),
        ("shot.usda -o new.mov", "new.mov: extension '.mov'; expected .usda"),
        ("shot.usda -o none/new.usda", "none/new.usda: no folder none"),
    ],
)
def test_a_stage_that_cannot_be_is_refused(
    here: Path, line: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = contents(here)
    assert main(["resample", *line.split(), "--fps", "60"]) == 2
    assert message in capfd.readouterr().err
    assert contents(here) == before
