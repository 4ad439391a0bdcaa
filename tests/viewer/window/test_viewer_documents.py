# SPDX-License-Identifier: Apache-2.0
"""An artist's work in the real window: named, saved, asked about, kept, opened; never lost."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import windows
from imgui_bundle import imgui
from places import SUPPORT
from windows import Drive, Driven, wait_for

from asglight.images import write_exr
from asglight.images.frame_files import sequence_of
from asglight.lobes import LobeTracks
from asglight.usd import read_usd, write_usd
from asglight.viewer.io import native
from asglight.viewer.io.autosave import Autosave
from asglight.viewer.io.browsing import Kind, listed
from asglight.viewer.state.display import Comparison
from asglight.viewer.state.edits.edit import (
    Add,
    Delete,
    Mute,
    Rename,
    Restore,
    Span,
    scale_amplitude,
    turn,
)
from asglight.viewer.state.session import Session, no_lobes
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

CTRL = int(imgui.Key.mod_ctrl)


@pytest.fixture
def stage(two_lamps: LobeTracks, tmp_path: Path) -> Path:
    """Write two lamps as `shot.usda`, alone in a folder."""
    path = tmp_path / "shot" / "shot.usda"
    path.parent.mkdir()
    write_usd(two_lamps, path, dome_height=2)
    return path


@pytest.fixture
def drive_stage(drive: Drive, stage: Path) -> Callable[..., None]:
    """Open a window on that stage, on a system without dialogs of its own."""

    def _drive(script: Callable[[Any, Driven], None], **options: Any) -> None:
        windows.drive(read_usd(stage), script, stage=stage, **options)

    return _drive


@pytest.fixture(autouse=True)
def _no_system_dialog(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "has_dialog", lambda: False)


def brighten(driven: Driven, lobe: int = 0) -> None:
    driven.state.history.add(scale_amplitude(lobe, None, 1.0))


def press(test: Any, *labels: str) -> None:
    for label in labels:
        test.item_click(f"//$FOCUSED/{label}")
        test.yield_(2)


def sequence(folder: Path, frames: tuple[int, ...] = (1001, 1002, 1004)) -> Path:
    folder.mkdir(exist_ok=True)
    for frame in frames:
        write_exr(folder / f"sky.{frame}.exr", torch.full((8, 16, 3), frame / 1000))
    return folder


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


def test_the_browser_lists_a_sequence_as_one_and_opens_it(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    sequence(stage.parent / "plates")

    def script(test: Any, driven: Driven) -> None:
        test.key_press(CTRL | int(imgui.Key.o))
        test.yield_(2)
        io = imgui.get_io()  # a slow machine is no slow hand
        io.mouse_double_click_time, io.mouse_single_click_delay = 60, 61
        test.item_double_click("**/##entry0")
        test.yield_(2)
        browser = driven.window.documents.browser
        assert browser is not None
        assert browser.folder.name == "plates"
        test.item_double_click("**/##entry0")
        wait_for(test, driven, "Opened sky.####.exr.")
        assert driven.state.references is not None
        assert driven.state.references.frames == (1001, 1002, 1004)

    drive_stage(script)


def test_escape_leaves_the_browser_and_opens_nothing(drive_stage: Callable[..., None]) -> None:
    def script(test: Any, driven: Driven) -> None:
        driven.state.select(1)
        test.key_press(CTRL | int(imgui.Key.o))
        test.yield_(2)
        test.key_press(int(imgui.Key.escape))
        test.yield_(2)
        assert driven.window.documents.browser is None
        assert driven.state.selection.lobe == 1

    drive_stage(script)


def test_a_folder_that_cannot_be_listed_leaves_its_reason(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"gone: cannot be listed \(No such file.*Check the path"):
        listed(tmp_path / "gone")


def test_a_folder_lists_folders_stages_sequences_and_stills(stage: Path) -> None:
    folder = sequence(stage.parent)
    write_exr(folder / "still.exr", torch.zeros(4, 8, 3))
    (folder / ".hidden").mkdir()
    (folder / "plates").mkdir()
    (folder / "notes.txt").write_text("x")
    found = [(entry.title, entry.kind) for entry in listed(folder)]
    assert found == [
        ("plates/", Kind.FOLDER),
        ("shot.usda", Kind.STAGE),
        ("sky.####.exr 1001-1004", Kind.SEQUENCE),
        ("still.exr", Kind.IMAGE),
    ]
    assert sequence_of(folder / "sky.1002.exr") == str(folder / "sky.####.exr")
    assert sequence_of(folder / "still.exr") is None
    assert sequence_of(folder / "gone.exr") is None


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


CRASH = """
import os, sys
from pathlib import Path
import windows
from asglight.usd import read_usd
from asglight.viewer.state.edits.edit import scale_amplitude

