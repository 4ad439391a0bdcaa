# SPDX-License-Identifier: Apache-2.0
"""What `fit` and `info` say about what a shot did without."""

import io
import json
from pathlib import Path
from typing import Any

import pytest
import sky_files
from lobe_cases import lamps
from rich.console import Console
from rich.progress import Progress, TextColumn

from asglight.cli import progress
from asglight.cli.leaving_out import left_out_lines, tolerance_line
from asglight.cli.main import main
from asglight.images import Repair, write_exr
from asglight.lobes import texels
from asglight.shots.events import FrameDone, Searched, Started

NOTHING = {
    "budget": 1e-3,
    "black": 0,
    "unneeded": 0,
    "one_sharpness": 0,
    "static": 0,
    "repeated_frames": [],
    "lights": 3,
    "lit_at_once": 3,
}

WORST = {
    "lobes": 7,
    "tolerance": 0.02,
    "tolerance_met": True,
    "worst_errors": {
        "irr": {"error": 0.00412, "frame": 1003},
        "r0.5": {"error": 0.0191, "frame": 1007},
    },
}


@pytest.mark.parametrize(
    ("found", "lines"),
    [
        ({}, []),
        ({"black": 2}, ["left out: 2 lobes, black in every frame"]),
        ({"unneeded": 1}, ["left out: 1 lobe that nothing shows"]),
        (
            {"black": 1, "unneeded": 3},
            ["left out: 1 lobe, black in every frame; 3 lobes that nothing shows"],
        ),
        (
            {"one_sharpness": 2, "static": 1},
            [
                "simpler: 2 lobes with one sharpness; 1 lobe the same in every frame "
                "(balls change by 0.1 % at most)"
            ],
        ),
        (
            {"static": 4, "budget": 0.002},
            ["simpler: 4 lobes the same in every frame (balls change by 0.2 % at most)"],
        ),
        (
            {"repeated_frames": [1002, 1003, 1004, 1007]},
            ["repeated: 4 frames as the one before, not fitted again (1002-1004,1007)"],
        ),
        (
            {"repeated_frames": [9]},
            ["repeated: 1 frame as the one before, not fitted again (9)"],
        ),
    ],
)
def test_what_was_left_out_is_told_with_its_reason(found: dict[str, Any], lines: list[str]) -> None:
    assert left_out_lines({"left_out": NOTHING | found}) == lines


@pytest.mark.parametrize(
    "metadata",
    [
        {"left_out": {"black": 1}},
        {"left_out": "much"},
        {"left_out": NOTHING | {"one_sharpness": 2, "budget": "some"}},
        {"tolerance_met": True},
        {"tolerance_met": True, "worst_errors": 3, "tolerance": 0.1},
    ],
)
def test_an_account_of_another_version_is_told_as_such(metadata: dict[str, Any]) -> None:
    assert left_out_lines(metadata) == [
        "left out: the stage's account of it is of another version of asglight, or edited"
    ]


def test_a_stage_that_knows_nothing_of_it_says_nothing() -> None:
    assert left_out_lines({}) == []


def test_a_kept_tolerance_names_the_worst_frames() -> None:
    assert tolerance_line(WORST) == (
        "tolerance 0.02: met with 7 lobes; worst irr 0.0041 (frame 1003), r0.5 0.0191 (frame 1007)"
    )


def test_a_missed_tolerance_says_what_to_do() -> None:
    line = tolerance_line(WORST | {"tolerance_met": False, "lobes": 1})
    assert line == (
        "tolerance 0.02: missed with 1 lobe, the most allowed; worst irr 0.0041 (frame 1003), "
        "r0.5 0.0191 (frame 1007). Allow more with --max-lobes."
    )


