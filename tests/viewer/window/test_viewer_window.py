# SPDX-License-Identifier: Apache-2.0
"""The real window, driven by the Dear ImGui test engine on GLFW's null platform: no display."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from imgui_bundle import ImVec2, imgui
from windows import Drive, Driven, bar_point, captured

from asglight.lobes import LobeTracks
from asglight.viewer import running
from asglight.viewer.io.screenshot import use_no_display, window_picture
from asglight.viewer.state.display import Channel, Comparison, ViewTransform
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.time.playback import Pace
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Theme
from asglight.viewer.window import Window


def test_scrubbing_shows_the_frame_under_the_mouse_while_it_is_dragged(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        playback = driven.state.playback
        test.mouse_move_to_pos(bar_point(test, 0.05))
        test.mouse_down(0)
        seen = []
        for share in (0.3, 0.95, 0.05):
            test.mouse_move_to_pos(bar_point(test, share))
            test.yield_(2)
            seen.append((playback.frame, driven.state.is_dragging))
        test.mouse_up(0)
        test.yield_(2)
        assert seen == [(1002, True), (1004, True), (1001, True)]
        assert not driven.state.is_dragging

    drive(script)


def test_keys_step_play_mark_and_loop(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        playback = driven.state.playback
        test.key_press(int(imgui.Key.right_arrow))
        assert playback.frame == 1002
        test.key_press(int(imgui.Key.end))
        assert playback.frame == 1004
        test.key_press(int(imgui.Key.o))
        test.key_press(int(imgui.Key.left_arrow))
        test.key_press(int(imgui.Key.i))
        assert (playback.first, playback.last) == (1, 2)
        test.key_press(int(imgui.Key.l))
        assert not playback.loops
        test.key_press(int(imgui.Key.p))
        assert playback.pace is Pace.EVERY_FRAME

    drive(script)


def test_play_follows_the_clock_that_the_test_turns(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        playback = driven.state.playback
        test.item_click("Timeline/###play")
        assert playback.is_playing
        seen = []
        for frames in (1, 2, 3, 4):
            driven.seconds = frames / 24 + 0.001
            test.yield_(2)
            seen.append(playback.frame)
        assert seen == [1002, 1002, 1004, 1001]  # 1003 is missing: 1002 is held; then the loop
        test.key_press(int(imgui.Key.space))
        assert not playback.is_playing

    drive(script)


def test_view_keys_and_controls_change_the_display(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        display = driven.state.display
        test.item_input_value("Look/exposure", 2.0)
        assert display.exposure_ev == 2.0
        test.key_press(int(imgui.Key.e))
        assert display.exposure_ev == 2.5
        test.key_press(int(imgui.Key.mod_shift) | int(imgui.Key.e), 2)
        assert display.exposure_ev == 1.5
        test.key_press(int(imgui.Key._0))
        assert display.exposure_ev == 0.0
        test.key_press(int(imgui.Key.t))
        assert display.transform is ViewTransform.FILMIC
        test.key_press(int(imgui.Key.c))
        assert display.channel is Channel.RED
        test.item_check("Look/zebra")
        assert display.zebra

    drive(script)


def test_exposure_view_and_intensity_never_shade_anew(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        before = driven.window.renderer.counts
        for key in (imgui.Key.e, imgui.Key.t, imgui.Key.t, imgui.Key.c, imgui.Key.z):
            test.key_press(int(key))
        test.item_input_value("Look/intensity", 1.5)
        after = driven.window.renderer.counts
        assert after.shaded == before.shaded
        assert after.displayed > before.displayed
        test.key_press(int(imgui.Key.m))
        assert driven.window.renderer.counts.shaded > after.shaded  # the material does shade anew

    drive(script)


def test_an_idle_window_draws_nothing(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        before = driven.window.renderer.counts
        test.yield_(5)
        assert driven.window.renderer.counts == before

    drive(script)


def test_dragging_on_the_balls_orbits_and_v_comes_back(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        camera = driven.state.camera
        test.item_drag_with_delta("Balls/##picture", ImVec2(50, 20))
        assert camera.yaw_deg < 0 < camera.pitch_deg
        test.key_press(int(imgui.Key.v))
        assert (camera.yaw_deg, camera.pitch_deg) == (0, 0)
        test.key_press(int(imgui.Key.right_bracket))
        assert camera.environment_deg == 15

    drive(script)


def test_flip_key_shows_the_reference_as_long_as_it_is_held(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        compared = driven.state.compared
        compared.comparison = Comparison.FIT
        test.key_down(int(imgui.Key.f))
        test.yield_(2)
        assert compared.shown is Comparison.REFERENCE
        test.key_up(int(imgui.Key.f))
        test.yield_(2)
        assert compared.shown is Comparison.FIT

    drive(script, with_reference=True)


def test_wipe_line_can_be_dragged_and_leaves_the_camera(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        compared = driven.state.compared
        compared.comparison = Comparison.WIPE
        test.yield_(2)
        box = test.item_info("Balls/##picture").rect_full
        width, y = box.max.x - box.min.x, (box.min.y + box.max.y) / 2
        test.mouse_move_to_pos(ImVec2(box.min.x + 0.5 * width, y))
        test.mouse_down(0)
        test.mouse_move_to_pos(ImVec2(box.min.x + 0.25 * width, y))
        test.yield_(2)
        test.mouse_up(0)
        assert compared.wipe == pytest.approx(0.25, abs=2 / width)  # a point of the window
        assert driven.state.camera.yaw_deg == 0

    drive(script, with_reference=True)


def test_help_lists_the_keys(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.key_press(int(imgui.Key.f1))
        test.yield_(2)
        assert driven.state.has_help
        assert test.window_info("Keys").window is not None
        test.key_press(int(imgui.Key.f1))
        assert not driven.state.has_help

    drive(script)


def test_tab_leaves_the_balls_alone_and_brings_the_panels_back(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        def picture_width() -> float:
            test.yield_(4)
            box = test.item_info("Balls/##picture").rect_full
            return box.max.x - box.min.x

        narrow = picture_width()
        test.key_press(int(imgui.Key.tab))
        wide = picture_width()
        test.key_press(int(imgui.Key.tab))
        assert wide > 1.2 * narrow
        assert picture_width() == pytest.approx(narrow, abs=2)  # rounding of the layout

    drive(script)


def test_a_docked_panel_leaves_its_ground_to_the_window_and_a_floating_one_paints_it(
    drive: Drive,
) -> None:
    def script(test: Any, driven: Driven) -> None:
        def paints() -> bool:
            test.yield_(4)
            flags = imgui.internal.find_window_by_name("Map").flags
            return not flags & imgui.WindowFlags_.no_background

        assert not paints()
        test.undock_window("Map")
        assert paints()
        test.dock_into("Map", "Balls")
        assert not paints()

    drive(script)


@pytest.mark.usefixtures("opengl")
def test_the_ground_behind_docked_panels_has_the_colour_of_the_theme(two_lamps: LobeTracks) -> None:
    session = Session(ViewerState(two_lamps), FixedSource(two_lamps), "test")
    session.state.theme = Theme.LIGHT
    picture = window_picture(session, (1000, 700))
    # of Dear ImGui's light theme, on which panels stand: most of the window is empty
    ground = (picture == round(0.94 * 255)).all(-1).mean()
    assert ground > 0.3


def centroid(channel: np.ndarray) -> np.ndarray:
    """Return row and column of the centre of what is brighter than half, [H, W] in 0 to 1."""
    return np.argwhere(channel > 0.5).mean(axis=0)


def test_map_is_upright_and_follows_the_frame(
    drive: Drive, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    boxes, seen = [], []

    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        boxes.append(test.item_info("Map/##map").rect_full)
        seen.append(captured(test, driven, tmp_path / "first.png"))
        driven.state.playback.go_to(1004)
        test.yield_(3)
        seen.append(captured(test, driven, tmp_path / "last.png"))

    drive(script)
    box = boxes[0]
    lamps = []
    for pixels in seen:
        window = pixels[int(box.min.y) : int(box.max.y), int(box.min.x) : int(box.max.x)]
        red, green, blue = np.moveaxis(window, -1, 0)
        size = np.array(red.shape)
        lamps.append((centroid(green - red - blue) / size, centroid(red - green - blue) / size))
    (green, red), (green_later, red_later) = lamps
    # tolerance: two pixels of about 200 rows, for outlines and dots drawn over the lamps
    np.testing.assert_allclose(green, [0.25, 0.25], atol=0.02)
    np.testing.assert_allclose(red, [0.75, 0.75], atol=0.02)
    np.testing.assert_allclose(green_later, [0.25, 0.5], atol=0.02)
    np.testing.assert_allclose(red_later, [0.75, 0.75], atol=0.02)


def test_settings_that_cannot_be_kept_are_said_and_the_window_opens(
    opengl: moderngl.Context,
    two_lamps: LobeTracks,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    home = tmp_path / "home"
    home.write_text("no folder")
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    use_no_display()
    session = Session(ViewerState(two_lamps), FixedSource(two_lamps), "test")
    window, pictures = Window(session, lambda path: None), []
    before = window.before_picture

    def counted() -> None:
        before()
        pictures.append(1)
        if len(pictures) > 3:
            window.leave()

    window.before_picture = counted
    running.run(window, (300, 200))
    opengl.__enter__()
    assert len(pictures) > 3
    message = session.state.message
    assert message.startswith(f"{home}/")
    assert "cannot be written (Not a directory); settings, layout" in message


def test_a_folder_for_settings_is_made(tmp_path: Path) -> None:
    assert running.settings_finding(tmp_path / "new" / "asglight") == ""
    assert list((tmp_path / "new" / "asglight").iterdir()) == []


def test_a_write_to_a_process_that_has_ended_is_an_error_after_a_window(drive: Drive) -> None:
    """The test engine leaves handlers of signals behind that would crash."""
    drive(lambda test, driven: None)
    command = [sys.executable, "-c", ""]
    with subprocess.Popen(command, stdin=subprocess.PIPE, bufsize=0) as process:
        process.wait()
        assert process.stdin is not None
        with pytest.raises(BrokenPipeError):
            process.stdin.write(b"nobody reads this")
