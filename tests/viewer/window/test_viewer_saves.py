# SPDX-License-Identifier: Apache-2.0
"""Documents without a window: saves that overlap, and stages that are to be B."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from key_cases import Rectangle, with_lamps
from keyed_stages import FRAMES, write

from asglight.cli.sources.opening import Request as Opening
from asglight.cli.sources.opening import opened, opened_in_window
from asglight.images import write_exr
from asglight.usd import read_usd
from asglight.viewer.io.documents import Documents
from asglight.viewer.reference.images import open_reference
from asglight.viewer.state.session import Session, no_lobes
from asglight.viewer.state.source import FixedSource
from asglight.viewer.state.viewer_state import ViewerState
from asglight.viewer.state.views import Request

PIXELS = np.zeros((4, 4, 3), np.uint8)

WAIT_S = 60.0
"""For a file of a few kilobytes, on a machine that has other work."""


@pytest.fixture
def documents(stage: Path) -> Iterator[Documents]:
    one = Documents(opened(Opening(input=str(stage))), opened_in_window)
    one.session.wait()
    yield one
    one.close(is_wanted=True)


def finished(documents: Documents) -> str:
    """Return what is said once all has been written."""
    end = time.monotonic() + WAIT_S
    while documents.is_busy and time.monotonic() < end:
        documents.update()
        time.sleep(0.01)
    assert not documents.is_busy
    return documents.state.message


def test_a_second_save_hides_neither_failure_nor_success_of_the_first(
    documents: Documents, tmp_path: Path
) -> None:
    documents.state.toggle_mute(0)
    documents.save(Request.SAVE_EDITS, tmp_path / "nowhere" / "edits.usda")
    documents.save(Request.SAVE_PICTURE, tmp_path / "picture.png", PIXELS)
    said = finished(documents)
    assert "nowhere" in said
    assert said.endswith(" Saved picture.png.")
    assert documents.state.history.is_unsaved
    documents.save(Request.SAVE_EDITS, tmp_path / "edits.usda")
    documents.save(Request.SAVE_PICTURE, tmp_path / "picture.png", PIXELS)
    assert finished(documents) == "Saved edits.usda. Saved picture.png."
    assert not documents.state.history.is_unsaved


def test_a_picture_replaces_nothing_that_is_shown(documents: Documents, tmp_path: Path) -> None:
    sky = tmp_path / "sky.png"
    sky.write_bytes(b"the only one")
    documents.state.compare_with(open_reference(str(sky)))
    documents.save(Request.SAVE_PICTURE, sky, PIXELS)
    assert "sky.png: would replace an image that is shown;" in finished(documents)
    assert sky.read_bytes() == b"the only one"
    documents.save(Request.SAVE_PICTURE, tmp_path / "other.png", PIXELS)
    assert finished(documents) == "Saved other.png."


@pytest.mark.parametrize("name", ["sky.exr", "shot.usda", "picture"])
def test_a_picture_is_saved_as_png_alone(documents: Documents, tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_bytes(b"the only one")
    documents.save(Request.SAVE_PICTURE, file, PIXELS)
    assert f"{name}: not a PNG file; expected a name ending in .png." in finished(documents)
    assert file.read_bytes() == b"the only one"


def test_a_save_that_ends_after_another_stage_was_opened_is_not_of_that_one(
    documents: Documents, stage: Path, tmp_path: Path
) -> None:
    documents.state.toggle_mute(0)
    documents.save(Request.SAVE_EDITS, tmp_path / "edits.usda")
    documents.open(str(stage))
    assert documents.question is not None
    dict(documents.question.answers)["Discard them"]()
    documents.question = None
    assert finished(documents).endswith("Saved edits.usda.")
    assert not documents.state.history.is_unsaved


def test_of_a_stage_with_keys_the_fitted_lobes_are_b(documents: Documents, tmp_path: Path) -> None:
    sky = with_lamps(64, Rectangle(20, 30, 15, 20, 9))
    for frame in FRAMES[:2]:
        write_exr(tmp_path / f"sky.{frame}.exr", sky, half=False)
    write(tmp_path, frames=FRAMES[:2], count=1)
    keyed = tmp_path / "shot.usda"
    documents.open_against(str(keyed))
    assert documents.state.message == "B is shot.usda."
    against = documents.state.against
    assert against is not None
    wanted = read_usd(keyed)
    assert against.tracks.names == wanted.names
    assert torch.equal(against.tracks.lobes.amplitude, wanted.lobes.amplitude)


def test_a_stage_that_is_not_written_yet_cannot_be_b(documents: Documents, tmp_path: Path) -> None:
    state = ViewerState(no_lobes((1001, 1002), 24.0))
    late = Session(state, FixedSource(state.tracks), "late.usda", tmp_path / "late.usda")
    documents = Documents(documents.session, lambda _: late)
    documents.open_against("late.usda")
    assert documents.state.against is None
    assert documents.state.message == (
        "late.usda: is not written yet; expected a stage with lobes to be B. Wait for the fit "
        "to end."
    )
