# SPDX-License-Identifier: Apache-2.0
"""Lobes and files in the real window: select, solo, edit, undo, save, drop, open."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
import written_stages
from imgui_bundle import ImVec2, imgui
from light_edits import scale_amplitude
from windows import Drive, Driven, map_point, wait_for

from asglight.errors import InputError
from asglight.images import write_exr
from asglight.lobes import LobeTracks
from asglight.sphere import latlong
from asglight.usd import read_usd
from asglight.viewer.gl.arrangement import cells
from asglight.viewer.state.edits.absolute import lamp_of
from asglight.viewer.state.edits.edit import Span
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request


def test_click_in_the_map_selects_and_keys_solo_and_mute(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        selection = driven.state.selection
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.mouse_click(0)
        assert selection.lobe == 1
        test.key_press(int(imgui.Key.s))
        assert driven.state.lit == (1,)
        test.key_press(int(imgui.Key.s))
        test.key_press(int(imgui.Key.x))
        assert driven.state.lit == (0,)
        test.key_press(int(imgui.Key.escape))
        assert driven.state.lit == (0,)  # a mute is an edit: it is undone
        assert selection.lobe is None

    drive(script)


def test_list_selects_solos_and_mutes(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.item_click("**/lobe_01")
        assert driven.state.selection.lobe == 1
        test.item_click("**/S")
        assert len(driven.state.lit) == 1
        test.item_click("**/S")
        test.item_click("**/M")
        assert len(driven.state.lit) == 1

    drive(script)


def test_dragging_a_lobe_turns_it_in_all_frames_and_is_undone_in_one_step(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.mouse_down(0)
        for u in (0.7, 0.65, 0.6):
            test.mouse_move_to_pos(map_point(test, u, 0.75))
            test.yield_(2)
        test.mouse_up(0)
        test.yield_(2)
        for frame in range(3):
            axis = driven.state.tracks.lobes.axis_z[frame, 1]
            u, v = latlong.uv_from_direction(axis)
            # a point of the window is 0.2 % of the map's width
            assert (float(u), float(v)) == pytest.approx((0.6, 0.75), abs=0.006)
        assert driven.state.history.edited_lobes == (1,)
        test.key_press(int(imgui.Key.mod_ctrl) | int(imgui.Key.z))
        torch.testing.assert_close(
            driven.state.tracks.lobes.axes, two_lamps.lobes.axes, rtol=0, atol=0
        )
        assert not driven.state.history.is_changed

    drive(script)


def test_slider_edits_one_frame_lights_live_and_ends_as_a_step(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(0)
        test.yield_(2)
        test.set_ref("Lobes")
        test.combo_click("frames/this frame")
        test.set_ref("")
        shaded = driven.window.renderer.counts.shaded
        test.item_input_value("Lobes/intensity", lamp_of(state.lobes[0]).intensity + 1)
        test.yield_(2)
        assert driven.window.renderer.counts.shaded > shaded
        wanted = two_lamps.lobes.amplitude.clone()
        wanted[0, 0] *= 2
        torch.testing.assert_close(state.tracks.lobes.amplitude, wanted)
        test.item_click("Lobes/undo")
        torch.testing.assert_close(state.tracks.lobes.amplitude, two_lamps.lobes.amplitude)
        test.item_click("Lobes/redo")
        torch.testing.assert_close(state.tracks.lobes.amplitude, wanted)

    drive(script)


def test_edits_are_saved_as_a_layer_that_leaves_the_stage_untouched(
    drive: Drive, two_lamps: LobeTracks, tmp_path: Path
) -> None:
    stage, layer = tmp_path / "shot.usda", tmp_path / "edits.usda"
    written_stages.put(two_lamps, stage)
    before = stage.read_bytes()

    def script(test: Any, driven: Driven) -> None:
        driven.window.session.stage = stage
        driven.state.select(0)
        test.yield_(2)
        stops = lamp_of(driven.state.lobes[0]).intensity
        test.item_input_value("Lobes/intensity", stops + 1)
        test.yield_(2)
        driven.window.save(Request.SAVE_EDITS, layer)
        wait_for(test, driven, "Saved edits.usda.")

    windows.drive(read_usd(stage), script)
    assert stage.read_bytes() == before
    saved = read_usd(layer).lobes.amplitude
    torch.testing.assert_close(saved[:, 0], 2 * two_lamps.lobes.amplitude[:, 0])
    torch.testing.assert_close(saved[:, 1], two_lamps.lobes.amplitude[:, 1])


def test_saving_without_edits_or_stage_says_what_is_missing(drive: Drive, tmp_path: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.window.save(Request.SAVE_EDITS, tmp_path / "a.usda")
        wait_for(test, driven, "edits: none made; expected one or more. Change a lobe first.")
        driven.state.select(0)
        test.yield_(2)
        stops = lamp_of(driven.state.lobes[0]).intensity
        test.item_input_value("Lobes/intensity", stops + 1)
        driven.window.save(Request.SAVE_EDITS, tmp_path / "a.usda")
        wait_for(test, driven, "edits: no stage under them; expected lobes that were read from one")

    drive(script)
    assert not list(tmp_path.iterdir())


def test_picture_is_saved_as_png(drive: Drive, tmp_path: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        driven.window.save(Request.SAVE_PICTURE, tmp_path / "balls.png")
        wait_for(test, driven, "Saved balls.png.")

    drive(script)
    assert (tmp_path / "balls.png").read_bytes().startswith(b"\x89PNG")


def test_dropped_image_is_compared_with(drive: Drive, tmp_path: Path) -> None:
    image = tmp_path / "sky.exr"
    write_exr(image, torch.full((16, 32, 3), 0.25))

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped([str(image)])
        wait_for(test, driven, "Opened sky.exr.")
        references = driven.state.references
        assert references is not None
        assert references.name == "sky"
        found = references.wait(1001, 10)
        np.testing.assert_allclose(found, 0.25)

    drive(script)


def test_dropped_stage_replaces_the_shown_one_and_keeps_the_look(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    other = LobeTracks((7, 8, 9), 25.0, two_lamps.lobes)

    def opener(path: str) -> Session:
        assert path == "other.usda"
        return Session(ViewerState(other), FixedSource(other), "other")

    def script(test: Any, driven: Driven) -> None:
        driven.state.display.expose(2.0)
        driven.window.dropped(["other.usda"])
        wait_for(test, driven, "Opened other.usda.")
        assert driven.state.playback.frames == (7, 8, 9)
        assert driven.state.display.exposure_ev == 2.0

    drive(script, opener=opener)


def test_what_cannot_be_opened_says_why_and_changes_nothing(drive: Drive) -> None:
    def opener(path: str) -> Session:
        raise InputError(f"{path}: is no stage; expected one.")

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped(["a.usda"])
        wait_for(test, driven, "a.usda: is no stage; expected one.")
        assert driven.state.playback.frames == (1001, 1002, 1004)

    drive(script, opener=opener)


@pytest.mark.parametrize("kind", [KeyboardInterrupt, ZeroDivisionError])
def test_what_ends_a_picture_ends_the_window_and_is_raised(
    drive: Drive, kind: type[BaseException]
) -> None:
    def opener(path: str) -> Session:
        raise kind

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped(["a.usda"])
        test.yield_(20)

    with pytest.raises(kind):
        drive(script, opener=opener)


def test_pointing_at_the_map_fills_the_inspector(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.mouse_move_to_pos(map_point(test, 0.25, 0.25))
        test.yield_(2)
        inspected = driven.state.inspected
        assert inspected is not None
        assert inspected.place == "map"
        assert inspected.fit is not None
        # two points (1.5 degrees) from the centre of a lamp of 0.9, 3 degrees wide: 12 % at most
        np.testing.assert_allclose(inspected.fit, [0, 0.9, 0], atol=0.11)

    drive(script)


def test_pointing_at_a_ball_reads_its_radiance(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(3)
        box = test.item_info("Balls/##picture").rect_full
        x, y, side = cells((int(box.max.x - box.min.x), int(box.max.y - box.min.y)), 6)[0]
        test.mouse_move_to_pos(ImVec2(box.min.x + x + side / 2, box.min.y + y + side / 2))
        test.yield_(2)
        inspected = driven.state.inspected
        assert inspected is not None
        assert inspected.place.startswith("roughness")
        assert inspected.fit is not None
        assert np.isfinite(inspected.fit).all()
        assert inspected.reference is None

    drive(script)


def test_the_inspector_follows_frame_and_edit(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))  # the red lamp, which rests
        test.yield_(2)

        def red() -> float:
            assert state.inspected is not None
            assert state.inspected.fit is not None
            return float(state.inspected.fit[0])

        test.mouse_move_to_pos(map_point(test, 0.25, 0.25))  # the green lamp, which moves on
        test.yield_(2)
        assert state.inspected is not None
        assert state.inspected.fit is not None
        assert state.inspected.fit[1] > 0.7
        test.mouse_move_to_pos(test.item_info("Timeline/##bar").rect_full.min)
        test.key_press(int(imgui.Key.end))
        test.yield_(2)
        assert state.inspected.fit[1] < 0.01
        test.mouse_move_to_pos(map_point(test, 0.75, 0.75))
        test.yield_(2)
        before = red()
        state.history.add(scale_amplitude(1, None, 1.0))
        test.yield_(2)
        assert red() == pytest.approx(2 * before)

    drive(script)


def test_the_inspected_ball_follows_an_edit_and_shows_none_of_another_frame(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        test.yield_(3)
        box = test.item_info("Balls/##picture").rect_full
        x, y, side = cells((int(box.max.x - box.min.x), int(box.max.y - box.min.y)), 6)[5]
        test.mouse_move_to_pos(ImVec2(box.min.x + x + side / 2, box.min.y + y + side / 2))
        test.yield_(2)
        assert state.inspected is not None
        assert state.inspected.fit is not None
        before = state.inspected.fit.copy()
        for lobe in (0, 1):
            state.history.add(scale_amplitude(lobe, None, 1.0))
        test.yield_(3)
        np.testing.assert_allclose(state.inspected.fit, 2 * before, rtol=1e-3)  # of a half float
        state.playback.play(0.0)
        test.yield_(2)
        assert state.inspected.fit is None  # it would be of a frame that has gone by

    drive(script)


def test_a_click_with_a_trembling_hand_turns_nothing(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        start = map_point(test, 0.75, 0.75)
        test.mouse_move_to_pos(start)
        test.mouse_down(0)
        for x, y in ((3, 2), (-2, 4), (4, -3)):
            test.mouse_move_to_pos(ImVec2(start.x + x, start.y + y))
            test.yield_(2)
        test.mouse_up(0)
        test.yield_(2)
        assert driven.state.selection.lobe == 1
        assert not driven.state.history.is_changed

    drive(script)


def test_controls_show_what_a_lobe_is_and_keep_what_was_set(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    lobes = two_lamps.lobes.clone()
    lobes.amplitude.add_(0.3)  # so that no channel is without light

    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.select(1)
        test.yield_(2)
        test.item_input_value("Lobes/azimuth", 40.0)
        test.item_input_value("Lobes/elevation", -20.0)
        test.item_input_value("Lobes/width", 12.0)
        test.item_input_value("Lobes/temperature", 3200.0)
        lamp = lamp_of(state.lobes[1])
        found = lamp.azimuth, lamp.elevation, lamp.width, lamp.kelvin
        assert found == pytest.approx((40, -20, 12, 3200), rel=1e-3)
        assert len(state.history.edits) == 4
        test.item_input_value("Lobes/radiance", 0.9)
        assert lamp_of(state.lobes[1]).radiance == pytest.approx(0.9, rel=1e-4)
        test.item_click("Lobes/azimuth", 1)  # the right button
        test.yield_(2)
        fitted = lamp_of(state.fitted_lobe(1))
        assert lamp_of(state.lobes[1]).azimuth == pytest.approx(fitted.azimuth, abs=1e-3)

    windows.drive(LobeTracks(two_lamps.frames, 24.0, lobes), script)


def test_the_list_keeps_its_order_and_follows_the_selection(
    drive: Drive, two_lamps: LobeTracks
) -> None:
    def heights(test: Any) -> list[float]:
        return [test.item_info(f"Lobes/**/lobe_0{n}").rect_full.min.y for n in (0, 1)]

    def script(test: Any, driven: Driven) -> None:
        test.yield_(2)
        before = heights(test)
        driven.state.history.add(scale_amplitude(1, None, 5.0))
        driven.state.playback.go_to(1004)
        test.yield_(2)
        assert heights(test) == before
        driven.state.select(1)
        test.yield_(2)
        assert not driven.state.selection.is_new

    drive(script)


def test_the_history_shows_each_edit_and_goes_back_to_it(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        state = driven.state
        state.history.add(scale_amplitude(0, None, 1.0))
        state.toggle_mute(1)
        state.history.add(scale_amplitude(1, Span.at(2), 1.0, (1.0, 0.5, 1.0)))
        assert [edit.what for step in state.history.steps for edit in step] == [
            "intensity +1.00 EV",
            "mute on or off",
            "colour",
        ]
        test.window_focus("History")
        test.yield_(3)
        test.item_click("History/##step1")
        assert state.history.position == 1
        assert state.lit == (0, 1)
        assert len(state.history.steps) == 3
        test.item_click("History/##step3")
        assert state.history.position == 3
        test.item_click("History/##step0")
        assert not state.history.is_changed

    drive(script)
