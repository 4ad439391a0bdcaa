# SPDX-License-Identifier: Apache-2.0
"""`asglight compare`: tables, JSON, pictures, and what it refuses."""

import json
from pathlib import Path

import image_files
import numpy as np
import pytest
import torch
from rich.console import Console
from torch import Tensor

from asglight.cli.commands import compare
from asglight.cli.main import main
from asglight.judging.compare import perceptual, spheres
from asglight.judging.metrics import METRIC_NAMES
from asglight.shading.balls import coverage

METHODS = "median-cut,sh"


def even_balls(maps: Tensor, size: int) -> Tensor:
    """Return balls that all show the mean of their map: a stand-in for seconds of work."""
    mean = maps.mean((1, 2))[:, None, None, None]
    return mean * coverage(size)[:, :, None].expand(3, size, size, 1)


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spheres, "render", even_balls)
    monkeypatch.setattr(perceptual, "hdr_flip", lambda balls, reference: None)


@pytest.fixture
def sky(tmp_path: Path) -> Path:
    folder = tmp_path / "sky"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for frame in (7, 8, 9):
        values = rng.random((16, 32, 3)).astype(np.float32)
        image_files.write_rgb(folder / f"sky.{frame}.exr", values)
    return folder


def test_tables_name_every_method_and_where_the_picture_is(
    sky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "out"
    assert main(["compare", str(sky), "-o", str(folder), "--methods", METHODS]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("sky, frame 7")
    rows = [line for line in out.splitlines() if line.startswith(("Harmonics", "Median cut"))]
    # in the order of the table, not of the option; twice: errors, then spheres
    assert [row.split()[0] for row in rows] == ["Harmonics", "Median"] * 2
    assert rows[0].split()[-1] == "–", "no HDR-FLIP here"
    picture = folder / "sky.7.png"
    assert out.splitlines()[-1] == f"{picture}: all methods in one picture"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "fitting sh" in err


def test_frames_and_json(
    sky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compare, "draw", lambda *arguments: None)
    words = ["compare", str(sky), "-o", str(tmp_path), "--methods", METHODS, "--frames", "8-9"]
    assert main([*words, "--floats", "30", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [frame["frame"] for frame in document["frames"]] == [8, 9]
    assert Path(document["frames"][1]["picture"]) == tmp_path / "sky.9.png"
    harmonics, lights = document["frames"][0]["methods"]
    assert (harmonics["name"], harmonics["floats"]) == ("sh", 27)
    assert (lights["name"], lights["floats"]) == ("median-cut", 30)
    assert lights["flux"] < 1e-6
    assert lights["hdr_flip"] is None
    assert set(lights["spheres"]["mirror"]) == {"rmse", "si_rmse", "angular"}
    assert lights["steps"] == lights["published_steps"] == 0


def test_a_name_in_brackets_is_printed_as_it_is() -> None:
    console = Console(width=80)
    with console.capture() as captured:
        console.print(compare.errors_table([], "sky[bold]"))
    assert captured.get().startswith("sky[bold]")


def test_errors_of_millions_do_not_fill_a_column() -> None:
    """Least squares under a sun can end black but for a spot; its tone mapping is then no scale."""
    huge, small = (
        compare.Result(
            name="srbf",
            floats=120,
            seconds=1.0,
            steps=0,
            errors=dict.fromkeys(METRIC_NAMES, 0.5),
            psnr=7.0,
            flip=None,
            spheres=dict.fromkeys(spheres.SPHERES, spheres.SphereErrors(rmse, 0.25, 8.0)),
            radiance=torch.zeros(2, 4, 3),
            balls=torch.zeros(3, 2, 2, 3),
        )
        for rmse in (73780929.2, 0.125)
    )
    console = Console(width=compare.WIDTH)
    with console.capture() as captured:
        console.print(compare.spheres_table([huge, small]))
    *_, first, second = captured.get().splitlines()
    assert first.split()[-9:] == ["7e+07", "0.250", "8.000"] * 3
    assert second.split()[-9:] == ["0.125", "0.250", "8.000"] * 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--methods", "sh,magic"], "methods: 'magic'; expected some of best, fast, paper"),
        (["--floats", "7"], "floats: 7; expected 8 (one lobe) to 400"),
        (["--floats", "401"], "floats: 401; expected 8 (one lobe) to 400"),
        (["--full", "--quick"], "not allowed with argument"),
        (["--frames", "20"], "has none of the frames 20"),
    ],
)
def test_faults_are_one_line(
    sky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main(["compare", str(sky), "-o", str(tmp_path / "out"), *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_black_map_cannot_be_compared_by(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image_files.constant(tmp_path / "night.exr", 0.0)
    assert main(["compare", str(tmp_path / "night.exr"), "-o", str(tmp_path)]) == 2
    assert "night.exr: has no light in it; expected some" in capsys.readouterr().err


def test_a_folder_that_is_a_file_is_refused(
    sky: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "text.txt").write_text("")
    assert main(["compare", str(sky), "-o", str(tmp_path / "text.txt")]) == 2
    assert "text.txt: cannot be made" in capsys.readouterr().err
