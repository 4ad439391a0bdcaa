# SPDX-License-Identifier: Apache-2.0
"""The viewer where OpenGL is old or none, a display or a package is missing, or it crashes.

That needs processes of their own: Mesa and GLFW look at the environment once, and a module that was
loaded is not missing any more. What can be asked in one process is asked in one.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import moderngl
import numpy as np
import OpenImageIO
import pytest
import torch
import windows
from forked import Forks
from places import SUPPORT
from windows import Driven, press, wait_for

from asglight.cli.main import main
from asglight.images import write_exr
from asglight.lobes import LobeTracks
from asglight.viewer.state.views import Request


@pytest.fixture(scope="module")
def forks(tmp_path_factory: pytest.TempPathFactory) -> Forks:
    return Forks(tmp_path_factory.mktemp("said"))


PREPARED = """
import os
for name in ("DISPLAY", "WAYLAND_DISPLAY"):
    os.environ.pop(name, None)
os.environ.update({environment!r})

def view(*arguments):
    status = main(["view", *arguments])
    sys.stdout.flush()
    return status

{lines}
sys.stdout.flush()
os._exit(0)
"""
"""Lines without a display; to take all that is loaded apart would take longer than they do."""


def run_lines(forks: Forks, lines: str, **environment: str) -> CompletedProcess[str]:
    """Run lines of Python in a process of their own."""
    return forks.run(hook=PREPARED.format(environment=environment, lines=lines))


@pytest.fixture
def on_mesa(opengl: moderngl.Context) -> None:
    if "Mesa" not in opengl.info["GL_VERSION"]:
        pytest.skip("only Mesa can be told to offer an older OpenGL")


@pytest.mark.usefixtures("on_mesa")
def test_everything_runs_on_opengl_4_1(forks: Forks, stage: Path, tmp_path: Path) -> None:
    old = {"MESA_GL_VERSION_OVERRIDE": "4.1FC", "MESA_GLSL_VERSION_OVERRIDE": "410"}
    write_exr(tmp_path / "sky.exr", torch.full((16, 32, 3), 0.25))
    options = ["--reference", str(tmp_path / "sky.exr"), "--size", "600x400", "--screenshot"]
    arguments = [str(stage), *options]
    new, again = (str(tmp_path / name) for name in ("new.png", "old.png"))
    lines = f"assert view('--check') == 0\nassert view(*{[*arguments, again]!r}) == 0"
    result = run_lines(forks, lines, **old)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.startswith("OpenGL 4.1")
    assert main(["view", *arguments, new]) == 0
    pixels = [OpenImageIO.ImageBuf(path).get_pixels(OpenImageIO.UINT8) for path in (new, again)]
    assert pixels[0] is not None
    # the reference's last samples depend on how many pictures were drawn
    assert np.abs(pixels[0].astype(int) - pixels[1]).mean() < 0.5


OLD_OPENGL = """
import torch
from asglight.errors import InputError
from asglight.lobes import Lobes, LobeTracks
from asglight.viewer.io.screenshot import window_picture
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState

assert view("--check") == 2
lobes = Lobes(torch.eye(3)[None, None], torch.ones(1, 1, 2), torch.ones(1, 1, 3))
tracks = LobeTracks((1,), 24.0, lobes)
try:
    window_picture(Session(ViewerState(tracks), FixedSource(tracks), "test"), (64, 32))
except InputError as error:
    print(error)
"""


@pytest.mark.usefixtures("on_mesa")
def test_old_opengl_is_named_by_the_check_and_explained_by_the_window(forks: Forks) -> None:
    result = run_lines(forks, OLD_OPENGL, MESA_GL_VERSION_OVERRIDE="3.3")
    assert result.returncode == 0, result.stderr
    checked = result.stderr.splitlines()[0]
    assert checked.startswith("asglight: OpenGL: found OpenGL 3.3")
    assert checked.endswith("; expected 4.1 or later. Update the graphics driver.")
    assert result.stdout == (
        "window: cannot be opened; expected OpenGL 4.1 or later. "
        "Update the graphics driver; --check says what it has.\n"
    )


MISSING = """
packages = ("moderngl", "imgui_bundle", "glfw")
assert not {{*packages}} & {{*sys.modules}}
sys.modules.update(dict.fromkeys(packages))
assert main(["export", {stage!r}, "--to", "html", "-o", {page!r}]) == 0
for package in packages:
    del sys.modules[package]
