# SPDX-License-Identifier: Apache-2.0
"""Balls over time as files: PNG, EXR and MP4, by frames and as a turntable, off screen."""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import moderngl
import numpy as np
import OpenImageIO
import pytest
import torch
import written_stages
from imgui_bundle import imgui
from windows import Drive, Driven, grey, wait_for

from asglight.cli.main import main
from asglight.errors import InputError
from asglight.images import write_exr
from asglight.lobes import LobeTracks
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.gl.renderer import Renderer
from asglight.viewer.io import native
from asglight.viewer.io.film import Film
from asglight.viewer.io.rendering import Rendering
from asglight.viewer.io.wanted import Wanted
from asglight.viewer.reference.images import Reference
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

SIZE = (240, 48)


@pytest.fixture
def stage(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    written_stages.put(two_lamps, tmp_path / "shot.usda", dome_height=2)
    return tmp_path / "shot.usda"


@pytest.fixture
def session(two_lamps: LobeTracks) -> Session:
    return Session(ViewerState(two_lamps), FixedSource(two_lamps), "shot.usda")


def pixels(path: Path) -> np.ndarray:
    found = OpenImageIO.ImageBuf(str(path)).get_pixels(OpenImageIO.FLOAT)
    assert found is not None
    return found


def render(opengl: moderngl.Context, session: Session, wanted: Wanted) -> Rendering:
    """Write all pictures; a reference is decoded in threads meanwhile."""
    rendering = Rendering(session, Renderer(opengl), wanted)
    while not rendering.step():
        pass
    return rendering


def test_frames_are_written_by_their_numbers_and_the_playhead_comes_back(
    opengl: moderngl.Context, session: Session, tmp_path: Path
) -> None:
    playback = session.state.playback
    playback.go_to(1002)
    playback.mark_in()
    render(opengl, session, Wanted(tmp_path / "out.####.png", SIZE))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.1002.png", "out.1004.png"]
    assert playback.frame == 1002
    first, last = (pixels(tmp_path / f"out.{frame}.png") for frame in (1002, 1004))
    assert first.shape == (48, 240, 3)
    assert np.abs(first - last).max() > 0.1  # the green lamp has moved


@pytest.mark.parametrize(
    ("name", "file"),
    [("a.%04d.png", "a.0007.png"), ("a.#.png", "a.7.png"), ("a.%d.png", "a.7.png")],
)
def test_patterns_are_those_of_studios(name: str, file: str) -> None:
    assert Wanted(Path(name), SIZE).file(7).name == file


def test_an_exr_holds_radiance_without_exposure_and_view(
    opengl: moderngl.Context, session: Session, tmp_path: Path
) -> None:
    session.state.display.exposure_ev = 5.0
    session.state.environment.intensity_ev = 1.0
    render(opengl, session, Wanted(tmp_path / "out.####.exr", SIZE))
    found = pixels(tmp_path / "out.1001.exr")
    x, y, side = cells(SIZE, 6)[-1]
    # the Lambertian ball's mean over normals in view of a lamp overhead: compared with its own
    # value at the shader's size, read from the GPU
    centre = found[y + side // 2, x + side // 2]
    session.state.playback.go_to(1001)
    renderer = Renderer(opengl)
    renderer.balls(session.state, SIZE)
    value, _ = renderer.pixel((x + side // 2 + 0.5) / SIZE[0], (y + side // 2 + 0.5) / SIZE[1])
    assert value is not None
    np.testing.assert_allclose(centre, 2 * value, rtol=2e-3, atol=1e-5)  # 2 is the intensity


def test_rows_of_fit_and_reference_are_both_in_the_exr(
    opengl: moderngl.Context, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    state = ViewerState(two_lamps, grey(two_lamps))
    session = Session(state, FixedSource(two_lamps), "shot.usda")
    state.playback.last = 0
    assert state.shown is Comparison.ROWS
    render(opengl, session, Wanted(tmp_path / "out.exr", (240, 96)))
    found = pixels(tmp_path / "out.exr")
    x, y, side = cells((240, 48), 6)[-1]
    below = found[48 + y + side // 2, x + side // 2]
    # a white Lambertian ball under an even radiance of 0.5 shows 0.5; a quarter of the samples
    np.testing.assert_allclose(below, 0.5, rtol=0.05)
    state.compare_with(None)


def test_a_turntable_turns_once_and_comes_back(
    opengl: moderngl.Context, session: Session, tmp_path: Path
) -> None:
    session.state.camera.environment_deg = 30.0
    render(opengl, session, Wanted(tmp_path / "t.##.png", SIZE, turntable=4))
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["t.01.png", "t.02.png", "t.03.png", "t.04.png"]
    pictures = [pixels(tmp_path / name) for name in names]
    assert all(np.abs(pictures[0] - other).max() > 0.1 for other in pictures[1:])
    render(opengl, session, Wanted(tmp_path / "rest.png", SIZE, turntable=1))
    np.testing.assert_array_equal(pixels(tmp_path / "rest.png"), pictures[0])
    assert session.state.camera.environment_deg == 30.0


def test_labels_name_the_balls_and_the_frame(
    opengl: moderngl.Context, session: Session, tmp_path: Path
) -> None:
    size = (960, 240)
    render(opengl, session, Wanted(tmp_path / "clean.####.png", size))
    render(opengl, session, Wanted(tmp_path / "labelled.####.png", size, is_labelled=True))
    clean, labelled = (pixels(tmp_path / f"{n}.1001.png") for n in ("clean", "labelled"))
    changed = np.abs(clean - labelled).max(-1) > 0.2
    assert changed[:40, :480].any()  # the title
    assert changed[:40, 480:].any()  # the frame
    for x, y, side in cells(size, 6):
        assert changed[y + side : y + side + 30, x : x + side].any()
        inside = changed[y + side // 4 : y + 3 * side // 4, x + side // 4 : x + 3 * side // 4]
        assert not inside.any()


def test_pictures_are_those_at_rest_while_the_mouse_is_held_or_the_shot_plays(
    opengl: moderngl.Context, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    sky = np.full((16, 32, 3), 0.1, np.float32)
    sky[3, 9] = 50.0
    reference = Reference("sky", two_lamps.frames, lambda frame: sky)
    state = ViewerState(two_lamps, reference)
    session = Session(state, FixedSource(two_lamps), "shot.usda")
    state.playback.last = 0
    render(opengl, session, Wanted(tmp_path / "rest.png", (240, 96)))
    held = Rendering(session, Renderer(opengl), Wanted(tmp_path / "held.png", (240, 96)))
    is_over = False
    while not is_over:
        state.is_dragging = True
        state.playback.play(0.0)
        is_over = held.step()
        assert state.is_dragging
    np.testing.assert_array_equal(pixels(tmp_path / "held.png"), pixels(tmp_path / "rest.png"))
    state.compare_with(None)


def film(path: Path) -> tuple[dict, list[np.ndarray]]:
    """Return what ffmpeg says of a film, and its pictures."""
    program = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo"]
    done = subprocess.run([*program, "-pix_fmt", "rgb24", "-"], capture_output=True, check=True)
    said = done.stderr.decode()
    columns, rows = map(int, re.search(r"Video: .*?, (\d+)x(\d+)", said).groups())
    rate = float(re.search(r"([\d.]+) fps", said).group(1))
    pictures = np.frombuffer(done.stdout, np.uint8).reshape(-1, rows, columns, 3)
    return {"fps": rate, "size": (columns, rows)}, list(pictures)


def test_an_mp4_holds_every_frame_at_the_shots_rate(
    opengl: moderngl.Context, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    tracks = LobeTracks(two_lamps.frames, 25.0, two_lamps.lobes)
    session = Session(ViewerState(tracks), FixedSource(tracks), "shot.usda")
    render(opengl, session, Wanted(tmp_path / "out.mp4", SIZE))
    render(opengl, session, Wanted(tmp_path / "out.####.png", SIZE))
    about, pictures = film(tmp_path / "out.mp4")
    assert about["fps"] == 25
    assert len(pictures) == 3
    for picture, frame in zip(pictures, two_lamps.frames, strict=True):
        wanted = 255 * pixels(tmp_path / f"out.{frame}.png")
        # colours at half of the resolution, and the loss of the encoder
        assert np.abs(picture - wanted).mean() < 4
    assert not list(tmp_path.glob(".asglight*"))


def test_a_film_that_is_left_leaves_no_file(
    opengl: moderngl.Context, session: Session, tmp_path: Path
) -> None:
    rendering = Rendering(session, Renderer(opengl), Wanted(tmp_path / "out.mp4", SIZE))
    while rendering.done < 1:
        rendering.step()
    rendering.close()
    assert list(tmp_path.iterdir()) == []


def write_noise(path: Path, count: int) -> None:
    """Write a film that does not compress."""
    noise = np.random.default_rng(0).integers(0, 256, (48, 240, 3), np.uint8)
    made = Film(path, SIZE, 24.0)
    try:
        for index in range(count):
            made.add(np.roll(noise, 7 * index, 1))
        made.close(is_whole=True)
    finally:
        made.close(is_whole=False)  # as a rendering does when it has failed


@pytest.mark.parametrize("count", [12, 3000])  # the end fails, or the pipe breaks before
def test_a_film_that_cannot_be_written_is_told_and_the_old_one_stays(
    tmp_path: Path, count: int
) -> None:
    resource = pytest.importorskip("resource", reason="limits that POSIX has")
    path = tmp_path / "out.mp4"
    path.write_bytes(b"the old one")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_240, before[1]))
    try:
        with pytest.raises(InputError, match=r"out.mp4: cannot be written .ffmpeg: .*; expected"):
            write_noise(path, count)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("out.mp4", b"the old one")]


def test_a_film_where_no_file_can_be_made_is_refused_before_it_is_drawn(tmp_path: Path) -> None:
    folder = tmp_path / "shut"
    folder.mkdir()
    folder.chmod(0o555)
    if os.access(folder, os.W_OK):  # root
        folder = Path("/proc")  # where nobody may make one
    with pytest.raises(InputError) as caught:
        Film(folder / "out.mp4", SIZE, 24.0)
    finding, _, expected = str(caught.value).partition("; ")
    assert re.fullmatch(r"\S*/out\.mp4: cannot be written \([A-Z][a-z ]+\)", finding)
    assert expected.startswith("expected a folder with room and the permission to write.")


def test_what_ffmpeg_says_names_no_file_that_is_hidden(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "touch", Path.mkdir)  # which ffmpeg cannot open as a file
    film = Film(tmp_path / "out.mp4", SIZE, 24.0)
    with pytest.raises(
        InputError, match=r"\(ffmpeg: Error opening output out.mp4: Is a directory\)"
    ):
        film.close(is_whole=True)


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        (Wanted(Path("a.jpg"), SIZE), "a.jpg: is no picture; expected a name ending in .png"),
        (Wanted(Path("a.png"), SIZE), "a.png: one name for 3 pictures; expected a pattern such as"),
        (Wanted(Path("a.mp4"), (241, 48)), "a.mp4: 241x48 has an odd side; an MP4 needs even"),
        (Wanted(Path("a.#.exr"), SIZE, True), "a.#.exr: labels have no radiance; expected .png"),
        (Wanted(Path("/gone/a.mp4"), SIZE), "cannot be written .no folder"),
    ],
)
def test_what_cannot_be_rendered_is_said_first(
    opengl: moderngl.Context, session: Session, wanted: Wanted, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Rendering(session, Renderer(opengl), wanted)


def test_the_command_renders_without_a_display(
    opengl: moderngl.Context, stage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sky = tmp_path / "sky.exr"
    write_exr(sky, torch.full((8, 16, 3), 0.25))
    output = tmp_path / "out.####.png"
    arguments = ["view", str(stage), "--reference", str(sky), "--render", str(output)]
    assert main([*arguments, "--size", "240x96", "--labels"]) == 0
    opengl.__enter__()
    assert sorted(p.name for p in tmp_path.glob("out.*")) == [
        "out.1001.png",
        "out.1002.png",
        "out.1004.png",
    ]
    assert capsys.readouterr().out == ""


def test_no_picture_replaces_what_it_is_made_of(
    opengl: moderngl.Context,
    two_lamps: LobeTracks,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    stage = tmp_path / "shot.usda"
    written_stages.put_every(two_lamps, stage, dome_height=2)
    other = tmp_path / "other.usda"
    written_stages.put(two_lamps, other, dome_height=2)
    for frame in (1001, 1002, 1004):
        write_exr(tmp_path / f"sky.{frame}.exr", torch.full((8, 16, 3), 0.25))
    (tmp_path / "linked.0001.exr").hardlink_to(tmp_path / "sky.1002.exr")
    dome = next(file for file in tmp_path.rglob("*.1002.exr") if file.parent != tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    sky = str(tmp_path / "sky.####.exr")
    linked = tmp_path / "linked.####.exr"
    against = [str(other), "--against", str(stage), "--turntable", "1", "--render"]
    for arguments, file, kind in [
        ([sky, "--render", sky], "sky.1001.exr", "an image that is shown"),
        ([str(stage), "--reference", sky, "--render", sky], "sky.1001.exr", "an image that is"),
        ([sky, "--turntable", "2", "--render", str(linked)], "linked.0001.exr", "an image that"),
        ([str(stage), "--turntable", "1", "--render", str(dome)], dome.name, "a file of the stage"),
        ([*against, str(dome)], dome.name, "a file of the stage that is B"),
    ]:
        assert main(["view", *arguments, "--size", "64x32"]) == 2
        error = capsys.readouterr().err
        assert f"{file}: would replace {kind}" in error
        assert "expected another name or folder" in error
    after = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    assert after == before
    opengl.__enter__()


def test_no_screenshot_replaces_what_it_is_made_of(
    opengl: moderngl.Context, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sky = tmp_path / "sky.png"
    image = OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(16, 8, 3, OpenImageIO.UINT8))
    assert image.write(str(sky))
    before = sky.read_bytes()
    assert main(["view", str(sky), "--screenshot", str(sky)]) == 2
    assert "sky.png: would replace an image that is shown;" in capsys.readouterr().err
    assert sky.read_bytes() == before
    opengl.__enter__()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--labels"], "--labels: given without --render; expected both or neither."),
        (["--turntable", "4"], "--turntable: given without --render; expected both or neither."),
        (["--render", "a.mp4", "--screenshot", "b.png"], "--render: given with --screenshot;"),
        (["--render", "a.mp4", "--turntable", "0"], "--turntable 0: expected 1 picture or more."),
    ],
)
def test_options_without_effect_are_refused(
    stage: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(stage), *options]) == 2
    assert message in capsys.readouterr().err


def test_the_window_renders_what_it_shows(
    drive: Drive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(native, "has_dialog", lambda: False)
    monkeypatch.chdir(tmp_path)

    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        test.key_press(int(imgui.Key.mod_ctrl) | int(imgui.Key.r))
        test.yield_(2)
        browser = driven.window.documents.browser
        assert browser is not None
        assert browser.name == "test.####.png"
        browser.name = "film.mp4"
        test.item_click("//$FOCUSED/###accept")
        wait_for(test, driven, "Rendered 3 pictures.")

    drive(script)
    assert len(film(tmp_path / "film.mp4")[1]) == 3


def test_a_rendering_in_the_window_can_be_stopped(drive: Drive, tmp_path: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        driven.window.save(Request.RENDER_TURNTABLE, tmp_path / "film.mp4")
        test.yield_(3)
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        assert driven.window.rendering is None
        assert driven.state.message.startswith("Stopped after")
        driven.window.save(Request.RENDER, tmp_path / "a.png")
        wait_for(test, driven, f"{tmp_path}/a.png: one name for 3 pictures")

    drive(script)
    assert list(tmp_path.iterdir()) == []
