# SPDX-License-Identifier: Apache-2.0
"""Edits that were not saved are kept for the next window on the same stage."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import windows
from light_edits import scale_amplitude
from windows import Driven, brighten, press, wait_for

from asglight.lobes import LobeTracks
from asglight.usd import read_usd
from asglight.viewer.io.autosave import Autosave
from asglight.viewer.io.documents import Documents
from asglight.viewer.state.edits.edit import (
    Add,
    Delete,
    Mute,
    Rename,
    Restore,
    Span,
    turn,
)
from asglight.viewer.state.session import Session, no_lobes
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState

pytestmark = pytest.mark.usefixtures("no_system_dialog")


def test_kept_edits_can_be_discarded(drive_stage: Callable[..., None], tmp_path: Path) -> None:
    kept = tmp_path / "unsaved"

    def edit(test: Any, driven: Driven) -> None:
        brighten(driven)
        for _ in range(windows.WAIT_PICTURES):
            if kept.is_dir() and list(kept.glob(windows.KEPT)):
                return
            test.yield_()
        raise AssertionError

    def discard(test: Any, driven: Driven) -> None:
        test.yield_(2)
        press(test, "Discard them")
        assert not driven.state.history.is_changed
        assert not list(kept.glob(windows.KEPT))

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


def running(tracks: LobeTracks, stage: Path, kept: Path) -> Documents:
    """Return a fit that is watched, and has no lobes yet."""
    state = ViewerState(no_lobes(tracks.frames, tracks.fps))
    session = Session(state, FixedSource(tracks), stage.name, stage)
    return Documents(session, lambda _: None, kept)


def with_lobes(tracks: LobeTracks, stage: Path, kept: Path) -> Documents:
    """Return a fit that is watched, when its lobes have come."""
    documents = running(tracks, stage, kept)
    documents.session.update()
    documents.update()
    return documents


def ended(documents: Documents) -> None:
    """Let a program end without a word of the user, after what it keeps is kept."""
    documents.update()
    documents.close(is_wanted=False)


def test_edits_of_a_running_fit_are_offered_when_its_first_lobes_come(
    two_lamps: LobeTracks, tmp_path: Path
) -> None:
    kept, stage = tmp_path / "unsaved", tmp_path / "late.usda"
    first = with_lobes(two_lamps, stage, kept)
    first.state.toggle_mute(1)
    ended(first)
    closed = running(two_lamps, stage, kept)  # before any lobes came
    closed.update()
    closed.close(is_wanted=True)
    again = running(two_lamps, stage, kept)
    again.update()
    assert again.question is None
    again.session.update()
    again.update()
    assert again.question is not None
    dict(again.question.answers)["Restore them"]()
    again.question = None
    assert again.state.history.muted == {1}
    again.close(is_wanted=True)
    assert not list(kept.glob(windows.KEPT))


def test_kept_edits_that_could_not_be_offered_outlive_those_of_other_lobes(
    two_lamps: LobeTracks, tmp_path: Path
) -> None:
    kept, stage = tmp_path / "unsaved", tmp_path / "late.usda"
    ended_fit = replace(two_lamps, names=("lobe_07", "lobe_09"))
    for tracks in (two_lamps, ended_fit):
        documents = with_lobes(tracks, stage, kept)
        assert documents.question is None
        documents.state.toggle_mute(0)
        ended(documents)
    assert len(list(kept.glob(windows.KEPT))) == 2
    for tracks in (ended_fit, two_lamps):
        documents = with_lobes(tracks, stage, kept)
        assert documents.question is not None
        dict(documents.question.answers)["Discard them"]()
        documents.question = None
        documents.close(is_wanted=True)
    assert not list(kept.glob(windows.KEPT))


def offered(tracks: LobeTracks, stage: Path, kept: Path) -> str:
    """Return what a window asks that is opened on tracks, and is ended again."""
    documents = with_lobes(tracks, stage, kept)
    question = documents.question
    documents.close(is_wanted=False)
    return "" if question is None else question.text


def brighter(tracks: LobeTracks) -> LobeTracks:
    """Return tracks of the same names with other light."""
    return replace(tracks, lobes=replace(tracks.lobes, amplitude=1.05 * tracks.lobes.amplitude))


def test_kept_edits_of_lights_that_have_changed_say_so(
    two_lamps: LobeTracks, tmp_path: Path
) -> None:
    kept, stage = tmp_path / "unsaved", tmp_path / "shot.usda"
    documents = with_lobes(two_lamps, stage, kept)
    documents.state.toggle_mute(1)
    ended(documents)
    assert offered(two_lamps, stage, kept).endswith("They were kept.")
    said = "Its lights have changed since: an edit may fall on another lamp of that name."
    assert said in offered(brighter(two_lamps), stage, kept)


def test_edits_are_kept_of_the_lights_that_a_fit_has_gone_on_to(
    two_lamps: LobeTracks, tmp_path: Path
) -> None:
    kept, stage = tmp_path / "unsaved", tmp_path / "late.usda"
    documents = with_lobes(two_lamps, stage, kept)
    documents.state.toggle_mute(1)
    documents.update()
    renamed = replace(brighter(two_lamps), names=("lobe_07", "lobe_09"))
    documents.state.replace_tracks(renamed)
    assert documents.state.history.muted == {1}
    for _ in range(windows.WAIT_PICTURES):
        documents.update()
        if any("lobe_07" in file.read_text() for file in kept.glob(windows.KEPT)):
            break
        time.sleep(0.01)
    ended(documents)
    assert offered(renamed, stage, kept).endswith("They were kept.")
