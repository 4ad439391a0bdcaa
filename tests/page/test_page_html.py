# SPDX-License-Identifier: Apache-2.0
"""The page as a file: what is in it, how large it is, and the command that writes it."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import sky_files
import torch
from places import ROOT
from usd_tracks import contents, moving

from asglight.cli.main import main
from asglight.judging.metrics import frame_errors
from asglight.lobes import Form
from asglight.page.html import page, page_balls, write_page
from asglight.page.reference import Reference, _balls, _levels, _range
from asglight.page.shaders import es_shader
from asglight.shading.balls import ROUGHNESS, coverage
from asglight.usd import write_usd

SHOT = moving(range(1001, 1004))


def document(text: str) -> dict:
    (found,) = re.findall(r'<script type="application/json" id="shot">(.*?)</script>', text)
    return json.loads(found)


def test_a_page_holds_everything_and_asks_for_nothing() -> None:
    text = page(SHOT, "shot.usda")
    assert not re.findall(
        r"""(?:src|href)=|url\(|import\s|fetch\(|https?://|WebSocket|XMLHttp""", text
    )
    assert "default-src 'none'" in text
    found = document(text)
    assert (found["frames"], found["fps"]) == ([1001, 1002, 1003], 24.0)
    assert found["names"] == list(SHOT.names)
    assert found["reference"] is None


def test_what_a_stage_is_called_cannot_be_a_script() -> None:
    name = "</script><script>alert(1)</script>${x}$y"
    text = page(SHOT, name)
    assert "<script>alert" not in text
    assert document(text)["title"] == name
    assert text.count("<script") == 3


def test_a_title_that_is_no_text_is_written_with_question_marks(tmp_path: Path) -> None:
    write_page(tmp_path / "shot.html", SHOT, "sky\udcff.usda")
    assert "<title>sky?.usda</title>" in (tmp_path / "shot.html").read_text(encoding="utf-8")


def test_light_beside_a_black_reference_has_no_number() -> None:
    errors = frame_errors(SHOT.at(1001), torch.zeros(16, 32, 3)).values
    assert math.isinf(errors["irr"])
    reference = Reference("black", [b""], [[(0.0, 1.0)]], [errors])
    assert document(page(SHOT, "shot.usda", reference))["reference"]["errors"][0]["irr"] is None


@pytest.mark.parametrize("form", Form)
def test_48_frames_of_15_lit_lobes_are_below_a_megabyte(form: Form) -> None:
    tracks = moving(range(1001, 1049), 15, form)
    assert len(page(tracks, "shot.usda")) < 1_000_000


def test_a_shot_whose_lobes_come_and_go_is_below_a_megabyte() -> None:
    tracks = moving(range(1001, 1049), 30)
    tracks.lobes.amplitude[:24, 15:] = 0
    tracks.lobes.amplitude[24:, :15] = 0
    assert len(page(tracks, "shot.usda")) < 1_000_000


def test_shaders_are_the_viewers_but_for_their_head() -> None:
    text = es_shader("balls.frag", {"MAX_SHEETS": 7})
    first, *rest = text.splitlines()
    assert first == "#version 300 es"
    assert "#define MAX_SHEETS 7" in rest
    assert "410" not in text
    assert "//" not in text
    source = ROOT / "shaders" / "balls.frag"
    lines = [re.sub(r"\s*//.*", "", line) for line in source.read_text().splitlines()]
    wanted = [line for line in lines if line.strip() and not line.startswith("#")]
    assert [line for line in rest if line in set(wanted)][-len(wanted) :] == wanted


def test_levels_of_a_part_give_its_radiance_back() -> None:
    values = 2.0 ** torch.linspace(-6, 9, 300).repeat(3, 1).mT[None]
    values[0, 0] = 0
    low, high = _range(values)
    levels = _levels(values, low, high).astype(float)
    back = np.where(levels >= 8, 2 ** (low + (levels - 16) / 239 * (high - low)), 0)
    half = 2 ** (15 / 239 / 2) - 1  # half a step
    np.testing.assert_allclose(back, values, rtol=1.01 * half)
    dark = torch.zeros(4, 8, 3)
    assert not _levels(dark, *_range(dark)).any()


def test_a_matt_ball_has_no_more_light_at_its_edge_than_an_even_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    balls = [ball for ball in page_balls() if ball.roughness is None]
    monkeypatch.setattr(
        "asglight.page.reference.render_balls", lambda maps, *_, **__: maps.new_zeros(len(maps), 0)
    )
    drawn = _balls([torch.full((64, 128, 3), 2.0)], balls)
    np.testing.assert_allclose(drawn, np.full((1, 1, 96, 96, 3), 2.0), rtol=2e-3)


def test_metal_balls_are_shown_as_bright_as_they_are_up_to_their_edge(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each as what its roughness gives (tests/shading), of which pixels at the edge have a part."""

    def rendered(maps: torch.Tensor, roughness: list[float], *, size: int) -> torch.Tensor:
        shown = torch.outer(maps.mean((1, 2, 3)), 1 - torch.tensor(roughness) / 2)
        return shown[..., None, None, None] * coverage(size)[..., None].expand(size, size, 3)

    monkeypatch.setattr("asglight.page.reference.render_balls", rendered)
    balls = page_balls()
    drawn = _balls([torch.full((32, 64, 3), level) for level in (1.0, 3.0)], balls)
    assert [ball.roughness for ball in balls] == [*ROUGHNESS, None]
    for place, roughness in enumerate(ROUGHNESS):
        for map_, level in enumerate((1.0, 3.0)):
            wanted = torch.full((96, 96, 3), level * (1 - roughness / 2))
            torch.testing.assert_close(drawn[map_, place], wanted)


def test_rough_metal_balls_under_an_even_map_show_their_albedo(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The rougher, the less; the others take seconds and are those of tests/shading."""
    monkeypatch.setattr("asglight.page.reference.BALL", 64)
    # an even map is the same on coarser grids
    monkeypatch.setattr("asglight.shading.balls._ROWS", (64, 128, 256))
    smoother, rough = _balls([torch.ones(8, 16, 3)], page_balls()[2:5:2])[0, :, 32, 32, 0].tolist()
    assert smoother == pytest.approx(1.0, abs=0.01)
    assert rough < smoother - 0.1


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_usd(SHOT, "shot.usda")
    sky_files.write_sequence(tmp_path / "in", range(1001, 1004))
    return tmp_path


def test_the_command_writes_a_page(stage: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = "export shot.usda --to html -o shot.html --frames 1002-1003"
    assert main(line.split()) == 0
    out = capsys.readouterr().out
    assert out.startswith("shot.html: 3 lobes of form asg, 2 frames (1002-1003) at 24 fps, ")
    assert document((stage / "shot.html").read_text())["frames"] == [1002, 1003]


def test_the_command_reads_the_reference_of_its_frames(
    stage: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def rendered(maps: torch.Tensor, roughness: list[float], *, size: int) -> torch.Tensor:
        seen.append(len(maps))
        return torch.ones(len(maps), len(roughness), size, size, 3)

    monkeypatch.setattr("asglight.page.reference.render_balls", rendered)
    line = "export shot.usda --to html -o shot.html --reference in --frame 1002"
    assert main(line.split()) == 0
    found = document((stage / "shot.html").read_text())["reference"]
    assert seen == [1]
    assert found["name"] == "sky.####.exr"
    assert (len(found["pictures"]), len(found["errors"])) == (1, 1)


FAULTS = [
    ("--to html", "output: none for html; expected a file. Add -o FILE"),
    ("--to html -o shot.usda", "shot.usda: has the suffix of another kind of file"),
    ("--to html -o none/a.html", r"none/a.html: cannot be written \(no folder none"),
    ("--to html -o a.html --reference none.exr", "none.exr: is not there"),
    ("--to html -o a.html --reference in/sky.1001.exr", "has none of|missing"),
    ("--to html -o a.html --layer a", "--layer: a without --reference; expected both, or none"),
    ("--to json -o a.json --reference in", "--reference: in without --to html; expected both"),
]


@pytest.mark.parametrize(("words", "message"), FAULTS, ids=[words for words, _ in FAULTS])
def test_a_fault_is_one_line(
    stage: Path, words: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    before = contents(stage)
    assert main(["export", "shot.usda", *words.split()]) == 2
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert re.search(message, err)
    assert contents(stage) == before
