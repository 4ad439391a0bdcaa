# SPDX-License-Identifier: Apache-2.0
"""`viewer.py` as a user starts it: pictures in files, the check, and every message."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import moderngl
import OpenImageIO
import pytest

from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.usd import write_usd
from asglight.viewer import app, screenshot
from asglight.viewer.state import ViewerState

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def stage(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    path = tmp_path / "shot.usda"
    write_usd(two_lamps, path)
    return path


def run_viewer(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run viewer.py from another folder, without a display."""
    bare = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(
        [sys.executable, ROOT / "viewer.py", *arguments],
        capture_output=True,
        text=True,
        env=bare | environment,
        cwd=ROOT.parent,
        timeout=60,
        check=False,
    )


def brightest(path: Path, channel: int) -> tuple[int, int]:
    """Return row and column of a PNG's largest value in a channel."""
    pixels = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.UINT8)
    assert pixels is not None
    row, column = divmod(int(pixels[..., channel].argmax()), pixels.shape[1])
    return row, column


def failure(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """Run the viewer in this process, expect exit code 2, and return its one line."""
    assert app.main(list(map(str, arguments))) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.usefixtures("opengl")
def test_screenshot_has_the_size_asked_for_and_the_lobe_where_it_is(
    stage: Path, tmp_path: Path
) -> None:
    output = tmp_path / "shot.png"
    # Half a stop down, so that the peaks of 0.9 stay well below where the picture clips.
    result = run_viewer(
        *(stage, "--frame", "1002", "--screenshot", output),
        *("--size", "256x128", "--exposure-ev", "-0.5"),
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    specification = OpenImageIO.ImageBuf(str(output)).spec()
    assert (specification.width, specification.height, specification.nchannels) == (256, 128, 3)
    for channel, (u, v) in ((1, (0.375, 0.25)), (0, (0.75, 0.75))):
        row, column = brightest(output, channel)
        # The peak lies on a corner of four texels, and 8 bits make a small plateau around it.
        assert abs(column + 0.5 - 256 * u) <= 2
        assert abs(row + 0.5 - 128 * v) <= 2


@pytest.mark.usefixtures("opengl")
def test_screenshot_without_a_frame_shows_the_first(stage: Path, tmp_path: Path) -> None:
    output = tmp_path / "shot.png"
    assert app.main([str(stage), "--screenshot", str(output), "--size", "128x64"]) == 0
    assert abs(brightest(output, 1)[1] + 0.5 - 128 * 0.25) <= 2


@pytest.mark.usefixtures("opengl")
def test_check_names_the_renderer_and_every_pass() -> None:
    result = run_viewer("--check")
    opengl, *shaders = result.stdout.splitlines()
    assert (result.returncode, result.stderr) == (0, "")
    assert opengl.startswith("OpenGL 4.")
    expected = sorted(path.name for path in (ROOT / "shaders").glob("*.frag"))
    assert shaders == [f"shaders/{name}: ok" for name in expected]


@pytest.mark.usefixtures("opengl")
def test_check_reports_a_broken_shader_and_exits_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from asglight.viewer import passes

    monkeypatch.setattr(passes, "DEFINES", {**passes.DEFINES, "PI": 3})
    assert app.main(["--check"]) == 1
    assert "shaders/lib/math.glsl:4: " in capsys.readouterr().out


def test_old_opengl_is_named(opengl: moderngl.Context) -> None:
    if "Mesa" not in opengl.info["GL_VERSION"]:
        pytest.skip("only Mesa can be told to offer an older OpenGL")
    result = run_viewer("--check", MESA_GL_VERSION_OVERRIDE="3.3")
    assert result.returncode == 2
    assert result.stderr.startswith("OpenGL: found OpenGL 3.3")
    assert result.stderr.endswith("; expected 4.1 or later. Update the graphics driver.\n")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="EGL is used on Linux only")
def test_missing_opengl_names_the_packages() -> None:
    result = run_viewer("--check", __EGL_VENDOR_LIBRARY_FILENAMES="/nowhere")
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("OpenGL: ")
    assert line.endswith("apt install libegl1 libgl1.")


@pytest.mark.parametrize("package", ["moderngl", "imgui_bundle", "glfw", "PIL"])
def test_missing_package_names_the_extra(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(InputError, match=rf"{package} is not installed; .*'asglight\[view\]'$"),
        app._explained_imports(),
    ):
        importlib.import_module(package)


@pytest.mark.parametrize(
    ("package", "arguments"), [("imgui_bundle", ["shot.usda"]), ("moderngl", ["--check"])]
)
def test_viewer_without_its_packages_exits_2_with_one_line(
    stage: Path, package: str, arguments: list[str]
) -> None:
    code = (
        f"import sys; sys.modules[{package!r}] = None; from asglight.viewer.app import main; "
        f"sys.exit(main({arguments!r}))"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(
        command, capture_output=True, text=True, cwd=stage.parent, timeout=60, check=False
    )
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.endswith(f"{package} is not installed; run: pip install 'asglight[view]'")


def test_missing_system_library_names_the_packages() -> None:
    with (
        pytest.raises(InputError, match=r"^viewer: libX11.* apt install libegl1 libgl1\.$"),
        app._explained_imports(),
    ):
        raise ImportError("libX11.so.6: cannot open shared object file")


def test_missing_module_of_our_own_is_a_bug_and_stays_one() -> None:
    with pytest.raises(ModuleNotFoundError), app._explained_imports():
        raise ModuleNotFoundError("no", name="asglight.nothing")


def test_window_without_a_display_points_to_the_screenshot(stage: Path) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("only on Linux is there no display where DISPLAY is unset")
    result = run_viewer(stage)
    assert result.returncode == 2
    assert result.stderr.splitlines() == [
        "window: no display; expected a desktop session. Use --screenshot, which needs no display."
    ]


def test_missing_stage_argument_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert failure(capsys).startswith("stage: none given; expected a .usda, .usdc or .usd")


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
    assert "a.png: cannot be written (No such file or directory); expected a folder" in line


@pytest.mark.usefixtures("opengl")
def test_failed_screenshot_leaves_the_old_file_and_nothing_else(
    two_lamps: LobeTracks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "a.png"
    output.write_bytes(b"old")
    pixels = screenshot.picture(ViewerState(two_lamps), (4, 2))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("asglight.viewer.screenshot.os.replace", full)
    with pytest.raises(InputError, match="No space left on device"):
        screenshot.write_png(output, pixels)
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
    with pytest.raises(SystemExit, match="2"):
        app.main(["shot.usda", *arguments])
    assert message in capsys.readouterr().err