def test_an_infinite_error_is_told() -> None:
    errors = {"irr": {"error": None, "frame": 1}}
    assert "worst irr infinite (frame 1)" in tolerance_line(WORST | {"worst_errors": errors})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tolerance", "0.02", "--lobes", "15"], "lobes: 15 beside a tolerance"),
        (["--max-lobes", "20"], "max lobes: 20 without a tolerance"),
        (["--tolerance", "0.02", "--preset", "paper"], "tolerance: given with --preset paper"),
        (["--tolerance", "2"], "tolerance: 2; expected a relative error above 0 and below 1"),
    ],
)
def test_options_that_exclude_each_other_are_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sky_files.write_frame(tmp_path / "a.exr", sky_files.sky(0))
    assert main(["fit", str(path), "-o", str(tmp_path / "a.usda"), *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert message in line
    assert not (tmp_path / "a.usda").exists()


def write_held(folder: Path) -> Path:
    """Write three frames of three lamps, of which the second repeats the first."""
    folder.mkdir()
    for frame, light in enumerate((8.0, 8.0, 4.0), 1):
        places = [(0.0, 1.0, 0.1), (1.0, 0.2, 0.0), (-0.3, 0.2, -1.0)]
        scene = lamps(places, [1.5, 40.0, 200.0], [1.0, light, 30.0])
        write_exr(folder / f"lamps.{frame}.exr", texels.texel_means(scene, 32, 64))
    return folder


def test_fit_and_info_say_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, stage = write_held(tmp_path / "in"), str(tmp_path / "a.usda")
    options = ["--tolerance", "0.05", "--max-lobes", "6", "--preset", "live"]
    assert main(["fit", str(source), "-o", stage, *options]) == 0
    out, err = capsys.readouterr()
    assert "frame 1 with 4 lobes: error 0.0" in err
    assert "frame 2 (2/3)  loss " in err
    assert ", as frame 1\n" in err
    lines = [
        line
        for line in out.splitlines()
        if line.startswith(("left out", "simpler", "repeated", "tolerance"))
    ]
    assert "repeated: 1 frame as the one before, not fitted again (2)" in lines
    assert lines[-1].startswith("tolerance 0.05: met with ")
    assert main(["info", stage]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert [line for line in shown if line in lines] == lines


def test_the_json_of_fit_and_info_holds_it_all(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, stage = write_held(tmp_path / "in"), str(tmp_path / "a.usda")
    options = ["--tolerance", "0.0001", "--max-lobes", "1", "--preset", "live", "--json"]
    assert main(["fit", str(source), "-o", stage, *options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["tolerance"], result["tolerance_met"]) == (0.0001, False)
    assert result["worst_errors"].keys() == {"irr", "r0.5"}
    assert result["worst_errors"]["r0.5"]["frame"] in (1, 3)
    assert [row["repeats"] for row in result["frames"]] == [None, 1, None]
    assert result["left_out"].keys() == NOTHING.keys()
    assert result["left_out"]["repeated_frames"] == [2]
    assert main(["info", stage, "--json"]) == 0
    metadata = json.loads(capsys.readouterr().out)["metadata"]
    for name in ("left_out", "tolerance", "tolerance_met", "worst_errors"):
        assert metadata[name] == result[name]
    assert (metadata["lobes"], metadata["max_lobes"]) == (1, 1)


def test_the_bar_shows_the_search_and_a_second_fit() -> None:
    done = FrameDone(1, 1, 2, 0.1, 0.0, 1.0, 1.0, Repair())
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=120)
    columns = (TextColumn("{task.description}"), TextColumn("{task.fields[numbers]}"))
    with Progress(*columns, console=console, auto_refresh=False) as shown:
        bar = progress.Bar(shown)
        bar(Started(2, 0))
        bar(Searched(1001, 4, 0.0312))
        shown.refresh()
        assert "frame 1001 with 4 lobes: error 0.0312" in screen.getvalue()
        bar(done)
        bar(Started(2, 0))
        bar(done)
        assert [task.completed for task in shown.tasks] == [1, 1]
