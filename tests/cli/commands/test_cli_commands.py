# SPDX-License-Identifier: Apache-2.0
import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sky_files
import torch

from asglight import read_usd
from asglight.cli.commands import evaluate, info
from asglight.cli.main import main
from asglight.images import read_latlong
from asglight.judging.metrics import METRIC_NAMES, frame_errors
from asglight.lobes import Form, Lobes, LobeTracks
from asglight.lobes.frames import axes_around


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Fit frames 1001 to 1004, which lie in `in`; return the stage beside it, and what is said."""
    folder = tmp_path_factory.mktemp("shot")
    sky_files.write_sequence(folder / "in")
    stage = folder / "shot.usda"
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(["fit", str(folder / "in"), "-o", str(stage), "--lobes", "3", "--json"]) == 0
    return stage, out.getvalue()


@pytest.fixture(scope="module")
def shot(fitted: tuple[Path, str]) -> Path:
    """Return a stage of frames 1001 to 1004, its images beside it in `in`."""
    return fitted[0]


def document(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """Return the one JSON document on standard output."""
    return parsed(capsys.readouterr().out)


def parsed(text: str) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def test_fit_prints_progress_on_one_stream_and_the_result_on_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sky_files.write_sequence(tmp_path / "in")
    stage = tmp_path / "shot.usdc"
    assert main(["fit", str(source), "-o", str(stage), "--lobes", "2", "--fps", "24000/1001"]) == 0
    out, err = capsys.readouterr()
    assert err.count("\n") == 5
    assert err.startswith("frame 1001 (1/4)  loss ")
    assert err.endswith("refined 4/4\n")
    first, kept, second, *_ = out.splitlines()
    # with far too few lobes for a sky, lights come and go: up to twice as many
    assert re.match(
        rf"{stage}: [234] lobes of form asg, 4 frames \(1001-1004\) at 23.976 fps, ", first
    )
    assert kept == (
        f"written as: cards; images of a dome on demand: asglight export {stage} --to dome"
    )
    assert second.startswith("flux error: at most ")
    assert read_usd(stage).fps == pytest.approx(24000 / 1001)


def test_fit_as_json_is_one_document(fitted: tuple[Path, str]) -> None:
    stage, result = fitted[0], parsed(fitted[1])
    assert result["output"] == str(stage)
    assert result["bytes"] >= stage.stat().st_size
    assert [row["frame"] for row in result["frames"]] == [1001, 1002, 1003, 1004]
    assert (result["fitted_lobes"], result["resumed"]) == (3, 0)
    assert 3 <= result["lobes"] <= 6
    assert result["left_out"]["lit_at_once"] <= 3
    assert (result["left_out"]["black"], result["left_out"]["unneeded"]) == (0, 0)
    assert "tolerance_met" not in result
    assert result["seconds"] == pytest.approx(sum(row["seconds"] for row in result["frames"]))


def test_repairs_and_filled_frames_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = sky_files.write_sequence(tmp_path / "in")
    values = sky_files.sky(1002)
    values[0, 0] = np.nan
    values[1, 1] = -1
    sky_files.write_frame(source / "sky.1002.exr", values)
    (source / "sky.1003.exr").unlink()
    stage = str(tmp_path / "shot.usda")
    assert main(["fit", str(source), "-o", stage, "--lobes", "2", "--missing", "hold"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == (
        "repaired: 1 NaN and 1 negative texels set to 0 in 1 frame (1002); "
        "1 missing or damaged frame filled (1003)"
    )
    assert "frame missing, held from 1002" in err
    assert main(["info", stage]) == 0
    assert out.splitlines()[-1] in capsys.readouterr().out


def test_a_black_lobe_that_is_left_out_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sky_files.write_frame(tmp_path / "black.exr", 0 * sky_files.sky(0))
    stage = str(tmp_path / "black.usda")
    assert main(["fit", str(path), "-o", stage, "--lobes", "3"]) == 0
    assert "left out: 2 lobes, black in every frame" in capsys.readouterr().out
    assert main(["info", stage]) == 0
    assert "left out: 2 lobes, black in every frame" in capsys.readouterr().out
    assert main(["eval", stage, "--reference", str(path)]) == 0


@pytest.mark.parametrize("representation", ["cards", "distant", "dome"])
def test_the_stage_holds_the_representation_that_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], representation: str
) -> None:
    from pxr import Usd

    path = sky_files.write_frame(tmp_path / "a.exr", sky_files.sky(0))
    stage = str(tmp_path / "a.usda")
    options = ["--lobes", "2", "--representations", representation]
    assert main(["fit", str(path), "-o", stage, *options]) == 0
    opened = Usd.Stage.Open(stage)
    assert not opened.GetDefaultPrim().HasVariantSets()
    kinds = {
        "cards": {"RectLight", "DomeLight"},
        "distant": {"DistantLight"},
        "dome": {"DomeLight"},
    }
    lights = {prim.GetTypeName() for prim in opened.Traverse() if "Light" in prim.GetTypeName()}
    assert lights
    assert lights <= kinds[representation]
    assert main(["info", stage]) == 0
    assert f"representation: {representation}\n" in capsys.readouterr().out


def test_the_paper_preset_is_reached(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = sky_files.write_frame(tmp_path / "a.exr", sky_files.sky(0))
    stage = str(tmp_path / "a.usda")
    options = ["--lobes", "2", "--preset", "paper", "--paper-steps", "3,2", "--form", "bingham"]
    assert main(["fit", str(path), "-o", stage, *options]) == 0
    metadata = read_usd(stage).metadata
    assert (metadata["preset"], metadata["form"]) == ("paper", "bingham")
    assert metadata["paper_steps"] == [3, 2]


@pytest.mark.parametrize("at_once", [1, 3, 8])
def test_eval_gives_the_metrics_of_each_frame(
    shot: Path, capsys: pytest.CaptureFixture[str], at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, "AT_ONCE", at_once)
    assert main(["eval", str(shot), "--reference", str(shot.parent / "in"), "--json"]) == 0
    result = document(capsys)
    tracks = read_usd(shot)
    for row in result["frames"]:
        image = read_latlong(shot.parent / "in" / f"sky.{row['frame']}.exr")
        expected = frame_errors(tracks.at(row["frame"]), image.radiance).values
        found = {name: row[name] for name in METRIC_NAMES}
        # frames that are judged together are summed in another order: float32 has 6e-8
        assert found == pytest.approx(expected, rel=1e-5, abs=1e-6)
    for name in METRIC_NAMES:
        values = {row["frame"]: row[name] for row in result["frames"]}
        assert result["mean"][name] == pytest.approx(sum(values.values()) / 4)
        assert values[result["worst"][name]] == max(values.values())
    assert result["mean"]["flicker"] > 0


def test_eval_prints_a_table_of_the_chosen_frames(
    shot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = str(shot.parent / "in" / "sky.####.exr")
    assert main(["eval", str(shot), "--reference", reference, "--frames", "1002-1003"]) == 0
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert lines[0].split() == ["frame", *METRIC_NAMES]
    firsts = ["1002", "1003", "mean", "worst", "flicker", "judged:"]
    assert [line.split()[0] for line in lines[1:]] == firsts
    assert len({len(line) for line in lines[:4]}) == 1
    assert err == "judging (2)\n"


def test_eval_of_one_frame_has_no_flicker(shot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reference = str(shot.parent / "in")
    assert main(["eval", str(shot), "--reference", reference, "--frames", "1002"]) == 0
    assert "flicker" not in capsys.readouterr().out


def test_an_infinite_error_is_null_in_json(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    black = sky_files.write_frame(tmp_path / "a.1001.exr", 0 * sky_files.sky(0))
    options = ["--reference", str(black), "--frames", "1001", "--json"]
    assert main(["eval", str(shot), *options]) == 0
    assert document(capsys)["mean"]["env"] is None


def test_info_as_json_names_shot_and_lobes(shot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(shot), "--json"]) == 0
    result = document(capsys)
    assert result["frames"] == [1001, 1002, 1003, 1004]
    assert (result["fps"], result["form"]) == (24.0, "asg")
    assert result["bytes"] == shot.stat().st_size
    assert result["metadata"]["source"] == "sky.####.exr"
    names = [row["lobe"] for row in result["lobes"]]
    assert names == [f"lobe_{index:02d}" for index in range(len(names))]
    assert 3 <= len(names) <= 6
    assert sum(row["flux_share"] for row in result["lobes"]) == pytest.approx(1)


def test_info_prints_what_a_user_asks_first(shot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(shot)]) == 0
    out = capsys.readouterr().out
    assert re.search(rf"{shot}: [3-6] lobes of form asg, 4 frames \(1001-1004\) at 24 fps, ", out)
    assert "representation: cards" in out
    assert "fitted: preset fast, from sky.####.exr, asglight " in out
    assert "lobe_02" in out


def one_lobe(directions: list[list[float]], amplitude: list[float]) -> LobeTracks:
    axis_z = torch.tensor(directions)[:, None]
    levels = torch.tensor(amplitude)[:, None, None].expand(-1, 1, 3)
    frames = len(directions)
    lobes = Lobes(axes_around(axis_z), torch.full((frames, 1, 2), 8.0), levels, Form.ASG)
    return LobeTracks(tuple(range(frames)), 24.0, lobes)


@pytest.mark.parametrize(
    ("direction", "longitude", "latitude"),
    [
        ([0.0, 0.0, 1.0], 0.0, 0.0),
        ([1.0, 0.0, 0.0], 90.0, 0.0),
        ([-1.0, 0.0, 0.0], -90.0, 0.0),
        ([0.0, 0.6, -0.8], 180.0, 36.8699),
    ],
)
def test_info_gives_longitude_and_latitude_of_the_latlong(
    direction: list[float], longitude: float, latitude: float
) -> None:
    (row,) = info.lobe_rows(one_lobe([direction], [1.0]))
    assert row["longitude_deg"] == pytest.approx(longitude, abs=1e-4)  # float32 directions
    assert row["latitude_deg"] == pytest.approx(latitude, abs=1e-4)


def test_info_counts_only_lit_frames_and_where_they_point() -> None:
    tracks = one_lobe([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [1.0, 1.0, 0.0])
    (row,) = info.lobe_rows(tracks)
    assert row["lit_frames"] == 2
    assert row["longitude_deg"] == pytest.approx(45)
    assert row["latitude_deg"] == pytest.approx(0)
    assert row["moves_deg"] == pytest.approx(45)
    assert row["flux_share"] == pytest.approx(1)  # of the frames that have light


@pytest.mark.parametrize("light", [1e-20, 0.0])
def test_info_tells_where_a_dim_or_black_lobe_points(light: float) -> None:
    (row,) = info.lobe_rows(one_lobe([[0.0, 0.6, -0.8]] * 2, [light] * 2))
    assert row["direction"] == pytest.approx([0.0, 0.6, -0.8])
    assert row["moves_deg"] == pytest.approx(0.0, abs=0.05)  # float32 directions
