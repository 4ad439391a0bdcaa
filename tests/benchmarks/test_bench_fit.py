# SPDX-License-Identifier: Apache-2.0
"""`benchmarks/fits`: what it writes and prints, and the arithmetic behind its tables."""

import contextlib
import io
import json
import math
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import pytest
import torch
from bench_scripts import module

from asglight.images import write_exr
from asglight.lobes import Lobes
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from benchmarks.results.blocks import blocks, tables

fit = module("fits.__main__")
fit_following = module("fits.following")
fit_leaving_out = module("fits.leaving_out")
fit_measures = module("fits.measures")
fit_tables = module("fits.tables")

PICTURES = ("accuracy.png", "curves.png", "following.png")
PAPER_STEPS, LOBES, FRAMES = 12, 2, 3


@pytest.fixture(scope="module", autouse=True)
def threads() -> Iterator[None]:
    """Give the other tests their threads back."""
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def lit_map(rows: int, turned_deg: float) -> torch.Tensor:
    """Return a dim sky with one lamp on the horizon.  [H, W, 3]."""
    directions = latlong.directions(rows, 2 * rows)
    turn = math.radians(turned_deg)
    lamp = torch.tensor([math.sin(turn), 0.2, math.cos(turn)])
    glow = 30 * torch.exp(40 * (directions @ torch.nn.functional.normalize(lamp, dim=0) - 1))
    sky = 0.5 + 0.3 * directions[..., 1]
    return (glow + sky)[..., None] * torch.tensor([1.0, 0.9, 0.7])


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a folder of three maps, and one of a sequence."""
    root = tmp_path_factory.mktemp("bench")
    (root / "maps").mkdir()
    (root / "sequences" / "lamp").mkdir(parents=True)
    for index, name in enumerate(("attic", "barn", "cellar")):
        write_exr(root / "maps" / f"{name}.exr", lit_map(8, 50.0 * index))
    (root / "maps" / "README.md").write_text("no map")
    for index in range(FRAMES):
        write_exr(root / "sequences" / "lamp" / f"lamp.{1001 + index}.exr", lit_map(8, 3 * index))
    return {"maps": root / "maps", "sequences": root / "sequences", "output": root / "out"}


@pytest.fixture(scope="module")
def words(folders: dict[str, Path]) -> list[str]:
    options = {"--maps": "maps", "--sequences": "sequences", "-o": "output"}
    return [word for option, name in options.items() for word in (option, str(folders[name]))]


@pytest.fixture(scope="module")
def printed(words: list[str]) -> str:
    """Run once; return standard output."""
    sizes = {"--paper-steps": PAPER_STEPS, "--lobes": LOBES, "--threads": 1}
    more = [str(word) for pair in sizes.items() for word in pair]
    with contextlib.redirect_stdout(io.StringIO()) as output:
        assert fit.main([*words, *more, "--quick", "--peer-frames", "2"]) == 0
    return output.getvalue()


@pytest.fixture(scope="module")
def result(printed: str, folders: dict[str, Path]) -> dict[str, Any]:
    return json.loads((folders["output"] / "fit.json").read_text())


def numbers(value: Any) -> Iterator[float]:
    """Walk every number of a JSON document."""
    if isinstance(value, dict | list):
        for item in value.values() if isinstance(value, dict) else value:
            yield from numbers(item)
    elif isinstance(value, int | float):
        yield value


def test_a_quick_run_measures_all_three_parts(result: dict[str, Any]) -> None:
    assert list(result["accuracy"]["maps"]) == ["attic", "barn"]
    assert result["accuracy"]["maps"]["barn"].keys() >= {"em", "fast"}
    assert {"env", "flux", "irr", "irrMax", "r0.5", "r0.25", "wall_seconds", "cpu_seconds"} == (
        result["accuracy"]["maps"]["barn"]["fast"].keys()
    )
    curve = result["curves"]["attic"]  # no map is called lobby
    assert curve["paper_steps"] == PAPER_STEPS
    assert [point["step"] for point in curve["points"]["paper"]] == sorted(
        range(1, PAPER_STEPS + 1)
    )
    assert all({"loss", "irr", "r0.25"} <= point.keys() for point in curve["points"]["fast"])
    following = result["following"]["lamp"]
    assert following["frames"] == [1001, 1002, 1003]
    assert len(following["methods"]["fast"]["wall_seconds"]) == FRAMES
    for peer in ("independent", "paper"):
        assert len(following["methods"][peer]["errors"]["r0.25"]) == 2
    assert following["peer_frames"] == 2
    assert following["paper_steps"] == [math.ceil(PAPER_STEPS / 10), 1]
    assert result["machine"]["threads"] == 1


def test_every_number_is_finite(result: dict[str, Any]) -> None:
    found = list(numbers(result))
    assert len(found) > 300
    assert all(map(math.isfinite, found))


def test_times_go_up_along_a_curve(result: dict[str, Any]) -> None:
    for points in result["curves"]["attic"]["points"].values():
        seconds = [point["wall_seconds"] for point in points]
        assert seconds == sorted(seconds)
        assert seconds[0] > 0


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_show_something(
    name: str, result: dict[str, Any], folders: dict[str, Path]
) -> None:
    picture = matplotlib.image.imread(folders["output"] / name)
    assert picture.shape[1] == 1800
    assert picture.shape[0] > 300
    # Dark ground, light text, and the blue of `fast`.
    blue = (abs(picture[..., :3] - [0x56 / 255, 0xB4 / 255, 0xE9 / 255]) < 0.02).all(-1)
    assert blue.sum() > 50
    assert picture[..., :3].std() > 0.05


def test_a_tolerance_measures_the_fewest_lobes_alone(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fit_leaving_out, "SKY_ROWS", 8)
    options = ["-o", str(tmp_path), "--tolerance", "0.3", "--quick", "--frames", "2"]
    with contextlib.redirect_stdout(io.StringIO()) as output:
        assert fit.main([*words, *options, "--threads", "1"]) == 0
    result = json.loads((tmp_path / "fit.json").read_text())
    assert "accuracy" not in result
    found = result["leaving_out"]["inputs"]
    assert list(found) == ["attic", "barn", "overcast sky", "built-in sky", "lamp"]
    assert [one["frames"] for one in found.values()] == [1, 1, 1, 2, 2]
    assert all(one["lobes"] >= 1 and one["cpu_seconds"] > 0 for one in found.values())
    for one in found.values():
        assert one["tolerance_met"] == (max(one["judged"].values()) <= 0.3)
    header, _, *rows = output.getvalue().splitlines()
    assert header == "| input | frames | lobes | worst irr | worst r0.5 | met | isotropic | CPU s |"
    assert [row.split(" | ")[1] for row in rows[:5]] == ["1", "1", "1", "2", "2"]
    assert "stay at or below 0.3" in rows[-1]
    # decoding is in a process of its own, whose seconds no clock of this one has
    assert "to decode the images is not in them" in rows[-1]


@pytest.mark.parametrize("text", ["0", "1", "nan", "much"])
def test_a_tolerance_must_be_one(
    text: str, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        fit.main([*words, "--tolerance", text])
    assert "expected a number above 0 and below 1" in capsys.readouterr().err


def test_tables_are_markdown_and_name_everything(printed: str) -> None:
    for text in ("| attic |", "| median ratio |", "| lamp, 3 frames | fast |", "| independent |"):
        assert text in printed
    assert "The paper's recipe was cut short: 12 of its 24,000 steps." in printed
    rows = [line for line in printed.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in rows}) == 3  # three kinds of table


def test_a_missed_target_is_marked() -> None:
    good = {"env": 0.1, "irr": 0.004, "irrMax": 0.004, "r0.5": 0.01, "r0.25": 0.02, "flux": 0.0}
    seconds = {"wall_seconds": 1.0, "cpu_seconds": 1.0}
    peer = {name: 10 * error for name, error in good.items()}
    bad = good | {"r0.5": 0.07, "flux": 0.003}
    maps = {
        "fine": {"em": peer | seconds, "fast": good | seconds},
        "lost": {"em": peer | seconds, "fast": bad | seconds},
    }
    account = fit_measures.compare(maps, "fast")
    assert account["missed"] == {"fine": [], "lost": ["r0.5", "flux"]}
    assert account["missed_median"] == []  # (0.1 + 0.7) / 2 = 0.4 is the limit itself
    assert account["worst"]["r0.5"] == pytest.approx(0.7)
    fine, lost = fit_tables.accuracy_table(maps, "fast", account).splitlines()[2:4]
    assert fit_tables.MISS not in fine
    assert "0.0700 / 0.1000 (0.70) ✗ |" in lost
    assert lost.count(fit_tables.MISS) == 2


def test_a_small_irradiance_error_is_enough_whatever_em_reaches() -> None:
    ratios = {"irr": 3.0, "irrMax": 3.0, "env": 0.5}
    limits = {"irr": 0.5, "irrMax": 0.5, "env": 0.95}
    assert fit_measures.missed(ratios, {"irr": 0.0009, "flux": 0.0}, limits) == []
    assert fit_measures.missed(ratios, {"irr": 0.0011, "flux": 0.0}, limits) == ["irr", "irrMax"]


CURVE = [
    {"wall_seconds": seconds, "loss": loss}
    for seconds, loss in ((1.0, 0.8), (2.0, 0.4), (4.0, 0.5), (5.0, 0.2))
]


@pytest.mark.parametrize(
    ("level", "seconds"),
    [(0.9, 1.0), (0.8, 1.0), (0.6, 1.5), (0.4, 2.0), (0.3, 4 + 2 / 3), (0.2, 5.0), (0.1, None)],
)
def test_time_to_reach_is_linear_between_points(level: float, seconds: float | None) -> None:
    assert fit_measures.time_to_reach(CURVE, "loss", level) == (
        None if seconds is None else pytest.approx(seconds)
    )


@pytest.mark.parametrize(
    ("level", "seconds"), [(0.9, 1.0), (0.6, 2.0), (0.4, 2.0), (0.3, 5.0), (0.1, None)]
)
def test_first_at_waits_for_a_state_that_is_there(level: float, seconds: float | None) -> None:
    assert fit_measures.first_at(CURVE, "loss", level) == seconds


def test_races_compare_times_to_the_same_error() -> None:
    paper = [{"wall_seconds": 10.0 * k, "loss": 1 / k, "irr": 0.1, "r0.25": 0.2} for k in (1, 2, 4)]
    ours = [
        {"wall_seconds": 0.1, "loss": 0.9, "irr": 0.3, "r0.25": 0.3},
        {"wall_seconds": 0.5, "loss": 0.3, "irr": 0.2, "r0.25": 0.1},
    ]
    races = fit_measures.races(paper, ours)
    assert races["loss"] == {"level": 0.25, "paper_seconds": 40.0, "seconds": None} | {
        "times_faster": None
    }
    assert races["r0.25"]["times_faster"] == pytest.approx(80)
    assert races["back"]["paper_seconds"] == pytest.approx(20 + 20 * 0.2 / 0.25)
    # 0.2525: a hundredth of the way back from 0.25 to 0.5
    assert races["near"]["paper_seconds"] == pytest.approx(39.8)


def test_races_are_printed_as_the_page_of_results_has_them() -> None:
    """The page is made by the command: same head, same rows, same words, other numbers."""
    race = {"level": 0.5, "paper_seconds": 1560.0, "seconds": 0.5, "times_faster": 3120.0}
    races = dict.fromkeys(("loss", "irr", "r0.25"), race)
    races |= dict.fromkeys(("near", "back"), race | {"paper_seconds": 136.0, "times_faster": 272.0})
    curve = {"paper_steps": 24_000, "races": {"fast": races, "best": races}}
    (shown,) = tables(fit_tables.curves_table({"lobby": curve}))
    page = (Path(__file__).resolve().parents[2] / "docs" / "results" / "fits.md").read_text()
    (block,) = (block for block in blocks(page) if block.name == "paper.3")
    (written,) = tables(block.content)
    one, other = (re.sub(r"\d[\d.,]*", "#", text) for text in (shown, written))
    assert one == other


def test_a_paused_clock_stands_still() -> None:
    clock = fit_measures.Clock()
    with clock.paused() as stopped:
        time.sleep(0.2)
    assert stopped["wall_seconds"] < 0.1
    assert clock.seconds()["wall_seconds"] < 0.1


def turning(*degrees: float, amplitude: tuple[float, ...]) -> Lobes:
    """Return equally wide lobes on the horizon."""
    turn = torch.deg2rad(torch.tensor(degrees))
    axis_z = torch.stack([turn.sin(), torch.zeros_like(turn), turn.cos()], dim=-1)
    sharpness = torch.full((len(degrees), 2), 50.0)
    return Lobes(axes_around(axis_z), sharpness, torch.tensor(amplitude)[:, None].expand(-1, 3))


def test_jumps_are_large_turns_of_lit_lobes() -> None:
    lit = (1.0, 1.0, 1.0, 0.0)
    frames = [
        turning(0, 90, 180, 270, amplitude=lit),
        turning(9, 101, 180, 300, amplitude=lit),  # 9, 11, 0 degrees; 30 in the dark
        turning(0, 101, 170.5, 330, amplitude=(1.0, 1.0, 1.0, 0.1)),  # the last comes to light
    ]
    assert fit_following.jumps(frames[:2]) == 1
    assert fit_following.jumps(frames) == 2
    assert fit_following.jumps(frames[:1]) == 0
    faint = [turning(0, 90, amplitude=(1.0, 0.009)), turning(0, 120, amplitude=(1.0, 0.009))]
    assert fit_following.jumps(faint) == 0


def test_independent_fits_jump_only_where_no_order_of_lobes_explains_it() -> None:
    first = turning(0, 90, 180, amplitude=(1.0, 2.0, 3.0))
    shuffled = turning(185, 5, 95, amplitude=(3.0, 1.0, 2.0))
    assert fit_following.jumps([first, shuffled]) == 3
    found = fit_following.matched([first, shuffled])
    assert fit_following.jumps(found) == 0
    assert found[1].amplitude[:, 0].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("option", ["--maps", "--sequences"])
def test_a_missing_folder_is_one_clear_line(
    option: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit.main([*words, option, str(tmp_path / "gone")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "gone: No such file or directory; expected a folder." in line
    assert option in line


def test_an_empty_folder_is_one_clear_line(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit.main([*words, "--maps", str(tmp_path)]) == 2
    assert "has no .exr or .hdr file" in capsys.readouterr().err
    assert fit.main([*words, "--sequences", str(tmp_path)]) == 2
    assert "has no folders" in capsys.readouterr().err


def test_an_unknown_curve_map_is_one_clear_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert fit.main([*words, "--curve-maps", "attic,lobby"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "lobby; expected some of attic, barn, cellar." in line


def test_a_black_map_is_one_clear_line(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_exr(tmp_path / "cave.exr", torch.zeros(4, 8, 3))
    assert fit.main([*words, "--maps", str(tmp_path), "--threads", "1"]) == 2
    assert "cave.exr: is black" in capsys.readouterr().err


def test_help_shows_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        fit.main(["--help"])
    assert "python -m benchmarks.fits --maps ../shared/hdri" in capsys.readouterr().out


def test_an_option_must_be_a_positive_number(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        fit.main([*words, "--frames", "0"])
    assert "expected a whole number from 1 on" in capsys.readouterr().err
