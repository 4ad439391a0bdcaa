# SPDX-License-Identifier: Apache-2.0
"""`asglight view` and `viewer.py` as a user starts them: pictures, the check, every message."""

import gc
import importlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
import torch
import written_stages
from places import ROOT

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.viewer import app
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.io import saving, screenshot
from asglight.viewer.running import as_pictures_need
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState


@pytest.fixture
def stage(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    path = tmp_path / "shot.usda"
    written_stages.put(two_lamps, path)
    return path


def view(*arguments: str | Path) -> int:
    """Run the viewer in this process and return its exit code."""
    return main(["view", *map(str, arguments)])


def failure(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Run the viewer in this process, expect exit code 2, and return its one line."""
    assert view(*arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("asglight: ")
    return line.removeprefix("asglight: ")


def lambert_ball(path: Path) -> np.ndarray:
    """Return the last ball of a bare screenshot of 700 x 140.  [H, W, 3].

    It has margins of 8, a row of 20 for its title and one of 24 for its exposure.
    """
    pixels = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
    assert pixels is not None
    assert pixels.shape == (140, 700, 3)
    x, y, side = cells((684, 80), 6)[-1]
    return pixels[28 + y : 28 + y + side, 8 + x : 8 + x + side]


def lit_by(ball: np.ndarray, channel: int) -> np.ndarray:
    """Return row and column of the centre of what one lamp lights."""
    other = 1 - channel
    return np.argwhere(ball[..., channel] - ball[..., other] > 0.2).mean(axis=0)


def test_pictures_have_one_thread_and_what_is_loaded_is_not_gone_through_for_garbage(
    capsys: pytest.CaptureFixture[str],
) -> None:
    threads = torch.get_num_threads()
    gc.disable()  # as the command does until its window runs
    with as_pictures_need():
        assert gc.isenabled()
        assert gc.get_freeze_count() > 10_000
        assert torch.get_num_threads() == 1
    assert gc.get_freeze_count() == 0
    assert torch.get_num_threads() == threads
    failure(capsys, "missing.usda")
    assert gc.isenabled()  # also where nothing could be opened


@pytest.mark.usefixtures("opengl")
def test_screenshot_shows_the_balls_lit_from_where_the_lamps_are(
    stage: Path, tmp_path: Path
) -> None:
    size = ("--bare", "--size", "700x140")
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    result = subprocess.run(
        [sys.executable, ROOT / "viewer.py", stage, "--screenshot", tmp_path / "first.png", *size],
        capture_output=True,
        text=True,
        env=bare,
        cwd=ROOT.parent,
        timeout=60,
        check=False,
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert view(stage, "--frame", "1004", "--screenshot", tmp_path / "last.png", *size) == 0
    first, last = (lambert_ball(tmp_path / name) for name in ("first.png", "last.png"))
    green, red = lit_by(first, 1), lit_by(first, 0)
    assert green[0] < red[0] - 10  # above against below
    assert green[1] > red[1] + 10  # right (+X, u = 1/4) against left (u = 3/4)
    assert lit_by(last, 1)[1] < green[1] - 5  # at frame 1004 it comes from the front


@pytest.mark.usefixtures("opengl")
def test_screenshot_of_the_window_has_its_panels(stage: Path, tmp_path: Path) -> None:
    assert view(stage, "--screenshot", tmp_path / "a.png", "--size", "1000x700") == 0
    image = OpenImageIO.ImageBuf(str(tmp_path / "a.png"))
    assert (image.spec().width, image.spec().height, image.spec().nchannels) == (1000, 700, 3)
    pixels = image.get_pixels(OpenImageIO.FLOAT)
    assert pixels is not None
    # In each quarter of the window something is drawn: edges, in brightness.
    edges = np.abs(np.diff(pixels.mean(-1), axis=1)) > 0.2
    assert all(edges[y : y + 350, x : x + 499].sum() > 100 for y in (0, 350) for x in (0, 500))


@pytest.mark.usefixtures("opengl")
def test_check_names_the_renderer_and_every_pass(capsys: pytest.CaptureFixture[str]) -> None:
    assert view("--check") == 0
    said = capsys.readouterr()
    opengl, *shaders = said.out.splitlines()
    assert said.err == ""
    assert opengl.startswith("OpenGL 4.")
    expected = sorted(path.name for path in (ROOT / "shaders").glob("*.frag"))
    assert shaders == [f"shaders/{name}: ok" for name in expected]


@pytest.mark.usefixtures("opengl")
def test_check_reports_a_broken_shader_and_exits_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from asglight.viewer.gl import passes

    monkeypatch.setattr(passes, "DEFINES", {**passes.DEFINES, "PI": 3})
    assert view("--check") == 1
    assert "shaders/lib/math.glsl:4: " in capsys.readouterr().out


@pytest.mark.parametrize("package", ["moderngl", "imgui_bundle", "glfw", "PIL"])
def test_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(InputError, match=rf"{package} is not installed; .*'asglight\[view\]'$"),
        app._explained_imports(),
    ):
        importlib.import_module(package)


def test_missing_system_library_names_the_packages() -> None:
    with (
        pytest.raises(InputError, match=r"^viewer: libX11.* apt install libegl1 libgl1\.$"),
        app._explained_imports(),
    ):
        raise ImportError("libX11.so.6: cannot open shared object file")


def test_missing_module_of_our_own_is_a_bug_and_stays_one() -> None:
    with pytest.raises(ModuleNotFoundError), app._explained_imports():
        raise ModuleNotFoundError("no", name="asglight.nothing")


def test_missing_stage_file_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "nowhere.usda" in failure(capsys, tmp_path / "nowhere.usda")


def test_frame_that_is_not_in_the_stage_is_named_with_those_that_are(
    capsys: pytest.CaptureFixture[str], stage: Path
) -> None:
    line = failure(capsys, stage, "--frame", "1003")
    assert line.startswith("--frame 1003: not in shot.usda; ")
    assert "(1001-1004, 3 frames)" in line


def test_screenshot_must_be_a_png(capsys: pytest.CaptureFixture[str], stage: Path) -> None:
    line = failure(capsys, stage, "--screenshot", "a.jpg")
    assert line == "--screenshot a.jpg: not a PNG file; expected a name ending in .png."


@pytest.mark.usefixtures("opengl")
def test_screenshot_into_no_folder_is_named(
    capsys: pytest.CaptureFixture[str], stage: Path, tmp_path: Path
) -> None:
    line = failure(capsys, stage, "--screenshot", tmp_path / "none" / "a.png")
    assert f"a.png: cannot be written (no folder {tmp_path / 'none'}); expected a folder" in line


@pytest.mark.usefixtures("opengl")
def test_failed_screenshot_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "a.png"
    output.write_bytes(b"old")
    pixels = np.zeros((2, 4, 3), np.uint8)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("asglight.images.output.os.replace", full)
    with pytest.raises(InputError, match="No space left on device"):
        saving.write_png(output, pixels)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    assert output.read_bytes() == b"old"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--size", "1024"), "'1024'; expected COLUMNSxROWS"),
        (("--size", "0x5"), "'0x5'; expected sides of 1 to 16384 texels"),
        (("--exposure-ev", "nan"), "'nan'; expected stops between -20 and 20"),
        (("--exposure-ev", "bright"), "'bright'; expected stops between -20 and 20"),
    ],
)
def test_unusable_option_is_explained(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    assert message in failure(capsys, "shot.usda", *arguments)


def test_a_screenshot_selects_the_brightest_light_that_a_fit_has_found(
    two_lamps: LobeTracks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    last = two_lamps.lobes.amplitude.clone()
    last[-1, 1] *= 10
    found = replace(two_lamps, lobes=replace(two_lamps.lobes, amplitude=last))
    session = Session(ViewerState(two_lamps), FixedSource(found), "fit")
    app.set_up(session, 1004, None)
    assert session.state.selection.lobe == 0
    seen = []

    def picture(session: Session, *_: object, **__: object) -> np.ndarray:
        seen.append(session.state.selection.lobe)
        return np.zeros((2, 2, 3), np.uint8)

    monkeypatch.setattr(screenshot, "window_picture", picture)
    app.write_screenshot(session, tmp_path / "picture.png", (2, 2))
    assert seen == [1]


def test_an_image_that_is_none_has_one_line_and_no_hint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = tmp_path / "README.md"
    text.write_text("words")
    assert "is text; expected" in failure(capsys, text, "--screenshot", tmp_path / "picture.png")
