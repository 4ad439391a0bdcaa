# SPDX-License-Identifier: Apache-2.0
"""Documents without a window: saves that overlap, and stages that are held against one another."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from asglight.cli.sources.opening import Request as Opening
from asglight.cli.sources.opening import opened, opened_in_window
from asglight.viewer.io.documents import Documents
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
