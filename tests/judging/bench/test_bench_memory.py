# SPDX-License-Identifier: Apache-2.0
"""Peak memory: what a part of a run took, whatever was there before."""

import sys
from pathlib import Path

import numpy as np
import pytest

from asglight.judging.bench import memory

SIZE = 40_000_000
"""Bytes: far above what the interpreter takes on the way."""

SLACK = 4_000_000
"""Bytes of pages that are whole and of what the interpreter takes."""

linux = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")


@linux
@pytest.mark.parametrize("pieces", [1, 10_000], ids=["a block", "pieces"])
def test_what_is_taken_and_given_back_counts_again(pieces: int) -> None:
    for _ in range(2):  # what the first time gave back must not hide the second
        with memory.peak_memory() as peak:
            kept = [np.ones(SIZE // pieces, dtype=np.uint8) for _ in range(pieces)]
            del kept
        assert peak.grown == pytest.approx(SIZE, abs=SLACK)


@linux
def test_what_was_there_before_does_not_count() -> None:
    before = np.ones(SIZE, dtype=np.uint8)
    with memory.peak_memory() as peak:
        pass
    assert before.sum() == SIZE
    assert peak.grown is not None
    assert peak.grown < SLACK


def test_a_system_that_does_not_tell_has_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "_RESET", tmp_path / "none" / "clear_refs")
    with memory.peak_memory() as peak:
        pass
    assert peak.grown is None
