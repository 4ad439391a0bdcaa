# SPDX-License-Identifier: Apache-2.0
"""The faults in short: once or a few times each, and the checks that find what is wrong."""

import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from asglight.shots.kept import checkpoint
from soak import faults, shot
from soak.faults import Bench, Told


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(faults, "FRAMES", 3)
        yield faults.prepared(tmp_path_factory.mktemp("faults") / "bench", seed=3)


def test_killed_at_random_moments_and_resumed(bench: Bench) -> None:
    told = faults.signals(bench, signal.SIGKILL, 2)
    assert told.wrong == []
    assert told.times == 2
    assert told.outcomes["resumed to the same bytes"] >= 1


def test_interrupted_and_resumed(bench: Bench) -> None:
    told = faults.signals(bench, signal.SIGINT, 1)
    assert (told.wrong, told.times) == ([], 1)


@pytest.mark.parametrize("name", ["disk", "read-only", "vanished", "replaced", "two"])
def test_a_fault_is_resumed_or_refused(bench: Bench, name: str) -> None:
    told = faults.FAULTS[name](bench, 1)
    if told.skipped:
        pytest.skip(told.skipped)
    assert (told.wrong, told.times) == ([], 1)
    assert told.outcomes


def test_two_runs_that_nothing_keeps_apart_are_found(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint.fcntl, "flock", lambda *_: None)
    told = faults.two_runs(replace(bench, seconds=0.0), 1)  # held as soon as it has begun
    assert told.wrong[:1] == ["two runs on one output: ended with 0 and []"]
    assert "one after the other" not in told.outcomes


def test_a_wrong_file_a_damaged_checkpoint_and_a_traceback_are_found(
    bench: Bench, tmp_path: Path
) -> None:
    told = Told("test")
    (tmp_path / "shot.usda").write_text("half a stage")
    (tmp_path / "shot.usda.checkpoint").write_text("no line\nno line\n")
    faults._check_left(bench, tmp_path, told)
    assert len(told.wrong) == 2
    faults._check_whole(bench, tmp_path, told, 0)
    faults._check_whole(bench, tmp_path, told, 1)
    assert len(told.wrong) == 4
    run = shot.Run(tmp_path / "nowhere" / "in", tmp_path / "shot.usda")
    assert run.wait() == 1  # its log has no folder: not one line
    run.log.parent.mkdir()
    run.log.write_text("Traceback\nasglight: this is a bug.\n")
    faults._check_line(told, run, 2, 2)
    assert len(told.wrong) == 5
    assert faults.as_table([told]).endswith("| test | 0 |  | 5 |")
