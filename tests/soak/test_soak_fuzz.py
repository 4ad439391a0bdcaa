# SPDX-License-Identifier: Apache-2.0
"""The fuzzer in short: what it counts is counted rightly, and some files of every kind."""

import os
import random
import signal
import time
from collections import Counter
from pathlib import Path

import pytest

from asglight.errors import InputError
from asglight.shots.kept.records import parse_line
from soak import batch
from soak import fuzz as fuzzing
from soak.batch import Outcome, run_batch
from soak.fuzz import as_table, fuzz, fuzz_all
from soak.mutation import FIELDS, mutated, signed
from soak.readers import READERS, Reader
from soak.seeds import CORPUS, write_corpus

MANY, FEW = 30, 12
"""Files of a kind: few of those of which `make soak` has few, which take 0.1 s each."""


def reader(read: object, **changes: object) -> Reader:
    return Reader("test", ".hdr", read, 1, **changes)


def outcome_of(read: object, **changes: object) -> batch.Result:
    (result,) = run_batch(reader(read, **changes), [b"#?RADIANCE\n"], set())
    return result


def after_the_first(act: object) -> object:
    """Return a reader that stands the sound file that is read first, and then acts."""
    seen = []

    def read(path: Path) -> None:
        seen.append(path)
        if len(seen) > 1:
            act(path)

    return read


def refuse(path: Path) -> None:
    raise InputError(f"{path.name}: is bad; expected good.")


def test_what_ends_a_reader_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    assert outcome_of(after_the_first(lambda path: None)).outcome == Outcome.READ
    assert outcome_of(after_the_first(refuse)).outcome == Outcome.REFUSED

    def unnamed(path: Path) -> None:
        raise InputError("is bad")

    def two_lines(path: Path) -> None:
        raise InputError(f"{path.name}: is\nbad; expected good.")

    for act in (unnamed, two_lines, lambda path: 1 / 0):
        assert outcome_of(after_the_first(act)).outcome == Outcome.BUG

    def segfault(path: Path) -> None:
        os.kill(os.getpid(), signal.SIGSEGV)

    result = outcome_of(after_the_first(segfault))
    assert (result.outcome, result.fault) == (Outcome.CRASH, "SIGSEGV")
    result = outcome_of(after_the_first(segfault), apart=after_the_first(refuse))
    assert result.outcome == Outcome.CONTAINED
    with monkeypatch.context() as patch:
        patch.setattr(batch, "SECONDS_MAX", 1)
        assert outcome_of(after_the_first(lambda path: time.sleep(60))).outcome == Outcome.HANG

    def greedy(path: Path) -> None:
        bytearray(os.urandom(4096) * (batch.FREE // 2048))

    assert outcome_of(after_the_first(greedy)).outcome == Outcome.MEMORY


def test_a_file_after_one_that_crashes_is_read() -> None:
    def read(path: Path) -> None:
        if path.read_bytes() == b"crash":
            os.kill(os.getpid(), signal.SIGABRT)

    results = run_batch(reader(read), [b"one", b"crash", b"two"], set())
    assert [one.outcome for one in results] == [Outcome.READ, Outcome.CRASH, Outcome.READ]


def test_a_new_step_from_line_to_line_is_noticed() -> None:
    (one,) = [one for one in READERS if one.suffix == ".json"]
    sound = (CORPUS / "tracks.json").read_bytes()
    seen: set[tuple[str, int, int]] = set()
    first, again = run_batch(one, [sound, sound], seen)
    assert first.is_new
    assert not again.is_new
    (other,) = run_batch(one, [sound.replace(b'"version":1', b'"version":9')], seen)
    (other_again,) = run_batch(one, [sound.replace(b'"version": 1', b'"version": 9')], seen)
    assert other.is_new != other_again.is_new  # whichever way the file is written


def test_damage_is_the_same_for_the_same_seed_and_differs_from_the_file() -> None:
    data = (CORPUS / "zip.exr").read_bytes()
    results = [mutated(data, [data], ".exr", random.Random(seed)) for seed in (1, 1, *range(2, 40))]
    assert results[0] == results[1]
    assert len(set(results)) > 30
    assert sum(one != data for one in results) > 35


def test_a_damaged_checkpoint_is_signed_anew() -> None:
    lines = (CORPUS / "shot.checkpoint").read_bytes()
    damaged = lines.replace(b'"frame":2', b'"frame":7')
    assert [parse_line(line) is None for line in damaged.splitlines(True)] == [0, 0, 1, 0]
    assert all(parse_line(line) for line in signed(damaged).splitlines(True))


def test_the_corpus_is_small_and_made_by_its_script(tmp_path: Path) -> None:
    write_corpus(tmp_path / "corpus")
    names = {str(path.relative_to(CORPUS)) for path in CORPUS.rglob("*") if path.is_file()}
    made = {
        str(path.relative_to(tmp_path / "corpus"))
        for path in (tmp_path / "corpus").rglob("*")
        if path.is_file()
    }
    assert names == made
    assert sum((CORPUS / name).stat().st_size for name in names) < 200_000
    assert {one.suffix for one in READERS} == FIELDS.keys()
    assert sum(one.share for one in READERS) == 1000


@pytest.mark.parametrize("name", [one.name for one in READERS])
def test_damaged_files_are_read_or_refused_in_one_line(name: str, tmp_path: Path) -> None:
    (one,) = [one for one in READERS if one.name == name]
    count = MANY if one.share >= 50 else FEW
    found = fuzz(one, count, 20261122, tmp_path / "kept", time.monotonic() + 300)
    assert found.files == count
    assert found.wrong() == [], found.faults
    assert found.edges > 30


def test_a_few_files_of_each_kind_of_fault_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds = [batch.Result(Outcome.BUG, f"Error at {place}") for place in ("a.py:1", "b.py:2")]
    monkeypatch.setattr(fuzzing, "run_batch", lambda one, files, seen: 6 * kinds)
    for seed in (0, 1):  # two jobs of one reader
        found = fuzz(reader(None), 12, seed, tmp_path / "kept", time.monotonic() + 300)
        assert set(found.faults.values()) == {6}
    kept = [path.read_bytes() for path in (tmp_path / "kept").glob("test-another-error-*.hdr")]
    assert len(kept) == 2 * 2 * fuzzing.KEPT_MAX


def test_files_for_which_there_was_no_time_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzzing, "run_batch", lambda *_: [])
    found = fuzz_all(2000, 0, tmp_path, 0.0, jobs=2)
    assert [one.files for one in found] == [0] * len(READERS)
    assert found[0].wrong() == ["OpenEXR: 0 of 720 files before time was up"]


def test_what_becomes_of_a_file_is_good_or_wrong() -> None:
    for outcome in Outcome:
        one = fuzzing.Found("HDR", 3, 3, Counter({outcome: 3}))
        good = outcome in (Outcome.READ, Outcome.REFUSED, Outcome.CONTAINED)
        assert one.wrong() == ([] if good else [f"HDR: 3 x {outcome}"])


def test_the_counts_of_all_readers_are_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzzing, "run_batch", lambda *_: [])  # nor are sound files read
    few = fuzz_all(0, 0, tmp_path, 1.0, jobs=1)
    assert [one.reader for one in few] == [one.name for one in READERS]
    table = as_table(few).splitlines()
    assert len(table) == 2 + len(READERS)
    assert len({line.count("|") for line in table}) == 1
