# SPDX-License-Identifier: Apache-2.0
"""`asglight figures`: what it writes, what it says, what it refuses."""

import json
from pathlib import Path
from typing import Any

import image_files
import numpy as np
import pytest
from torch import Tensor

from asglight.cli.commands import figures
from asglight.cli.main import main
from asglight.cli.sources import built_in
from asglight.judging.paper_figures import data as paper_figures
from asglight.sky import SkyConfig, radiance

FRAMES = (1001, 1002, 1003)


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the built-in environment small, and balls plain: means of their map."""

    def balls(maps: Tensor, roughness: tuple[float, ...], *, size: int) -> Tensor:
        mean = maps.mean((1, 2))[:, None, None, None]
        return mean.expand(-1, len(roughness), size, size, 3)

    def environment(frame: int) -> Tensor:
        return radiance(SkyConfig(FRAMES), frame, 16)

    monkeypatch.setattr(paper_figures, "render_balls", balls)
    monkeypatch.setattr(built_in, "FRAMES", FRAMES)
    monkeypatch.setattr(built_in, "environment", environment)


def document(folder: Path, figure: str) -> dict[str, Any]:
    """Return the numbers, once picture and caption are there."""
    assert (folder / f"figure-{figure}.png").read_bytes().startswith(b"\x89PNG")
    caption = (folder / f"figure-{figure}.md").read_text()
    assert caption.startswith("## ")
    assert f"](figure-{figure}.png)" in caption
    assert f"`asglight figures {figure} " in caption
    return json.loads((folder / f"figure-{figure}.json").read_text())


@pytest.mark.parametrize(
    ("figure", "options", "labels"),
    [
        ("lobes", ["--lobes", "2,1", "--steps", "3", "--rows", "8"], ["1", "2", "1", "2"]),
        (
            "losses",
            ["--lobes", "2", "--steps", "3", "--rows", "8", "--starts", "1"],
            ["L1 + L_D", "L1", "L2 + L_D", "L2", "L2 of log", "L2 of sRGB", "fast, for comparison"],
        ),
        ("forms", ["--lobes", "2", "--dark"], None),
    ],
)
def test_a_still_s_figure_is_a_picture_a_caption_and_numbers(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    figure: str,
    options: list[str],
    labels: list[str] | None,
) -> None:
    folder = tmp_path / "new" / "out"
    assert main(["figures", figure, "-o", str(folder), *options]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-3:] == [
        str(folder / f"figure-{figure}.{suffix}") for suffix in ("png", "md", "json")
    ]
    assert "| env | flux | irr |" in out
    assert "rendering balls" in err, "progress"
    found = document(folder, figure)
    assert (found["input"], found["frames"], found["rows"]) == (built_in.NAME, [1001], 16)
    if labels is None:
        assert [fit["form"] for fit in found["fits"]] == ["sg", "sg", "asg", "bingham"]
    else:
        assert [fit["label"] for fit in found["fits"]] == labels
        recipes = [fit for fit in found["fits"] if fit["method"] == "paper"]
        assert {fit["steps"] for fit in recipes} == {3}
    assert all(fit["env"] > 0 for fit in found["fits"])


def test_the_caption_says_what_rows_a_small_map_has(tmp_path: Path) -> None:
    words = ["figures", "lobes", "-o", str(tmp_path), "--lobes", "1", "--steps", "2"]
    assert main([*words, "--rows", "64"]) == 0  # of a map of 16
    assert document(tmp_path, "lobes")["paper"] == {"steps": 2, "rows": 16}
    caption = " ".join((tmp_path / "figure-lobes.md").read_text().split())
    assert "2 of its 24,000 Adam steps on 16 x 32 texels (published: 256 rows)" in caption


def test_time_follows_the_frames_that_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["figures", "time", "-o", str(tmp_path), "--lobes", "2", "--steps", "4", "--rows", "8"]
    assert main([*words, "--frames", "1002-1003", "--json", "--latitude", "10"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == document(tmp_path, "time")
    assert printed["frames"] == [1002, 1003]
    assert "Row 7 of the map, at +6 degrees" in (tmp_path / "figure-time.md").read_text()
    assert [way["name"] for way in printed["fits"]] == [
        "with L_T", "without L_T", "independent", "fast"
    ]  # fmt: skip
    assert [way["steps"] for way in printed["fits"]] == [4 + 1, 4 + 1, 4 + 4, 0]
    assert printed["command"].endswith("--rows 8 --latitude 10.0 --frames 1002-1003")


def test_images_are_read_as_other_commands_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / "sky.exr"
    image_files.write_rgb(path, rng.random((16, 32, 3)).astype(np.float32))
    folder = tmp_path / "out"
    options = ["--lobes", "1", "--steps", "2", "--rows", "8"]
    assert main(["figures", "lobes", str(path), "-o", str(folder), *options]) == 0
    found = document(folder, "lobes")
    assert (found["input"], found["rows"], len(found["frames"])) == ("sky", 16, 1)
    assert found["command"].startswith(f"asglight figures lobes {path} --lobes 1 ")
    assert "reading sky" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["lobes", "--lobes", "1,x"], "lobes: '1,x'; expected numbers from 1 to 120"),
        (["lobes", "--lobes", "0,4"], "lobes: '0,4'; expected numbers from 1 to 120"),
        (["forms", "--lobes", "121"], "lobes: '121'; expected one number from 1 to 120"),
        (["forms", "--lobes", "4,8"], "lobes: '4,8'; expected one number. For several: asglight"),
        (["losses", "--steps", "0"], "steps: 0; expected 1 to 24000"),
        (["losses", "--steps", "24001"], "steps: 24001; expected 1 to 24000"),
        (["lobes", "--rows", "7"], "rows: 7; expected 8 to 256"),
        (["losses", "--starts", "10"], "starts: 10; expected 1 to 9"),
        (["time", "--latitude", "91"], "latitude: 91.0; expected -90 to 90"),
        (["forms", "--starts", "2"], "unrecognized arguments: --starts"),
        (["time", "--frames", "1002"], "built-in environment: has one frame; expected two or more"),
        (["time", "--frames", "1002-1004"], "frames: 1004; expected some of 1001, 1002, 1003 of"),
        (["forms", "--layer", "left"], "--layer: given without images; expected them as INPUT"),
        (["forms", "--input-colorspace", "ACEScg"], "--input-colorspace: given without images"),
        (["magic"], "invalid choice: 'magic'"),
        ([], "the following arguments are required: FIGURE"),
    ],
)
def test_faults_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main(["figures", *words, *(["-o", str(tmp_path / "out")] if words else [])]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_still_has_no_time_and_a_black_map_no_light(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image_files.constant(tmp_path / "night.exr", 0.0)
    path = str(tmp_path / "night.exr")
    assert main(["figures", "time", path, "-o", str(tmp_path)]) == 2
    assert "night: has one frame; expected two or more to stack" in capsys.readouterr().err
    assert main(["figures", "forms", path, "-o", str(tmp_path)]) == 2
    assert "night.exr: has no light in it; expected some" in capsys.readouterr().err


def test_help_has_an_example_a_figure(capsys: pytest.CaptureFixture[str]) -> None:
    for figure in figures.FIGURES:
        assert main(["figures", figure, "--help"]) == 0
        out = capsys.readouterr().out
        assert f"example: asglight figures {figure} sky.exr -o figures-output" in out
        assert ("--starts" in out) == (figure == "losses")
    assert main(["figures", "--help"]) == 0
    assert "docs/results/figures.md" in capsys.readouterr().out
