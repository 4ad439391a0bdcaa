# SPDX-License-Identifier: Apache-2.0
"""What happens to a fit on a farm, at random moments, and what is left behind.

    python -m soak.faults --kills 50 -o soak-output

Every run is of the same tiny shot (shot.py). Whatever is done to one, what it leaves has to be a
part of what an unbroken run leaves, and the run that resumes it has to leave the same bytes; or the
run is refused in one line, and leaves nothing wrong.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from asglight.cli.folders import write_text
from asglight.images import write_exr
from asglight.shots.kept.records import parse_line
from soak.shot import FRAMES, Run, files, new_folder, results, sky, write_shot

REFUSED, INTERRUPTED = 2, 130
"""Exit statuses of asglight."""


@dataclass
class Bench:
    """What the faults need.

    Attributes:
        folder: Where everything happens.
        source: The images.
        whole: The files of an unbroken run.
        seconds: How long that took.
        rng: Chooses moments.
    """

    folder: Path
    source: Path
    whole: dict[str, bytes]
    seconds: float
    rng: random.Random


@dataclass
class Told:
    """What came of one kind of fault.

    Attributes:
        fault: Its name.
        times: How often it was done.
        outcomes: What came of it, in words, with how often.
        wrong: What is not as it has to be, one line each; empty is good.
        skipped: Why it was not done, where it was not.
    """

    fault: str
    times: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    skipped: str = ""


def prepared(folder: Path, seed: int) -> Bench:
    """Write the images and fit them once without a fault."""
    shutil.rmtree(folder, ignore_errors=True)
    source = write_shot(folder / "in", range(1, FRAMES + 1))
    with new_folder(folder / "whole") as output:
        begin = time.monotonic()
        run = Run(source, output / "shot.usda")
        assert run.wait() == 0, run.log.read_text()
        return Bench(folder, source, files(output), time.monotonic() - begin, random.Random(seed))


def _fit(bench: Bench, output: Path, *options: str) -> Run:
    return Run(bench.source, output / "shot.usda", *options)


def _check_left(bench: Bench, output: Path, told: Told) -> None:
    """Check that what a broken run left is whole, as far as it goes."""
    for name, data in results(output).items():
        if bench.whole.get(name) != data:
            told.wrong.append(f"{told.fault}: left {name}, which is not that of an unbroken run")
    checkpoint = output / "shot.usda.checkpoint"
    if checkpoint.exists():
        lines = checkpoint.read_bytes().splitlines(keepends=True)
        if any(parse_line(line) is None for line in lines[:-1]):
            told.wrong.append(f"{told.fault}: left a checkpoint with a damaged line")


def _check_whole(bench: Bench, output: Path, told: Told, status: int) -> None:
    """Check that a resumed run ended well and left the bytes of an unbroken one."""
    if status != 0:
        told.wrong.append(f"{told.fault}: resumed, and ended with {status}")
    elif files(output) != bench.whole:
        told.wrong.append(f"{told.fault}: the resumed run's files differ from an unbroken one's")
    else:
        told.outcomes["resumed to the same bytes"] += 1


def _check_line(told: Told, run: Run, status: int, wanted: int) -> None:
    """Check that a run ended with a status and one line."""
    lines = run.errors()
    if status != wanted or len(lines) != 1 or not lines[0].startswith("asglight: "):
        told.wrong.append(f"{told.fault}: ended with {status} and {lines}")
    else:
        told.outcomes["one line"] += 1


def signals(bench: Bench, number: signal.Signals, times: int) -> Told:
    """Send a signal at random moments, to resumed runs too, until one comes to its end."""
    told = Told(f"{number.name} at a random moment")
    while told.times < times:
        with new_folder(bench.folder / "broken") as output:
            while True:
                run, delay = _fit(bench, output), bench.rng.uniform(0, bench.seconds)
                end = time.monotonic() + delay
                while not run.poll() and time.monotonic() < end:
                    time.sleep(0.001)
                if run.poll() or told.times == times:
                    break
                run.send(number)
                status = run.wait()
                told.times += 1
                if number is signal.SIGINT and status != 0:
                    _check_line(told, run, status, INTERRUPTED)
                _check_left(bench, output, told)
            _check_whole(bench, output, told, run.wait())
    return told


def full_disk(bench: Bench, times: int) -> Told:
    """Fit onto disks of which each is full at another moment, then make room."""
    told = Told("full disk")
    with _small_disk(bench.folder / "disk", told) as disk:
        for _ in range(times if disk else 0):
            assert disk is not None
            kilobytes = bench.rng.randrange(4, 40, 4)  # the shot takes more, frames less
            _resize(disk, kilobytes)
            output = disk / "out"
            output.mkdir()
            run = _fit(bench, output)
            told.times += 1
            status = run.wait()
            if status == 0:
                told.outcomes["had room"] += 1
            else:
                _check_line(told, run, status, REFUSED)
            _check_left(bench, output, told)
            _resize(disk, 16 * 1024)
            again = _fit(bench, output)
            _check_whole(bench, output, told, again.wait())
            shutil.rmtree(output)
    return told


def read_only(bench: Bench, times: int) -> Told:
    """Fit into a folder that cannot be written, also one with a checkpoint in it."""
    told = Told("read-only folder")
    with _small_disk(bench.folder / "disk", told) as disk:
        for _ in range(times if disk else 0):
            assert disk is not None
            _resize(disk, 16 * 1024)
            (output := disk / "out").mkdir()
            run = _fit(bench, output)
            time.sleep(bench.rng.uniform(0, bench.seconds / 2))
            run.send(signal.SIGKILL)
            run.wait()
            before = files(output)
            subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
            run = _fit(bench, output)
            told.times += 1
            _check_line(told, run, run.wait(), REFUSED)
            if files(output) != before:
                told.wrong.append("read-only folder: changed")
            subprocess.run(["mount", "-o", "remount,rw", disk], check=True)
            again = _fit(bench, output)
            _check_whole(bench, output, told, again.wait())
            shutil.rmtree(output)
    return told


@contextmanager
def _small_disk(place: Path, told: Told) -> Iterator[Path | None]:
    """Give a file system of its own, in memory; say why not where there is none to be had."""
    place.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode != 0:
        told.skipped = "needs a user who may mount a file system"
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _resize(disk: Path, kilobytes: int) -> None:
    subprocess.run(["mount", "-o", f"remount,size={kilobytes}k", str(disk)], check=True)


def vanished(bench: Bench, times: int) -> Told:
    """Take a frame away while the shot is fitted, and put it back."""
    told = Told("frame vanished")
    for _ in range(times):
        frame = bench.rng.randrange(FRAMES // 2, FRAMES + 1)
        path = bench.source / f"sky.{frame:04d}.exr"
        aside = bench.folder / "aside.exr"
        with new_folder(bench.folder / "broken") as output:
            run = _fit(bench, output)
            time.sleep(bench.rng.uniform(0, bench.seconds / 2))
            path.rename(aside)
            told.times += 1
            status = run.wait()
            aside.rename(path)
            if status == 0:
                told.outcomes["was read before"] += 1
            else:
                _check_line(told, run, status, REFUSED)
                if not re.search(rf"\b0*{frame}\b", "".join(run.errors())):
                    told.wrong.append("frame vanished: not named")
            _check_left(bench, output, told)
            again = _fit(bench, output)
            _check_whole(bench, output, told, again.wait())
    return told


def replaced(bench: Bench, times: int) -> Told:
    """Write a frame anew, in pieces, while it is read: the old one or the new one, never both."""
    told = Told("frame replaced while it is read")
    frame = FRAMES // 2
    source = write_shot(bench.folder / "moving", range(1, FRAMES + 1))
    path = source / f"sky.{frame:04d}.exr"
    old = path.read_bytes()
    write_exr(path, sky(frame + 5))
    new = path.read_bytes()
    wholes = []
    for data in (old, new):
        path.write_bytes(data)
        with new_folder(bench.folder / "one") as output:
            assert Run(source, output / "shot.usda").wait() == 0
            wholes.append(files(output))
    for _ in range(times):
        path.write_bytes(old)
        with new_folder(bench.folder / "broken") as output:
            run = Run(source, output / "shot.usda")
            _rewrite_until_read(path, (old, new), run, bench.rng)
            told.times += 1
            status = run.wait()
            if status == 0:
                told.outcomes["one of the two images"] += 1
                if files(output) not in wholes:
                    told.wrong.append("frame replaced: the result is that of neither image")
            else:
                _check_line(told, run, status, REFUSED)
    return told


def _rewrite_until_read(
    path: Path, contents: tuple[bytes, bytes], run: Run, rng: random.Random
) -> None:
    """Write a file in place, half of it at a time, for a while from when the run has begun."""
    checkpoint = run.stage.with_name("shot.usda.checkpoint")
    while not run.poll() and not checkpoint.exists():
        time.sleep(0.001)
    end = time.monotonic() + rng.uniform(0.1, 1.0)
    while not run.poll() and time.monotonic() < end:
        for data in contents:
            with path.open("r+b") as stream:
                stream.write(data[: len(data) // 2])
                stream.flush()
                time.sleep(rng.uniform(0, 0.004))
                stream.write(data[len(data) // 2 :])
                stream.truncate()
    with path.open("r+b") as stream:
        stream.write(contents[0])
        stream.truncate()


def two_runs(bench: Bench, times: int) -> Told:
    """Start a second run on the output of one that is held in the middle.

    Held, because both leave the same bytes: a second that ended well would say nothing.
    """
    told = Told("two runs on one output")
    for _ in range(times):
        with new_folder(bench.folder / "broken") as output:
            first = _fit(bench, output)
            while not first.poll() and not (output / "shot.usda.checkpoint").exists():
                time.sleep(0.001)
            time.sleep(bench.rng.uniform(0, bench.seconds / 2))
            is_busy = first.hold() and not (output / "shot.usda").exists()
            second = Run(bench.source, output / "shot.usda")
            told.times += 1
            try:
                status = second.wait()
            finally:
                first.send(signal.SIGCONT)
            ended = first.wait()
            if status == 0 and not is_busy:  # the first had written all
                told.outcomes["one after the other"] += 1
            else:
                _check_line(told, second, status, REFUSED)
            if ended != 0 or files(output) != bench.whole:
                told.wrong.append(f"two runs: the first ended with {ended}, or its files differ")
    return told


FAULTS: dict[str, Callable[[Bench, int], Told]] = {
    "kill": lambda bench, times: signals(bench, signal.SIGKILL, times),
    "interrupt": lambda bench, times: signals(bench, signal.SIGINT, times),
    "disk": full_disk,
    "read-only": read_only,
    "vanished": vanished,
    "replaced": replaced,
    "two": two_runs,
}


def faults(folder: Path, kills: int, others: int, seed: int = 0) -> list[Told]:
    """Do every fault: the first so often, the others so often."""
    bench = prepared(folder.resolve(), seed)
    told = []
    for name, fault in FAULTS.items():
        told.append(fault(bench, kills if name == "kill" else others))
        print(f"faults: {name} done", file=sys.stderr, flush=True)
    shutil.rmtree(folder)
    return told


def as_table(told: list[Told]) -> str:
    """Return the counts as a table."""
    lines = ["| fault | times | what came of it | wrong |", "|---|---|---|---|"]
    for one in told:
        words = "; ".join(f"{count} x {name}" for name, count in one.outcomes.items())
        words = f"skipped: {one.skipped}" if one.skipped else words
        lines.append(f"| {one.fault} | {one.times} | {words} | {len(one.wrong)} |")
    return "\n".join(lines)


def main() -> int:
    """Do every fault, print the counts, and tell by the exit status whether something is wrong."""
    parser = argparse.ArgumentParser(description="Do faults to a fit at random moments.")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--others", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path("soak-output"))
    arguments = parser.parse_args()
    told = faults(arguments.output / "faults", arguments.kills, arguments.others, arguments.seed)
    write_text(arguments.output / "faults.json", json.dumps([vars(one) for one in told]))
    print(as_table(told))
    wrong = [line for one in told for line in one.wrong]
    for line in wrong:
        print(f"wrong: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
