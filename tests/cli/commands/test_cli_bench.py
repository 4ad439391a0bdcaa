# SPDX-License-Identifier: Apache-2.0
"""`asglight bench`: what it writes and prints, its gate, and what it refuses."""

import json
from pathlib import Path
from typing import Any

import bench_records
import image_files
import numpy as np
import pytest
from matplotlib.figure import Figure

from asglight.cli.main import main
from asglight.judging.bench import page as bench_page
from asglight.judging.bench import plots as bench_plots
from asglight.judging.bench import run as bench
from asglight.judging.pictures import layout

ALL_PICTURES = bench_plots.pictures


def record_of(given: bench.Input) -> dict[str, Any]:
    if len(given.frames) > 1:
        return bench_records.sequence(given.name, given.frames) | given.facts()
    return bench_records.still(given.name) | given.facts()


@pytest.fixture(autouse=True)
def measured(monkeypatch: pytest.MonkeyPatch) -> list[bench.Input]:
    """Stand in for minutes of work; return what was to be measured."""
    asked: list[bench.Input] = []

    def stand_in(given: bench.Input, *_: object) -> dict[str, Any]:
        asked.append(given)
        return record_of(given)

    monkeypatch.setattr(bench, "measured", stand_in)
    return asked


@pytest.fixture(autouse=True)
def one_small_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw in no time; the pictures have tests of their own."""

    def draw(record: dict[str, Any], theme: layout.Theme) -> Figure:
        return layout.sheet(100, 100, "", "", theme)

    monkeypatch.setattr(bench_plots, "pictures", lambda record: {"time": draw})


@pytest.fixture
def still(tmp_path: Path) -> Path:
    values = np.random.default_rng(0).random((16, 32, 3)).astype(np.float32)
    return image_files.write_rgb(tmp_path / "lamp.exr", values)


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    folder = tmp_path / "shot"
    folder.mkdir()
    for frame in range(1, 11):
        image_files.constant(folder / f"shot.{frame}.exr", 0.5)
    return folder


def test_page_json_and_pictures_are_written(
    still: Path,
    shot: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn_small = bench_plots.pictures

    def pictures(record: dict[str, Any]) -> dict[str, Any]:
        """Draw those of the shot, which are all; of the still as many, in no time."""
        found = ALL_PICTURES(record)
        return found if record["name"] == "shot" else dict.fromkeys(found, drawn_small({})["time"])

    monkeypatch.setattr(bench_plots, "pictures", pictures)
    folder = tmp_path / "new" / "out"
    assert main(["bench", str(still), str(shot), "-o", str(folder), "--quick"]) == 0
    drawn = ("time", "lobes", "scaling")
    names = {f"lamp.{name}.png" for name in drawn}
    names |= {f"shot.{name}.png" for name in (*drawn, "following")}
    assert {path.name for path in folder.iterdir()} == names | {"bench.html", "bench.json"}
    whole = json.loads((folder / "bench.json").read_text())
    assert [record["name"] for record in whole["inputs"]] == ["lamp", "shot"]
    assert (whole["asglight_bench"], whole["effort"], whole["lobes"]) == (1, "quick", 15)
    assert whole["command"] == f"asglight bench {still} {shot} --quick"
    out, err = capsys.readouterr()
    assert out.startswith("lamp, 120 floats\nmethod")
    assert "following 8 frames" in out
    assert "Ahead of" in out or "No other method" in out
    assert out.splitlines()[-1] == f"{folder / 'bench.html'}: everything, in one page"
    assert "drawing" in err


def test_a_sequence_is_read_as_far_as_it_is_followed(
    shot: Path, tmp_path: Path, measured: list[bench.Input]
) -> None:
    words = ["bench", str(shot), "-o", str(tmp_path / "out")]
    assert main([*words, "--quick"]) == 0
    assert main(words) == 0
    assert main([*words, "--frames", "2-5", "--full"]) == 0
    assert [given.frames for given in measured] == [
        tuple(range(1, 9)),
        tuple(range(1, 11)),
        (2, 3, 4, 5),
    ]
    assert len(measured[0].references) == 8


def test_frames_that_were_asked_for_are_followed_at_every_effort(
    shot: Path, tmp_path: Path, measured: list[bench.Input]
) -> None:
    words = ["-o", str(tmp_path / "out"), "--quick"]
    assert main(["bench", str(shot), *words, "--frames", "1-10"]) == 0
    assert main(["bench", str(shot / "shot.2-10#.exr"), *words]) == 0
    assert [given.frames for given in measured] == [tuple(range(1, 11)), tuple(range(2, 11))]
    assert len(measured[0].references) == 10


def test_the_scaling_starts_from_the_map_as_its_file_has_it(
    tmp_path: Path, measured: list[bench.Input]
) -> None:
    path = image_files.constant(tmp_path / "fine.exr", 0.5, height=300)
    assert main(["bench", str(path), "-o", str(tmp_path / "out"), "--full"]) == 0
    assert measured[0].references[0].shape == (256, 512, 3)
    assert measured[0].source.shape == (300, 600, 3)


def test_images_are_in_the_space_that_the_user_says(
    tmp_path: Path, measured: list[bench.Input]
) -> None:
    values = np.broadcast_to(np.array([9.0, 6.0, 3.0], np.float32), (16, 32, 3)).copy()
    path = image_files.write_rgb(tmp_path / "aces.exr", values)
    folder = tmp_path / "out"
    assert main(["bench", str(path), "-o", str(folder), "--input-colorspace", "ACEScg"]) == 0
    # the published matrix from ACEScg to Rec.709, in five digits
    matrix = [[1.70505, -0.62179, -0.08326], [-0.13026, 1.1408, -0.01055]]
    matrix.append([-0.024, -0.12897, 1.15297])
    wanted = np.array(matrix) @ np.array([9.0, 6.0, 3.0])
    (given,) = measured
    for radiance in (given.references[0], given.source):
        np.testing.assert_allclose(radiance[8, 16].numpy(), wanted, rtol=1e-4)
    command = json.loads((folder / "bench.json").read_text())["command"]
    assert command == f"asglight bench {path} --input-colorspace ACEScg"


def test_json_is_one_document(
    still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", str(still), "-o", str(tmp_path / "out"), "--quick", "--json"]) == 0
    whole = json.loads(capsys.readouterr().out)
    assert whole["worse"] is None
    written = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert whole["inputs"] == written["inputs"]


def test_a_gate_passes_what_is_as_good_and_stops_what_is_worse(
    still: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    base = tmp_path / "base.json"
    words = ["bench", str(still), "-o", str(tmp_path / "out"), "--quick"]
    assert main([*words, "--baseline", str(base)]) == 0
    assert main([*words, "--gate", str(base)]) == 0
    assert capsys.readouterr().out.endswith("gate: nothing is worse than the baseline\n")

    def worse(given: bench.Input, *_: object) -> dict[str, Any]:
        record = record_of(given)
        record["fits"][1]["points"][-1]["irr"] = 0.032
        return record

    monkeypatch.setattr(bench, "measured", worse)
    assert main([*words, "--gate", str(base)]) == 3
    assert capsys.readouterr().out.splitlines()[-1] == (
        "gate: lamp: fast, 15 lobes, irr is 0.032, was 0.02; at most 1.5 times as much is allowed"
    )
    assert main([*words, "--gate", str(base), "--json"]) == 3
    (found,) = json.loads(capsys.readouterr().out)["worse"]
    assert (found["metric"], found["now"]) == ("fast, 15 lobes, irr", 0.032)


def test_a_gate_for_another_run_is_refused_before_any_work(
    still: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    measured: list[bench.Input],
) -> None:
    base = tmp_path / "base.json"
    words = ["bench", str(still), "-o", str(tmp_path / "out")]
    assert main([*words, "--quick", "--baseline", str(base)]) == 0
    measured.clear()
    assert main([*words, "--gate", str(base)]) == 2
    assert "base.json: was written with effort quick, this run has default" in (
        capsys.readouterr().err
    )
    assert main([*words, "--gate", str(tmp_path / "none.json")]) == 2
    assert "none.json: No such file or directory; expected a baseline" in capsys.readouterr().err
    still.rename(tmp_path / "other.exr")
    words[1] = str(tmp_path / "other.exr")
    assert main([*words, "--quick", "--gate", str(base)]) == 2
    assert "base.json: has no input other; expected one of lamp" in capsys.readouterr().err
    assert measured == []


def test_an_interrupt_leaves_what_was_finished_and_no_half_file(
    still: Path, shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(given: bench.Input, *_: object) -> dict[str, Any]:
        if given.name == "shot":
            raise KeyboardInterrupt
        return record_of(given)

    monkeypatch.setattr(bench, "measured", interrupted)
    folder = tmp_path / "out"
    assert main(["bench", str(still), str(shot), "-o", str(folder), "--quick"]) == 130
    names = {path.name for path in folder.iterdir()}
    assert names == {"lamp.time.png", "bench.html", "bench.json"}
    assert len(json.loads((folder / "bench.json").read_text())["inputs"]) == 1


@pytest.mark.parametrize("moment", ["the page", "a picture", "json"])
def test_an_interrupt_while_writing_keeps_the_older_file_whole(
    still: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    folder = tmp_path / "out"
    words = ["bench", str(still), "-o", str(folder), "--quick"]
    assert main(words) == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    where = {
        "the page": (bench_page, "page"),
        "a picture": ("matplotlib.figure.Figure", "savefig"),
        "json": ("pathlib.Path", "write_text"),
    }[moment]
    if isinstance(where[0], str):
        monkeypatch.setattr(f"{where[0]}.{where[1]}", interrupt)
    else:
        monkeypatch.setattr(where[0], where[1], interrupt)
    assert main(words) == 130
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert after.keys() == before.keys()
    assert after["bench.html"] == before["bench.html"]
    json.loads(after["bench.json"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--lobes", "0"], "lobes: 0; expected 1 to 120."),
        (["--lobes", "121"], "lobes: 121; expected 1 to 120."),
        (["--paper-steps", "0"], "paper-steps: 0; expected 1 or more."),
        (["--quick", "--full"], "not allowed with argument"),
        (["--frames", "20"], "has none of the frames 20"),
    ],
)
def test_faults_are_one_line(
    still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert main(["bench", str(still), "-o", str(tmp_path / "out"), *words]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert message in last


def test_a_black_frame_is_named(
    shot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image_files.constant(shot / "shot.3.exr", 0.0)
    assert main(["bench", str(shot), "-o", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert "shot.3.exr: has no light in it; expected some, by which errors are counted" in err


def test_two_inputs_of_one_name_are_refused(
    still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", str(still), str(still), "-o", str(tmp_path / "out")]) == 2
    assert "lamp: is the name of two inputs; expected different ones" in capsys.readouterr().err


def test_a_folder_that_is_a_file_is_refused(
    still: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", str(still), "-o", str(still)]) == 2
    assert "lamp.exr: cannot be made" in capsys.readouterr().err


def test_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--help"]) == 0
    out = capsys.readouterr().out
    assert "example: asglight bench sky.exr -o bench-output --quick" in out
    assert "--gate" in out
