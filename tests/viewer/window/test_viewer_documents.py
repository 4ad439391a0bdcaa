# SPDX-License-Identifier: Apache-2.0
"""An artist's work in the real window: named, saved, asked about; never lost."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from imgui_bundle import imgui
from light_edits import scale_amplitude
from windows import Drive, Driven, brighten, press, wait_for

from asglight.lobes import LobeTracks
from asglight.usd import read_usd
from asglight.viewer.io.browsing import Kind
from asglight.viewer.state.session import Session
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

CTRL = int(imgui.Key.mod_ctrl)

pytestmark = pytest.mark.usefixtures("no_system_dialog")


def test_without_a_system_dialog_edits_are_saved_through_the_windows_own(
    drive_stage: Callable[..., None], stage: Path, two_lamps: LobeTracks
) -> None:
    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        test.key_press(CTRL | int(imgui.Key.s))
        test.yield_(2)
        browser = driven.window.documents.browser
        assert browser is not None
        assert browser.name == "shot_edits.usda"
        assert [entry.title for entry in browser.entries if entry.kind is Kind.FILE] == [
            "shot.usda"
        ]
        press(test, "###accept")
        wait_for(test, driven, "Saved shot_edits.usda.")
        assert driven.window.documents.browser is None

    drive_stage(script)
    saved = read_usd(stage.with_name("shot_edits.usda"))
    torch.testing.assert_close(saved.lobes.amplitude[:, 0], 2 * two_lamps.lobes.amplitude[:, 0])


def test_without_a_system_dialog_the_picture_is_saved_through_the_windows_own(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.key_press(CTRL | int(imgui.Key.p))
        test.yield_(2)
        press(test, "###accept")
        wait_for(test, driven, "Saved shot.1001.png.")

    drive_stage(script)
    assert stage.with_name("shot.1001.png").read_bytes().startswith(b"\x89PNG")


def test_the_title_is_marked_while_edits_are_unsaved(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    import glfw
    from imgui_bundle import glfw_utils

    def title() -> str:
        return glfw.get_window_title(glfw_utils.glfw_window_hello_imgui())

    def script(test: Any, driven: Driven) -> None:
        test.yield_(2)
        assert title() == "shot.usda - asglight"
        brighten(driven)
        test.yield_(2)
        assert title() == "shot.usda* - asglight"
        driven.window.save(Request.SAVE_EDITS, stage.with_name("edits.usda"))
        wait_for(test, driven, "Saved edits.usda.")
        test.yield_(2)
        assert title() == "shot.usda - asglight"
        test.key_press(CTRL | int(imgui.Key.z))
        test.yield_(2)
        assert title() == "shot.usda* - asglight"

    drive_stage(script)


def test_closing_with_unsaved_edits_asks_first(drive_stage: Callable[..., None]) -> None:
    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        test.yield_(2)
        assert not driven.window.confirm_exit()  # the window's close button
        test.yield_(3)
        assert not driven.has_left
        press(test, "Cancel")
        assert not driven.has_left
        test.key_press(CTRL | int(imgui.Key.q))
        test.yield_(2)
        question = driven.window.documents.question
        assert question is not None
        assert question.text == "The edits of shot.usda are not saved."
        press(test, "Discard them")
        assert driven.has_left

    drive_stage(script)


def test_closing_can_save_first(drive_stage: Callable[..., None], stage: Path) -> None:
    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        driven.window.confirm_exit()
        test.yield_(2)
        press(test, "Save...", "###accept")
        wait_for(test, driven, "Saved shot_edits.usda.")
        test.yield_(2)
        assert driven.has_left

    drive_stage(script)
    assert stage.with_name("shot_edits.usda").exists()


def test_a_save_that_is_left_does_not_close_the_window_later(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        driven.window.confirm_exit()
        test.yield_(2)
        press(test, "Save...", "Cancel")
        driven.window.save(Request.SAVE_EDITS, stage.with_name("edits.usda"))
        wait_for(test, driven, "Saved edits.usda.")
        assert not driven.has_left

    drive_stage(script)


def test_a_window_without_edits_closes_at_once(drive_stage: Callable[..., None]) -> None:
    def script(test: Any, driven: Driven) -> None:
        test.yield_(2)
        assert driven.window.confirm_exit()

    drive_stage(script)


def test_opening_another_stage_asks_before_edits_are_dropped(
    drive_stage: Callable[..., None], two_lamps: LobeTracks
) -> None:
    other = LobeTracks((7, 8, 9), 25.0, two_lamps.lobes)

    def opener(path: str) -> Session:
        return Session(ViewerState(other), FixedSource(other), "other")

    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        driven.window.dropped(["other.usda"])
        test.yield_(3)
        press(test, "Cancel")
        assert driven.state.playback.frames == (1001, 1002, 1004)
        assert driven.window.documents.recent == []
        driven.window.dropped(["other.usda"])
        test.yield_(3)
        press(test, "Discard them")
        assert driven.state.playback.frames == (7, 8, 9)

    drive_stage(script, opener=opener)


def test_mute_is_undone_and_saved_as_any_edit(
    drive_stage: Callable[..., None], stage: Path, two_lamps: LobeTracks
) -> None:
    layer = stage.with_name("muted.usda")

    def script(test: Any, driven: Driven) -> None:
        driven.state.select(1)
        test.key_press(int(imgui.Key.x))
        assert driven.state.lit == (0,)
        test.key_press(int(imgui.Key.escape))
        assert driven.state.lit == (0,)  # what was edited stays
        test.key_press(CTRL | int(imgui.Key.z))
        assert driven.state.lit == (0, 1)
        test.key_press(CTRL | int(imgui.Key.mod_shift) | int(imgui.Key.z))
        assert driven.state.lit == (0,)
        driven.window.save(Request.SAVE_EDITS, layer)
        wait_for(test, driven, "Saved muted.usda.")

    drive_stage(script)
    saved = read_usd(layer).lobes.amplitude
    assert (saved[:, 1] == 0).all()
    torch.testing.assert_close(saved[:, 0], two_lamps.lobes.amplitude[:, 0])


@pytest.mark.parametrize(
    ("has_path", "message"),
    [
        (False, "edits: no stage under them; expected lobes that were read from one"),
        (True, "edits: late.usda is not written yet; expected a fit that has ended."),
    ],
)
def test_a_running_fit_says_before_a_file_is_named_that_edits_cannot_be_saved(
    drive: Drive, tmp_path: Path, has_path: bool, message: str
) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.window.session.stage = tmp_path / "late.usda" if has_path else None
        brighten(driven)
        test.key_press(CTRL | int(imgui.Key.s))
        test.yield_(2)
        assert driven.window.documents.browser is None
        assert driven.state.message.startswith(message)

    drive(script)


def test_a_question_says_why_edits_cannot_be_saved(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        driven.window.confirm_exit()
        question = driven.window.documents.question
        assert question is not None
        assert "They cannot be saved: edits: no stage under them" in question.text
        assert [label for label, _ in question.answers] == ["Discard them", "Cancel"]

    drive(script)


def test_edits_of_a_running_fit_stay_when_new_frames_come(two_lamps: LobeTracks) -> None:
    state = ViewerState(two_lamps)
    state.history.add(scale_amplitude(0, None, 1.0))
    state.toggle_mute(1)
    lobes = two_lamps.lobes.clone()
    lobes.amplitude[2] *= 3
    state.replace_tracks(LobeTracks(two_lamps.frames, 24.0, lobes))
    torch.testing.assert_close(state.tracks.lobes.amplitude[:, 0], 2 * lobes.amplitude[:, 0])
    assert state.lit == (0,)
    assert state.history.is_unsaved


def test_escape_closes_the_menu_before_it_deselects(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(1)
        test.key_press(int(imgui.Key.s))
        test.menu_click("//##MainMenuBar/Edit")
        test.yield_(2)
        assert imgui.is_popup_open("", int(imgui.PopupFlags_.any_popup))
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        assert not imgui.is_popup_open("", int(imgui.PopupFlags_.any_popup))
        assert driven.state.selection.lobe == 1
        assert driven.state.lit == (1,)
        test.key_press(int(imgui.Key.f1))
        test.key_press(int(imgui.Key.escape))
        assert not driven.state.has_help
        assert driven.state.selection.lobe == 1
        test.key_press(int(imgui.Key.escape))
        assert driven.state.selection.lobe is None
        assert driven.state.lit == (0, 1)

    drive(script)


def test_escape_closes_a_list_before_it_deselects(drive: Drive) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(1)
        test.item_click("Look/view")
        test.yield_(2)
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        assert not imgui.is_popup_open("", int(imgui.PopupFlags_.any_popup))
        assert driven.state.selection.lobe == 1

    drive(script)
