# SPDX-License-Identifier: Apache-2.0
"""What the command line says of a stage is how the stage is written."""

import json
from pathlib import Path

import pytest
import sky_files
import torch
from pxr import Usd, UsdLux

from asglight import read_usd
from asglight.cli.main import main
from asglight.cli.sources.opening import Request, opened
from asglight.lobes import asg
from asglight.usd.options import StageOptions
from asglight.usd.read.read_options import read_options

WORDS = {
    "--representations": "distant,cards,dome",
    "--primary-path": "/World/Lights/Env",
    "--up-axis": "Z",
    "--meters-per-unit": "0.01",
    "--distance": "50",
    "--colorspace": "ACEScg",
    "--dome-height": "16",
    "--distant-lights": "3",
}
OPTIONS = StageOptions(
    ("distant", "cards", "dome"),
    50.0,
    16,
    0.01,
    "Z",
    "/World/Lights/Env",
    "lin_ap1_scene",
    3,
    card_texture=True,
)


def words() -> list[str]:
    return [*(word for pair in WORDS.items() for word in pair), "--card-texture"]


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return sky_files.write_sequence(tmp_path_factory.mktemp("images") / "in")


@pytest.fixture(scope="module")
def parts(images: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return two parts of a shot, the first with every option, the second with none."""
    folder = tmp_path_factory.mktemp("parts")
    files = [str(folder / f"part.{k}.usdc") for k in (1, 2)]
    fit = ["fit", str(images), "--lobes", "2", "--json", "--frames"]
    assert main([*fit, "1001-1002", "-o", files[0], *words()]) == 0
    assert main([*fit, "1002-1003", "-o", files[1]]) == 0
    return files


@pytest.fixture(scope="module")
def package(parts: list[str], tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the shot of both parts, stitched without a word on how."""
    shot = str(tmp_path_factory.mktemp("package") / "shot.usdz")
    assert main(["stitch", *parts, "-o", shot, "--json"]) == 0
    return shot


def test_a_fit_writes_what_is_asked_for(parts: list[str]) -> None:
    assert read_options(parts[0]) == OPTIONS
    assert read_options(parts[1]) == StageOptions(distance=1000.0)


def test_the_options_change_nothing_of_the_lobes(images: Path, tmp_path: Path) -> None:
    fit = ["fit", str(images), "--frames", "1001", "--lobes", "2", "--json", "-o"]
    assert main([*fit, str(tmp_path / "a.usdc")]) == 0
    assert main([*fit, str(tmp_path / "b.usdz"), *words()]) == 0
    plain, other = (read_usd(tmp_path / name).lobes for name in ("a.usdc", "b.usdz"))
    # float32, through the primaries of ACEScg and back
    torch.testing.assert_close(other.amplitude, plain.amplitude, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(other.axis_z, plain.axis_z, rtol=0, atol=1e-6)


def test_the_space_of_the_colours_is_told_by_its_whole_name(
    images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenColorIO knows ACES2065-1 as ACES too, which people say of ACEScg."""
    stage = tmp_path / "a.usda"
    fit = ["fit", str(images), "--frames", "1001", "--lobes", "2", "-o", str(stage)]
    assert main([*fit, "--colorspace", "aces"]) == 0
    assert "\nwritten as: cards, in ACES2065-1; " in capsys.readouterr().out
    assert "lin_ap0_scene" in stage.read_text()


def test_a_stitched_shot_is_written_as_its_first_part_or_as_asked_for(
    parts: list[str], package: str, tmp_path: Path
) -> None:
    assert read_options(package) == OPTIONS
    shot = str(tmp_path / "shot.usdz")
    asked = ["--up-axis", "Y", "--distant-lights", "1", "--no-card-texture"]
    assert main(["stitch", *parts, "-o", shot, *asked, "--json"]) == 0
    every = OPTIONS.representations
    assert read_options(shot) == StageOptions(
        every, 50.0, 16, 0.01, "Y", "/World/Lights/Env", "lin_ap1_scene"
    )


def test_options_that_change_nothing_in_the_first_part_are_those_of_the_shot(
    images: Path, tmp_path: Path
) -> None:
    """Lobes of the form sg are round: they have one distant light, whatever was asked for."""
    parts = [str(tmp_path / f"part.{k}.usdc") for k in (1, 2)]
    fit = ["fit", str(images), "--form", "sg", "--lobes", "2", "--json"]
    for part, frames in zip(parts, ("1001-1002", "1002-1003"), strict=True):
        stage = ["--representations", "distant", "--distant-lights", "3"]
        assert main([*fit, "--frames", frames, "-o", part, *stage]) == 0
    assert main(["stitch", *parts, "-o", str(tmp_path / "shot.usdc"), "--json"]) == 0
    assert read_options(tmp_path / "shot.usdc").distant_lights == 3


def test_a_view_opens_a_package(package: str, tmp_path: Path) -> None:
    picture = tmp_path / "a.png"
    assert main(["view", package, "--screenshot", str(picture), "--size", "160x120"]) == 0
    assert picture.stat().st_size > 0


def test_names_are_kept_where_a_stage_is_written_again(images: Path, tmp_path: Path) -> None:
    fit = ["fit", str(images), "--frames", "1001", "--lobes", "2", "--json", "-o"]
    stage = tmp_path / "a.usda"
    assert main([*fit, str(stage)]) == 0
    stage.write_text(stage.read_text().replace("lobe_00", "key"))
    assert main([*fit, str(stage)]) == 0
    assert read_usd(stage).names == ("key", "lobe_01")
    assert main([*fit, str(tmp_path / "v2.usda"), "--names-from", str(stage)]) == 0
    assert read_usd(tmp_path / "v2.usda").names == ("key", "lobe_01")
    assert main([*fit, str(tmp_path / "v3.usda")]) == 0
    assert read_usd(tmp_path / "v3.usda").names == ("lobe_00", "lobe_01")


def test_what_is_in_the_way_and_no_stage_is_replaced_and_told_of(
    images: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    fit = ["fit", str(images), "--frames", "1001", "--lobes", "2", "-o"]
    assert main([*fit, str(tmp_path / "a.usda")]) == 0
    assert "a.usda: holds no AsgLobeAPI prim; expected" in (err := capsys.readouterr().err)
    assert "Lights are named anew" in err
    assert read_usd(tmp_path / "a.usda").names == ("lobe_00", "lobe_01")


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--primary-path World", "primary path: World; expected a prim path such as /World/L"),
        ("--up-axis X", "--up-axis: invalid choice: 'X'"),
        ("--meters-per-unit 0", "meters per unit: 0; expected a finite number above 0"),
        ("--distance -1", "distance: -1; expected a finite number above 0"),
        ("--distance far", "--distance: invalid float value: 'far'"),
        ("--dome-height 1", "dome height: 1; expected 2 rows or more"),
        ("--colorspace sRGB", "colorspace: sRGB; expected a linear space with primaries: Linear"),
        ("--names-from no.usda", "no.usda: no such file; expected a USD stage"),
    ],
)
@pytest.mark.parametrize("command", ["fit", "stitch"])
def test_a_fault_is_told_before_anything_is_fitted(
    command: str,
    option: str,
    message: str,
    images: Path,
    parts: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    inputs = [str(images)] if command == "fit" else parts
    if command == "stitch" and "names" in option:
        message = "unrecognized arguments: --names-from no.usda"
    assert main([command, *inputs, "-o", str(tmp_path / "x.usda"), *option.split()]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["fit", "stitch"])
def test_help_offers_every_option(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    text = capsys.readouterr().out
    assert all(word in text for word in WORDS)
    assert "--primary-path /World/Lights/Env --up-axis Z" in text


def test_info_and_view_say_what_another_program_edited(
    parts: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = str(tmp_path / "shot.usda")
    distant = ["--representations", "distant"]  # a lobe is one light
    assert main(["stitch", parts[1], "-o", shot, "--json", *distant]) == 0
    stage = Usd.Stage.Open(shot)
    for index in (0, 1):
        light = UsdLux.LightAPI(stage.GetPrimAtPath(f"/AsgRig/Lobes/lobe_0{index}"))
        light.CreateExposureAttr(index + 1.0)
    stage.GetRootLayer().Save()
    capsys.readouterr()
    assert main(["info", shot]) == 0
    out = capsys.readouterr().out
    assert "edited: /AsgRig/Lobes/lobe_00: light x 2\n" in out
    assert "edited: /AsgRig/Lobes/lobe_01: light x 4\n" in out
    assert main(["info", shot, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changes"] == [
        "/AsgRig/Lobes/lobe_00: light x 2",
        "/AsgRig/Lobes/lobe_01: light x 4",
    ]
    session = opened(Request(input=shot))
    assert session.source.status().message == (
        "lights edited since the fit: /AsgRig/Lobes/lobe_00: light x 2; "
        "and 1 more, see asglight info"
    )
    session.close()


def test_images_are_in_the_space_that_the_user_says(images: Path, tmp_path: Path) -> None:
    """The lamp is (9, 6, 3) on 0.1; a fit of it in ACEScg has the light of Rec.709's matrix."""
    fit = ["fit", str(images), "--frames", "1001", "--lobes", "2", "--json"]
    asked = ["--input-colorspace", "ACEScg"]
    plain, other = tmp_path / "a.usdc", tmp_path / "b.usdc"
    assert main([*fit, "-o", str(plain)]) == 0
    assert main([*fit, "-o", str(other), *asked]) == 0
    matrix = torch.tensor(
        [
            [1.70505, -0.62179, -0.08326],
            [-0.13026, 1.14080, -0.01055],
            [-0.02400, -0.12897, 1.15297],
        ]
    )
    flux = [asg.flux(read_usd(path).lobes[0]).sum(0) for path in (plain, other)]
    # each channel of a fit keeps its flux to some 1e-3
    torch.testing.assert_close(flux[1], matrix @ flux[0], rtol=1e-2, atol=0)
    assert main(["eval", str(other), "--reference", str(images), "--frames", "1001", *asked]) == 0
    assert read_usd(other).metadata["input_colorspace"] == "ACEScg"
