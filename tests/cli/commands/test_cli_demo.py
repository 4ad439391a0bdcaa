# SPDX-License-Identifier: Apache-2.0
import json
from functools import partial
from pathlib import Path
from typing import Any

import OpenImageIO
import pytest
from torch import Tensor

from asglight import read_usd
from asglight.cli import progress
from asglight.cli.commands import demo
from asglight.cli.main import main
from asglight.fitting.options import FitOptions, Preset
from asglight.images import open_sequence
from asglight.shading import balls
from asglight.shots import fit_shot
from asglight.shots.events import Event, FrameDone
from asglight.sky import SkyConfig


def even_balls(maps: Tensor) -> Tensor:
    """Return balls that all show the mean of their map: a stand-in for half a minute of work."""
    mean = maps.mean((1, 2))[:, None, None, None]  # [K, 1, 1, 1, 3]
    return mean * balls.coverage(8)[:, :, None].expand(len(balls.ROUGHNESS), 8, 8, 1)


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the demo small: three frames of 16 rows, three lobes, balls of 8 pixels."""
    monkeypatch.setattr(demo, "CONFIG", SkyConfig(frames=(1001, 1002, 1003)))
    monkeypatch.setattr(demo, "HEIGHT", 16)
    few = FitOptions(lobes=3, preset=Preset.LIVE)
    monkeypatch.setattr(demo, "fit_shot", partial(fit_shot, options=few))
    monkeypatch.setattr(balls, "render_balls", even_balls)


@pytest.fixture
def pictures_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "draw", lambda *arguments: None)


def test_the_demo_writes_what_it_lists(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "demo"
    assert main(["demo", "-o", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "worst frame" in out
    listed = [line.split(": ")[0] for line in out.splitlines() if line.startswith(f"{folder}/")]
    # the stage is listed twice: its size, and what it is
    assert set(listed) == {
        str(folder / name)
        for name in (
            "sky/sky.####.exr",
            "demo.usda",
            "demo_dome",
            "contact-sheet.png",
            "balls.png",
        )
    }
    sequence = open_sequence(folder / "sky")
    assert sequence.frames == (1001, 1002, 1003)
    assert sequence.read(1001).radiance.shape == (16, 32, 3)
    assert read_usd(folder / "demo.usda").frames == sequence.frames
    for name in ("contact-sheet.png", "balls.png"):
        assert OpenImageIO.ImageBuf(str(folder / name)).spec().width > 600
    assert not (folder / "demo.usda.checkpoint").exists()


def result(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    return json.loads(capsys.readouterr().out)


@pytest.mark.usefixtures("pictures_left_out")
def test_an_interrupted_demo_goes_on_and_runs_again_from_the_start(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(self: progress.Lines, event: Event) -> None:
        if isinstance(event, FrameDone) and event.position == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(progress.Lines, "__call__", stop)
        assert main(["demo", "-o", str(tmp_path)]) == 130
    assert capsys.readouterr().err.endswith("asglight: interrupted; run it again to go on.\n")
    (tmp_path / "sky" / "sky.1003.exr").unlink()
    assert main(["demo", "-o", str(tmp_path), "--json"]) == 0
    first = result(capsys)
    assert list(first) == ["files", "fit", "errors"]
    assert first["fit"]["resumed"] == 2
    stage = (tmp_path / "demo.usda").read_bytes()
    assert main(["demo", "-o", str(tmp_path), "--json"]) == 0
    again = result(capsys)
    assert again["fit"]["resumed"] == 0
    assert first["errors"] == again["errors"]
    assert (tmp_path / "demo.usda").read_bytes() == stage


@pytest.mark.parametrize(
    ("count", "expected"), [(1, (1,)), (2, (1, 10)), (4, (1, 4, 7, 10)), (99, tuple(range(1, 11)))]
)
def test_frames_are_spread_from_the_first_to_the_last(
    count: int, expected: tuple[int, ...]
) -> None:
    assert demo.spread(tuple(range(1, 11)), count) == expected
