# SPDX-License-Identifier: Apache-2.0
"""Editing by hand in the real window: several lobes, ranges, highlights, names, new lobes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
import written_stages
from imgui_bundle import ImVec2, imgui
from windows import Drive, Driven, map_point, rendered, wait_for

from asglight.cli.sources.opening import opened_in_window
from asglight.lobes import LobeTracks
from asglight.usd import read_usd
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.state.edits.absolute import lamp_of
from asglight.viewer.state.edits.editing import Scope
from asglight.viewer.state.views import Request

CTRL, SHIFT = int(imgui.Key.mod_ctrl), int(imgui.Key.mod_shift)


def click_with(test: Any, modifier: int, click: Any) -> None:
    """Click while a modifier is held."""
    test.key_down(modifier)
    click()
    test.key_up(modifier)
    test.yield_(2)


def ball_point(test: Any, driven: Driven, ball: int, right: float, up: float) -> ImVec2:
    """Return a point of a ball; right and up from its centre, in radii."""
    box = test.item_info("Balls/##picture").rect_full
    size = round(box.max.x - box.min.x), round(box.max.y - box.min.y)
    cell = cells(size, len(driven.state.balls))[ball]
    half = cell.size / 2
    return ImVec2(box.min.x + cell.x + half * (1 + right), box.min.y + cell.y + half * (1 - up))


def test_lobes_are_selected_together_in_list_and_map_and_turned_as_one(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.item_click("**/lobe_00")
        click_with(test, CTRL, lambda: test.item_click("**/lobe_01"))
        assert state.selected == (1, 0)
        click_with(test, CTRL, lambda: test.item_click("**/lobe_01"))
        assert state.selected == (0,)
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        click_with(test, CTRL, lambda: test.mouse_click(0))
        assert state.selected == (1, 0)
        before = state.tracks.lobes.axis_z[0].clone()
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.mouse_down(0)
        test.mouse_move_to_pos(map_point(test, 0.6, 0.75))
        test.yield_(2)
        test.mouse_up(0)
        test.yield_(2)
        after = state.tracks.lobes.axis_z[0]
        assert (after - before).norm(dim=-1).min() > 0.1
        torch.testing.assert_close(after[0] @ after[1], before[0] @ before[1])
        test.item_click("**/lobe_00")
        click_with(test, SHIFT, lambda: test.item_click("**/lobe_01"))
        assert state.selected == (0, 1)
        test.key_press(CTRL | int(imgui.Key.z))
        torch.testing.assert_close(state.tracks.lobes.axis_z[0], before, rtol=0, atol=0)

    drive(script)


def test_a_typed_intensity_brightens_all_that_are_selected(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.key_press(CTRL | int(imgui.Key.a))
        test.yield_(2)
        first = state.selected[0]
        test.item_input_value("Lobes/intensity", lamp_of(state.lobes[first]).intensity + 1)
        torch.testing.assert_close(state.tracks.lobes.amplitude, 2 * two_lamps.lobes.amplitude)
        assert len(state.history.steps) == 1

    drive(script)


def test_a_range_with_soft_ends_is_edited_between_in_and_out(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(0)
        state.playback.go_to(1002)
        test.key_press(int(imgui.Key.i))
        test.key_press(int(imgui.Key.o))
        test.yield_(2)
        test.set_ref("Lobes")
        test.combo_click("frames/in to out")
        test.set_ref("")
        assert state.editing.scope is Scope.RANGE
        test.item_input_value("Lobes/soft ends", 3)
        test.item_input_value("Lobes/intensity", lamp_of(state.lobes[0]).intensity + 1)
        gain = state.tracks.lobes.amplitude[:, 0, 1] / two_lamps.lobes.amplitude[:, 0, 1]
        share = [1 - 3 * t**2 + 2 * t**3 for t in (1 / 4, 0, 2 / 4)]  # frames 1001, 1002, 1004
        np.testing.assert_allclose(gain, 2 ** np.array(share), rtol=1e-6)
        state.playback.go_to(1004)
        test.yield_(2)
        assert not state.editing.reaches(state.moment)
        before = state.history.tracks
        test.item_click("Lobes/intensity")  # the controls wait for the playhead to come back
        test.yield_(2)
        assert state.history.tracks is before

    drive(script)


def test_hue_and_saturation_change_the_colour_and_not_the_intensity(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    lobes = two_lamps.lobes.clone()
    lobes.amplitude[:] = torch.tensor([0.9, 0.6, 0.3])

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(1)
        test.yield_(2)
        before = lamp_of(state.lobes[1])
        test.item_input_value("Lobes/hue", 210.0)
        after = lamp_of(state.lobes[1])
        assert after.intensity == pytest.approx(before.intensity, abs=1e-5)
        red, green, blue = after.colour
        assert (red / blue, green / blue) == pytest.approx((1 / 3, 2 / 3), abs=1e-3)
        test.item_input_value("Lobes/saturation", 0.0)
        assert lamp_of(state.lobes[1]).colour == pytest.approx((1, 1, 1), abs=1e-3)

    windows.drive(LobeTracks(two_lamps.frames, 24.0, lobes), script)


def test_a_highlight_is_put_where_a_ball_is_clicked_or_dragged_to(
    drive: Drive, tmp_path: Path
) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(1)
        state.camera.orbit(40, 15)
        state.camera.turn_environment(30)
        seen_from = state.camera.yaw_deg, state.camera.pitch_deg
        test.yield_(3)
        test.key_down(CTRL)
        test.mouse_move_to_pos(ball_point(test, driven, 0, 0.2, 0.1))
        test.mouse_down(0)
        test.yield_(2)
        for right, up in ((0.2, 0.1), (-0.3, 0.4)):
            test.mouse_move_to_pos(ball_point(test, driven, 0, right, up))
            test.yield_(2)
            normal = np.array([right, up, np.sqrt(1 - right**2 - up**2)])
            mirrored = 2 * normal[2] * normal - [0, 0, 1]
            wanted = state.camera.from_environment().T @ mirrored
            axis = state.lobes.axis_z[1].double().numpy()
            assert axis @ wanted > np.cos(0.06)  # a point of the window is a few degrees there
        test.mouse_up(0)
        test.key_up(CTRL)
        test.yield_(2)
        # the mirror is brightest where the light was put: the picture itself says so
        pixels = rendered(test, driven, tmp_path / "balls.exr")
        cell = cells((pixels.shape[1], pixels.shape[0]), len(state.balls))[0]
        ball = pixels[cell.y : cell.y + cell.size, cell.x : cell.x + cell.size, 0]  # red: its lobe
        row, column = np.unravel_index(ball.argmax(), ball.shape)
        found = 2 * (column + 0.5) / cell.size - 1, 1 - 2 * (row + 0.5) / cell.size
        assert found == pytest.approx((-0.3, 0.4), abs=0.05)
        assert len(state.history.steps) == 1
        assert (state.camera.yaw_deg, state.camera.pitch_deg) == seen_from

    drive(script)


def test_a_highlight_without_a_lobe_or_outside_of_the_range_says_so(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        yaw = state.camera.yaw_deg

        def click() -> None:
            test.mouse_move_to_pos(ball_point(test, driven, 0, 0.2, 0.1))
            test.mouse_click(0)

        state.select(None)
        click_with(test, CTRL, click)
        assert state.message.startswith("No lobe is selected.")
        state.select(0)
        state.editing.scope = Scope.RANGE
        state.playback.mark_out()
        state.playback.go_to(1004)
        click_with(test, CTRL, click)
        assert state.message.startswith("A highlight is put in a frame that the edit reaches")
        assert not state.history.is_changed
        assert state.camera.yaw_deg == yaw

    drive(script)


def test_a_lobe_is_renamed_in_the_list(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.item_click("**/lobe_01")
        test.key_press(int(imgui.Key.f2))
        test.yield_(3)
        test.key_chars_replace_enter("window ## left")
        test.yield_(2)
        assert state.lobe_names[1] == "window ## left"
        assert state.renaming is None
        io = imgui.get_io()  # a loaded machine draws slowly
        io.mouse_single_click_delay, io.mouse_double_click_time = 11.0, 10.0
        test.mouse_move("**/lobe_00")
        test.mouse_double_click(0)
        test.yield_(3)
        assert state.renaming is not None
        test.key_chars("other")
        test.key_press(int(imgui.Key.escape))
        test.yield_(3)
        assert state.renaming is None
        assert state.lobe_names[0] == "lobe_00"
        assert state.selected == (0,)  # Escape has ended the typing and nothing else

    drive(script)


def test_a_lobe_is_added_where_the_pointer_is_and_deleted(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.mouse_move_to_pos(map_point(test, 0.1, 0.3))
        test.yield_(2)
        test.key_press(int(imgui.Key.n))
        test.yield_(2)
        assert state.selected == (2,)
        lamp = lamp_of(state.lobes[2])
        assert (lamp.azimuth, lamp.elevation) == pytest.approx((144, 36), abs=1.5)
        test.item_click("**/lobe_02")
        test.key_press(int(imgui.Key.delete))
        test.yield_(2)
        assert state.history.present == (0, 1)
        assert not test.item_exists("**/lobe_02")
        test.item_click("Lobes/undo")
        test.yield_(2)
        assert state.history.present == (0, 1, 2)

    drive(script)


def test_what_is_muted_named_added_and_deleted_is_there_when_the_layer_is_opened(
    drive: Drive, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    stage, layer = tmp_path / "shot.usda", tmp_path / "edits.usda"
    written_stages.put(two_lamps, stage)

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.toggle_mute(0)
        state.select(0)
        test.key_press(int(imgui.Key.f2))
        test.yield_(3)
        test.key_chars_replace_enter("sun")
        test.yield_(2)
        test.key_press(int(imgui.Key.n))
        state.select(1)
        test.key_press(int(imgui.Key.delete))
        driven.window.save(Request.SAVE_EDITS, layer)
        wait_for(test, driven, "Saved edits.usda.")
        driven.window.documents.open(str(layer))
        wait_for(test, driven, "Opened edits.usda.")
        test.yield_(4)
        state = driven.state
        assert state.lobe_names == ("sun", "lobe_02")
        assert state.history.muted == {0}
        assert state.lit == (1,)
        state.select(0)
        test.key_press(int(imgui.Key.x))
        assert state.lit == (0, 1)
        torch.testing.assert_close(
            state.lobes.amplitude[0], two_lamps.lobes.amplitude[0, 0], rtol=1e-6, atol=1e-7
        )

    windows.drive(read_usd(stage), script, stage=stage, opener=opened_in_window)
