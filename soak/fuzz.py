# SPDX-License-Identifier: Apache-2.0
"""Damaged files, read one after the other: what each reader makes of them, as counts.

    python -m soak.fuzz --files 100000 -o soak-output

The fuzzer is guided by coverage: it notes which steps from line to line asglight's own readers take
on a file, and a damaged file that makes them take a new one joins the seeds. Native libraries are
not instrumented; what leads into them is.

A batch of files is read by a forked process with a limit on memory and time, so that whatever a
file does is told from the outside. What ends an image's reader is read once more as the product
reads it, apart (asglight/images/decoding/apart.py).
"""

import argparse
import json
import os
import random
import signal
import sys
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from soak.batch import BATCH, Outcome, run_batch
from soak.mutation import mutated
from soak.readers import READERS, Reader
from soak.seeds import CORPUS

KEPT_MAX = 5
"""Files of each kind of fault that are kept to be looked at."""

POOL_MAX = 2000
"""Seeds and what joined them."""

GOOD = (Outcome.READ, Outcome.REFUSED, Outcome.CONTAINED)
"""What may become of a damaged file."""

RECENT = 50
"""Of the pool, how many count as recent."""


@dataclass
class Found:
    """What a reader made of the files.

    Attributes:
        reader: Its name.
        asked: How many files it was to read.
        files: How many there were.
        outcomes: How many were read, refused in one line, and so on (soak.batch.Outcome).
        faults: What went wrong, in words, with how often.
        edges: Steps from line to line that were taken.
        joined: Files that took a new one.
        growth: Largest growth of the reader's memory by a file, in bytes.
        seconds: Time it took.
    """

    reader: str
    asked: int = 0
    files: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    edges: int = 0
    joined: int = 0
    growth: int = 0
    seconds: float = 0.0

    def wrong(self) -> list[str]:
        """Return what should not be, one line each; empty is good."""
        lines = [
            f"{self.reader}: {count} x {name}"
            for name, count in self.outcomes.items()
            if count and name not in GOOD
        ]
        if self.files < self.asked:
            lines.append(f"{self.reader}: {self.files} of {self.asked} files before time was up")
        return lines


def fuzz(reader: Reader, count: int, seed: int, kept: Path, deadline: float) -> Found:
    """Read damaged files of one kind.

    Args:
        reader: What reads them.
        count: How many.
        seed: Of the damage.
        kept: Folder for files that a reader did not stand.
        deadline: Of `time.monotonic`; after it no batch begins.
    """
    rng = random.Random(f"{seed} {reader.name}")
    pool = [path.read_bytes() for path in sorted(CORPUS.glob(f"*{reader.suffix}"))]
    assert pool, reader
    seen: set[tuple[str, int, int]] = set()
    found, begin = Found(reader.name, count), time.monotonic()
    run_batch(reader, pool, seen)  # what the sound files reach is not new
    while found.files < count and time.monotonic() < deadline:
        # half of them from what reached something new
        size = min(BATCH, count - found.files)
        files = [
            mutated(
                rng.choice(pool if rng.random() < 0.5 else pool[-RECENT:]),
                pool,
                reader.suffix,
                rng,
            )
            for _ in range(size)
        ]
        results = run_batch(reader, files, seen)
        for data, result in zip(files, results, strict=False):
            found.files += 1
            found.outcomes[result.outcome] += 1
            found.growth = max(found.growth, result.growth)
            if result.fault:
                found.faults[result.fault] += 1
                if found.faults[result.fault] <= KEPT_MAX:
                    # seeds tell jobs of one reader apart, numbers their files
                    name = f"{reader.name} {result.outcome} {seed}-{found.files}"
                    _keep(kept, name, reader, data)
            if result.is_new and len(pool) < POOL_MAX:
                pool.append(data)
                found.joined += 1
    found.edges, found.seconds = len(seen), time.monotonic() - begin
    return found


def _keep(folder: Path, name: str, reader: Reader, data: bytes) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name.replace(' ', '-')}{reader.suffix}").write_bytes(data)


def fuzz_all(files: int, seed: int, output: Path, minutes: float, jobs: int) -> list[Found]:
    """Fuzz every reader, several at a time in processes of their own.

    Args:
        files: How many files over all readers.
        seed: Of the damage.
        output: Folder for the counts of each reader and for files that it did not stand.
        minutes: After which no batch begins.
        jobs: Readers at a time.
    """
    output.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + 60 * minutes
    waiting = [(reader, slot) for slot in range(jobs) for reader in READERS]
    running: dict[int, str] = {}
    places = []
    while waiting or running:
        if waiting and len(running) < jobs:
            reader, slot = waiting.pop(0)
            place = output / f"fuzz-{reader.suffix[1:]}-{slot}.json"
            places.append(place)
            pid = os.fork()
            if pid == 0:
                _job(reader, files * reader.share // 1000 // jobs, seed + slot, place, deadline)
            running[pid] = reader.name
            continue
        pid, status = os.wait()
        print(f"fuzz: {running.pop(pid, '?')} done", file=sys.stderr, flush=True)
        assert status == 0, (pid, status)
    return _merged([json.loads(place.read_text()) for place in places])


def _job(reader: Reader, count: int, seed: int, place: Path, deadline: float) -> None:
    """Fuzz one reader in this forked process, and end it."""
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        found = fuzz(reader, count, seed, place.parent / "kept", deadline)
        place.write_text(json.dumps(vars(found)))
        status = 0
    except Exception:
        traceback.print_exc()
    finally:
        os._exit(status)


def _merged(parts: list[dict]) -> list[Found]:
    result: dict[str, Found] = {}
    for part in parts:
        whole = result.setdefault(part["reader"], Found(part["reader"]))
        whole.asked += part["asked"]
        whole.files += part["files"]
        whole.outcomes.update(part["outcomes"])
        whole.faults.update(part["faults"])
        whole.edges = max(whole.edges, part["edges"])
        whole.joined += part["joined"]
        whole.growth = max(whole.growth, part["growth"])
        whole.seconds += part["seconds"]
    return list(result.values())


def as_table(found: list[Found]) -> str:
    """Return the counts as a table."""
    columns = list(Outcome)
    head = ["reader", "files", *columns, "steps", "joined", "MB at most", "ms a file"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for one in found:
        cells = [one.reader, f"{one.files:,}", *(f"{one.outcomes[name]:,}" for name in columns)]
        milliseconds = 1000 * one.seconds / max(one.files, 1)
        cells += [str(one.edges), str(one.joined), f"{one.growth / 2**20:.0f}"]
        lines.append("| " + " | ".join([*cells, f"{milliseconds:.1f}"]) + " |")
    return "\n".join(lines)


def main() -> int:
    """Fuzz, print the counts, and tell by the exit status whether something is wrong."""
    parser = argparse.ArgumentParser(description="Read damaged files, guided by coverage.")
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=Path("soak-output"))
    arguments = parser.parse_args()
    found = fuzz_all(
        arguments.files, arguments.seed, arguments.output, arguments.minutes, arguments.jobs
    )
    print(as_table(found))
    for one in found:
        for fault, count in one.faults.most_common(20):
            print(f"{one.reader}: {count} x {fault}")
    wrong = [line for one in found for line in one.wrong()]
    for line in wrong:
        print(f"wrong: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