stage, kept = map(Path, sys.argv[1:])

def script(test, driven):
    driven.state.history.add(scale_amplitude(0, None, 1.0))
    driven.state.toggle_mute(1)
    while not list(kept.glob("*.json")):
        test.yield_()
    os._exit(9)

windows.drive(read_usd(stage), script, stage=stage, autosaves=kept)
"""


def test_edits_are_offered_after_a_crash(
    drive_stage: Callable[..., None], stage: Path, tmp_path: Path, two_lamps: LobeTracks
) -> None:
    kept = tmp_path / "unsaved"
    support = SUPPORT
    path = os.pathsep.join([str(support), os.environ.get("PYTHONPATH", "")])
    crashed = subprocess.run(
        [sys.executable, "-c", CRASH, str(stage), str(kept)],
        env={**os.environ, "PYTHONPATH": path},
        timeout=60,
    )
    assert crashed.returncode == 9

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
        assert not list(kept.glob("*.json"))  # what is saved is not offered again

    drive_stage(script, autosaves=kept)


def test_kept_edits_can_be_discarded(drive_stage: Callable[..., None], tmp_path: Path) -> None:
    kept = tmp_path / "unsaved"

    def edit(test: Any, driven: Driven) -> None:
        brighten(driven)
        for _ in range(windows.WAIT_PICTURES):
            if kept.is_dir() and list(kept.glob("*.json")):
                return
            test.yield_()
        raise AssertionError

    def discard(test: Any, driven: Driven) -> None:
        test.yield_(2)
        press(test, "Discard them")
        assert not driven.state.history.is_changed
        assert not list(kept.glob("*.json"))

    drive_stage(edit, autosaves=kept)  # ends without an answer of the user
    drive_stage(discard, autosaves=kept)


@pytest.mark.parametrize("content", ["", "{}", '{"lobes": [], "frames": [], "steps": []}'])
def test_kept_edits_of_other_lobes_or_damaged_ones_are_not_offered(
    drive_stage: Callable[..., None], stage: Path, tmp_path: Path, content: str
) -> None:
    autosave = Autosave(tmp_path, stage)
    autosave.path.write_text(content)
    autosave.close()

    def script(test: Any, driven: Driven) -> None:
        assert driven.window.documents.question is None

    drive_stage(script, autosaves=tmp_path)


def test_a_folder_that_cannot_keep_edits_is_said(
    drive_stage: Callable[..., None], tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")

    def script(test: Any, driven: Driven) -> None:
        brighten(driven)
        wait_for(test, driven, f"{blocked}: cannot be made (File exists); expected a folder for")

    drive_stage(script, autosaves=blocked)


def test_one_image_of_a_sequence_opens_the_shots_sequence(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    folder = sequence(stage.parent / "plates")

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped([str(folder / "sky.1001.exr")])
        wait_for(test, driven, "Opened sky.1001.exr.")
        references = driven.state.references
        assert references is not None
        for frame in (1001, 1004):  # frame 1004 is compared with its own image
            np.testing.assert_allclose(references.wait(frame, 10), frame / 1000, rtol=1e-3)

    drive_stage(script)


def test_a_still_that_is_held_says_which_image_it_is(
    drive_stage: Callable[..., None], stage: Path
) -> None:
    folder = sequence(stage.parent / "plates", (1001,))

    def script(test: Any, driven: Driven) -> None:
        driven.window.dropped([str(folder / "sky.1001.exr")])
        wait_for(test, driven, "Opened sky.1001.exr.")
        held = "Its one image, sky 1001, is held for every frame."
        assert driven.state.message.endswith(held)
        references = driven.state.references
        assert references is not None
        assert references.label(1001) == ""
        assert references.label(1002) == "sky 1001 held"

    drive_stage(script)


@pytest.mark.parametrize("name", ["README.md", "shot.png", "cut.exr"])
def test_what_cannot_be_read_leaves_the_good_reference(
    drive_stage: Callable[..., None], stage: Path, tmp_path: Path, name: str
) -> None:
    bad = tmp_path / name
    whole = tmp_path / "whole.exr"
    write_exr(whole, torch.rand(32, 64, 3))
    bad.write_bytes(whole.read_bytes()[:700] if name == "cut.exr" else b"no image at all")

    def script(test: Any, driven: Driven) -> None:
        before = driven.state.references
        assert before is not None
        driven.window.dropped([str(bad)])
        wait_for(test, driven, "", lambda: bool(driven.state.message))
        assert not driven.state.message.startswith("Opened")
        assert name in driven.state.message
        assert driven.state.references is before
        assert before.wait(1001, 10) is not None
        assert driven.window.documents.recent == []

    drive_stage(script, with_reference=True)


def test_images_without_lobes_are_shown_alone_and_without_an_error(drive: Drive) -> None:
    bare = no_lobes((1001, 1002), 24.0)

    def script(test: Any, driven: Driven) -> None:
        assert driven.state.shown is Comparison.REFERENCE
        for _ in range(20):
            test.yield_()
        assert driven.window.renderer.ball_errors(driven.state) is None

    windows.drive(bare, script, with_reference=True)


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


def test_kept_edits_are_what_was_done(stage: Path, tmp_path: Path) -> None:
    tracks = read_usd(stage)
    steps = (
        (turn(0, Span(0, 1, 2), [0, 0, 1], [0, 1, 1]),),
        (scale_amplitude(1, None, 1.5, (1.0, 0.5, 2.0)), scale_amplitude(0, None, 1.5)),
        (Mute(1),),
        (Add(2, (0.0, 1.0, 0.0), 40.0, (1.0, 0.5, 0.25)),),
        (Rename(2, "window, left"),),
        (Restore(0), Delete(1)),
    )
    autosave = Autosave(tmp_path / "deep" / "unsaved", stage)
    autosave.keep(tracks, steps)
    assert autosave.found(tracks) == steps
    assert json.loads(autosave.path.read_text())["stage"] == str(stage.resolve())
    autosave.drop()
    autosave.drop()
    assert autosave.found(tracks) == ()


def test_two_windows_on_one_stage_keep_their_edits_apart(stage: Path, tmp_path: Path) -> None:
    tracks = read_usd(stage)
    first, second = Autosave(tmp_path, stage), Autosave(tmp_path, stage)
    first.keep(tracks, ((Mute(0),),))
    second.keep(tracks, ((Mute(1),),))
    third = Autosave(tmp_path, stage)
    assert third.found(tracks) == ()  # the others are open: what they keep is theirs
    assert first.found(tracks) == ((Mute(0),),)
    assert second.found(tracks) == ((Mute(1),),)
    second.close()  # as when its program has ended without saving
    fourth = Autosave(tmp_path, stage)
    assert fourth.found(tracks) == ((Mute(1),),)
    fourth.drop()
    for one in (first, third, fourth):
        one.close()
    last = Autosave(tmp_path, stage)
    assert last.found(tracks) == ((Mute(0),),)
    last.close()
