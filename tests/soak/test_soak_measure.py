# SPDX-License-Identifier: Apache-2.0
"""The whole soak tells what each of its parts took; every command tells that something is wrong."""

import sys
from collections import Counter
from pathlib import Path

import pytest

from benchmarks.results.blocks import blocks
from soak import faults, fuzz, measure, scale
from soak.batch import Outcome
from soak.faults import Told
from soak.fuzz import Found
from soak.measure import Parts
from tests.support.old_files import old_files
from tests.support.places import ROOT


def test_a_part_is_told_of_when_it_ends(capsys: pytest.CaptureFixture[str]) -> None:
    parts = Parts()
    assert parts.done("Faults", lambda: sum(range(1000))) == 499_500
    assert capsys.readouterr().err == "Faults: 0 s, 0 s of processor time.\n"
    (took,) = parts.took
    assert took.part == "Faults"
    assert 0 <= took.cpu_seconds <= took.seconds + 0.02  # two ticks of the processor's clock


@pytest.mark.parametrize("command", [fuzz, faults, measure])
@pytest.mark.parametrize("is_bad", [False, True])
def test_a_command_tells_by_its_exit_status_whether_something_is_wrong(
    command: object, is_bad: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = Outcome.CRASH if is_bad else Outcome.READ
    found = [Found("HDR", 1, 1, Counter({outcome: 1}))]
    told = [Told("full disk", 1, wrong=["full disk: left half a stage"] if is_bad else [])]
    monkeypatch.setattr(fuzz, "fuzz_all", lambda *_, **__: found)
    monkeypatch.setattr(faults, "faults", lambda *_: told)
    monkeypatch.setattr(scale, "scale", lambda *_: [])
    monkeypatch.setattr(sys, "argv", ["soak", "-o", str(tmp_path)])
    linked = old_files(tmp_path, "soak.md", "soak.json", "faults.json")
    assert command.main() == int(is_bad)
    assert [kept.read_text() for kept in linked] == ["old"] * 3


def test_what_was_found_is_written_though_scale_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> list[scale.Measured]:
        raise RuntimeError("a 16k image: ended with 1")

    monkeypatch.setattr(fuzz, "fuzz_all", lambda *_, **__: [Found("HDR")])
    monkeypatch.setattr(faults, "faults", lambda *_: [Told("full disk", 7)])
    monkeypatch.setattr(scale, "scale", fail)
    monkeypatch.setattr(sys, "argv", ["soak", "-o", str(tmp_path)])
    assert measure.main() == 1
    assert "| full disk | 7 |" in (tmp_path / "soak.md").read_text()
    assert "wrong: a 16k image: ended with 1\n" in capsys.readouterr().err


def test_tables_of_the_page_have_the_columns_that_are_printed() -> None:
    page = (ROOT / "docs" / "results" / "soak.md").read_text()
    shown = [block.content.partition("\n")[0] for block in blocks(page)]
    printed = (fuzz.as_table([]), faults.as_table([]), scale.as_table([]))
    assert shown == [table.partition("\n")[0] for table in printed]