for package, arguments in (("moderngl", ["--check"]), ("imgui_bundle", [{stage!r}])):
    assert package not in sys.modules
    sys.modules[package] = None
    assert view(*arguments) == 2
    del sys.modules[package]
"""
"""Packages are taken away one after the other, before anything has loaded them."""


def test_viewer_without_its_packages_exits_2_with_one_line_and_a_page_needs_none(
    forks: Forks, stage: Path, tmp_path: Path
) -> None:
    page = tmp_path / "shot.html"
    result = run_lines(forks, MISSING.format(stage=str(stage), page=str(page)))
    assert result.returncode == 0, result.stderr
    assert '"lobeCount":2' in page.read_text().replace(" ", "")
    for line, package in zip(result.stderr.splitlines(), ("moderngl", "imgui_bundle"), strict=True):
        assert line.endswith(f"{package} is not installed; run: pip install 'asglight[view]'.")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is used on Linux only")
def test_missing_opengl_names_the_packages_and_a_missing_display_the_screenshot(
    forks: Forks, stage: Path
) -> None:
    lines = f"assert view('--check') == 2\nassert view({str(stage)!r}) == 2"
    result = run_lines(forks, lines, __EGL_VENDOR_LIBRARY_FILENAMES="/nowhere")
    assert (result.returncode, result.stdout) == (0, ""), result.stderr
    checked, window = result.stderr.splitlines()
    assert checked.startswith("asglight: OpenGL: ")
    assert checked.endswith("apt install libegl1 libgl1.")
    assert window == (
        "asglight: window: no display; expected a desktop session. Use --screenshot, which needs "
        "no display."
    )


CRASH = """
sys.path.insert(0, {support!r})
from pathlib import Path
import windows
from asglight.usd import read_usd
from light_edits import scale_amplitude

stage, kept = map(Path, ({stage!r}, {kept!r}))

def script(test, driven):
    driven.state.history.add(scale_amplitude(0, None, 1.0))
    driven.state.toggle_mute(1)
    while not list(kept.glob(windows.KEPT)):
        test.yield_()
    os._exit(9)

windows.drive(read_usd(stage), script, stage=stage, autosaves=kept)
"""


@pytest.mark.usefixtures("no_system_dialog")
def test_edits_are_offered_after_a_crash(
    forks: Forks,
    drive_stage: Callable[..., None],
    stage: Path,
    tmp_path: Path,
    two_lamps: LobeTracks,
) -> None:
    kept = tmp_path / "unsaved"
    lines = CRASH.format(support=str(SUPPORT), stage=str(stage), kept=str(kept))
    crashed = run_lines(forks, lines)
    assert crashed.returncode == 9, crashed.stderr

    def script(test: Any, driven: Driven) -> None:
        question = driven.window.documents.question
        assert question is not None
        assert question.text.startswith("asglight ended before 2 edits of shot.usda could be saved")
        test.yield_(2)
        press(test, "Restore them")
        assert driven.state.message == "Restored 2 edits. They are not saved yet."
        torch.testing.assert_close(
            driven.state.tracks.lobes.amplitude[:, 0], 2 * two_lamps.lobes.amplitude[:, 0]
        )
        assert driven.state.lit == (0,)
        assert driven.state.history.is_unsaved
        driven.window.save(Request.SAVE_EDITS, stage.with_name("edits.usda"))
        wait_for(test, driven, "Saved edits.usda.")
        test.yield_(3)
        assert not list(kept.glob(windows.KEPT))  # what is saved is not offered again

    drive_stage(script, autosaves=kept)
