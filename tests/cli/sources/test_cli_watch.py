# SPDX-License-Identifier: Apache-2.0
"""A running `asglight fit` in the viewer: the thread that watches it."""

import threading
from collections.abc import Iterator
from pathlib import Path

import processes
import pytest
import shot_files
import torch

from asglight.cli.sources import watch_source
from asglight.cli.sources.opening import Request, opened
from asglight.errors import InputError
from asglight.lobes import LobeTracks
from asglight.lobes.data import stack
from asglight.shots.kept.checkpoint import SUFFIX, Checkpoint, header_of
from asglight.usd import read_usd, write_usd
from asglight.viewer.state.session import Session

FRAMES = (1001, 1002, 1003)

HEADER = header_of(
    {"source": "/in/sky.####.exr", "frames": list(FRAMES), "fps": 25.0, "form": "asg"}
    | {"preset": "fast"}
)


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    return tmp_path / "shot.usda"


@pytest.fixture
def running(stage: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Checkpoint]:
    """Return the checkpoint of a fit that has finished its first frame."""
    monkeypatch.setattr(watch_source, "INTERVAL_SECONDS", 0.01)
    with Checkpoint(stage.with_name(stage.name + SUFFIX), HEADER, resume=False) as checkpoint:
        checkpoint.append(shot_files.record(1001))
        yield checkpoint


def lit_frames(session: Session) -> list[bool]:
    return (session.state.tracks.lobes.amplitude > 0).flatten(1).any(1).tolist()


def threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == "asglight-watch"]


def test_a_stage_that_is_being_fitted_is_watched_until_it_is_written(
    stage: Path, running: Checkpoint
) -> None:
    session = opened(Request(str(stage)))
    status = session.update()
    assert session.state.tracks.frames == FRAMES
    assert lit_frames(session) == [True, False, False]
    assert (status.frames_done, status.frames_total) == (1, 3)
    assert (status.message, status.is_finished) == ("watching the fit of shot.usda", False)
    running.append(shot_files.record(1002))
    processes.wait_until(lambda: session.update().frames_done == 2)
    assert lit_frames(session) == [True, True, False]
    assert session.state.tracks.fps == 25.0
    written = LobeTracks(FRAMES, 25.0, stack([shot_files.lobes(frame + 5) for frame in FRAMES]))
    write_usd(written, stage)
    processes.wait_until(lambda: session.update().is_finished)
    status = session.update()
    assert (status.message, status.failure) == ("shot.usda is written", None)
    assert torch.equal(session.state.tracks.lobes.axes, read_usd(stage).lobes.axes)
    session.close()
    assert threads() == []


def test_closing_ends_the_thread_and_not_the_fit(stage: Path, running: Checkpoint) -> None:
    session = opened(Request(str(stage)))
    assert threads() == ["asglight-watch"]
    session.close()
    session.close()
    assert threads() == []
    running.append(shot_files.record(1002))


def test_a_checkpoint_that_breaks_is_a_failure_that_keeps_its_frames(
    stage: Path, running: Checkpoint
) -> None:
    session = opened(Request(str(stage)))
    running.append(shot_files.record(1002, lobes=shot_files.lobes(count=5)))
    processes.wait_until(lambda: session.update().is_finished)
    status = session.update()
    assert status.failure is not None
    assert "shot.usda.checkpoint: a line is no frame of this asglight" in status.failure
    assert status.frames_done == 1
    assert lit_frames(session) == [True, False, False]
    session.close()


def test_more_lobes_than_the_viewer_holds_are_refused(stage: Path) -> None:
    with Checkpoint(stage.with_name(stage.name + SUFFIX), HEADER, resume=False) as checkpoint:
        checkpoint.append(shot_files.record(1001, lobes=shot_files.lobes(count=129)))
        with pytest.raises(InputError, match=r"^shot\.usda: has 129 lobes; expected at most 128"):
            opened(Request(str(stage)))
    assert threads() == []


def test_a_checkpoint_without_a_frame_is_told(stage: Path) -> None:
    stage.with_name(stage.name + SUFFIX).write_bytes(b'{"record":{"form')
    with pytest.raises(InputError, match=r"shot\.usda: is not written yet, and its checkpoint"):
        opened(Request(str(stage)))
    assert threads() == []
