# SPDX-License-Identifier: Apache-2.0
"""Reading a batch of files in a forked process with limits, and telling what became of each."""

import contextlib
import faulthandler
import gc
import json
import os
import resource
import select
import signal
import sys
import tempfile
import traceback
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from types import FrameType
from typing import Any

from asglight.errors import InputError
from asglight.images.decoding import apart
from soak.readers import Read, Reader, declared_bytes
from soak.seeds import CORPUS

BATCH = 250
"""Files a process: a fork takes 20 ms, and what leaks is gone after so many."""

SECONDS_MAX = 40
"""For a file of some kB, which takes milliseconds; on a loaded machine a process apart takes
seconds to start. It gets half of this."""

FREE = 64 * 2**20
"""Bytes by which the memory may grow without a question: libraries' tables, pools of allocators. A
damaged binary stage of 4 kB took 52 MB, near what the process that tries layers out lets pass."""

MEMORY_FACTOR = 4
"""Times the size that a file declares which reading it may take."""

DATA_MAX = 2**30
"""Bytes that a process may have in all beyond what it begins with, so that a runaway ends it."""

READERS_OWN = ("asglight/images/", "asglight/usd/", "asglight/export/", "asglight/shots/")
"""Whose steps from line to line are noted."""


class Outcome(StrEnum):
    """What became of a file."""

    READ = "read"
    REFUSED = "refused in one line"
    CONTAINED = "ended a reader apart"
    BUG = "another error"
    CRASH = "crash"
    HANG = "hang"
    MEMORY = "too much memory"


@dataclass
class Result:
    """What became of one file.

    Attributes:
        outcome: In a word.
        fault: What went wrong, if anything.
        is_new: It took a step from line to line that none before took.
        growth: By how much the largest size of the process grew, in bytes.
    """

    outcome: str
    fault: str = ""
    is_new: bool = False
    growth: int = 0


def run_batch(reader: Reader, files: list[bytes], seen: set[tuple[str, int, int]]) -> list[Result]:
    """Read files, and go on after one that ends the process.

    Args:
        reader: What reads them.
        files: Their contents.
        seen: Steps taken so far; those that are new are added.
    """
    results: list[Result] = []
    while len(results) < len(files):
        rest = files[len(results) :]
        done, status = _forked(reader, reader.read, rest, seen)
        results += done
        if len(done) == len(rest):
            break
        data = rest[len(done)]
        ended = Outcome.HANG if status == signal.SIGALRM else Outcome.CRASH
        result = Result(ended, _ending(status))
        if reader.apart is not None:
            again, status = _forked(reader, reader.apart, [data], set())
            if again and again[0].outcome == Outcome.REFUSED:
                result = Result(Outcome.CONTAINED, f"{_ending(status)} {result.fault}".strip())
        results.append(result)
    return results


def _ending(status: int) -> str:
    return signal.Signals(status).name if status else "the process ended"


def _forked(
    reader: Reader, read: Read, files: list[bytes], seen: set[tuple[str, int, int]]
) -> tuple[list[Result], int]:
    """Read files in a fork until one ends it; return what it told, and the signal that did."""
    here, there = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        os.close(here)
        _child(reader, read, files, seen, there)
    os.close(there)
    lines, is_late = _told(here)
    if is_late:
        os.kill(pid, signal.SIGKILL)
    status = os.waitpid(pid, 0)[1]
    results = []
    for line in lines:
        values = json.loads(line)
        new = {(name, first, second) for name, first, second in values.pop("edges")}
        values["is_new"] = bool(new - seen)
        seen |= new
        results.append(Result(**values))
    return results, (signal.SIGALRM if is_late else status & 127)


def _told(pipe: int) -> tuple[list[bytes], bool]:
    """Collect lines until the pipe is closed; tell whether it fell silent instead."""
    received, poll = b"", select.poll()
    poll.register(pipe, select.POLLIN)
    is_late = False
    while True:
        # the child's alarm is first; this is for a child that cannot take it
        if not poll.poll(1000 * (SECONDS_MAX + 20)):
            is_late = True
            break
        found = os.read(pipe, 65536)
        if not found:
            break
        received += found
    os.close(pipe)
    return received.split(b"\n")[:-1], is_late


def _child(
    reader: Reader, read: Read, files: list[bytes], seen: set[tuple[str, int, int]], told: int
) -> None:
    """Read the files, tell what became of each, and end."""
    try:
        faulthandler.disable()  # what a crash says is no news here
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        apart.Apart.reply.__defaults__ = (SECONDS_MAX / 2,)
        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        resource.setrlimit(resource.RLIMIT_DATA, (_data_bytes() + DATA_MAX, hard))
        gc.disable()
        with tempfile.TemporaryDirectory(prefix="soak-", dir=_memory_folder()) as folder:
            path = Path(folder) / f"file{reader.suffix}"
            _write(path, sound_file(reader))
            read(path)  # libraries load their tables, which is no growth by a file
            for data in files:
                _write(path, data)
                signal.alarm(SECONDS_MAX)
                result, edges = _one(read, path)
                signal.alarm(0)
                new = [edge for edge in edges if edge not in seen]
                line = json.dumps(asdict(result) | {"edges": new})
                os.write(told, line.encode() + b"\n")
    finally:
        os._exit(0)


def sound_file(reader: Reader) -> bytes:
    """Return a file that is read."""
    return next(iter(sorted(CORPUS.glob(f"*{reader.suffix}")))).read_bytes()


def _write(path: Path, data: bytes) -> None:
    # A new file each time: what the last one left open may be looked at still.
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def _one(read: Read, path: Path) -> tuple[Result, set[tuple[str, int, int]]]:
    before = _peak()
    tracer = _Tracer()
    sys.settrace(tracer.enter)
    try:
        read(path)
        result = Result(Outcome.READ)
    except InputError as error:
        message = str(error)
        is_line = message.isprintable() and path.name in message and "; expected " in message
        result = Result(Outcome.REFUSED) if is_line else Result(Outcome.BUG, f"message: {message}")
    except Exception as error:
        result = Result(Outcome.BUG, _place_of(error))
    finally:
        sys.settrace(None)
    result.growth = _peak() - before
    if result.growth > FREE and result.growth > FREE + MEMORY_FACTOR * declared_bytes(path):
        result.outcome, result.fault = Outcome.MEMORY, f"{result.growth >> 20} MB"
    return result, tracer.edges


def _place_of(error: Exception) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/asglight/" in frame.filename] or frames
    text = ""
    with contextlib.suppress(UnicodeDecodeError):
        text = " ".join(str(error).split())[:80]
    return f"{type(error).__name__} at {Path(own[-1].filename).name}:{own[-1].lineno}: {text}"


def _peak() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _data_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()


def _memory_folder() -> str | None:
    return "/dev/shm" if os.path.isdir("/dev/shm") else None


class _Tracer:
    """Notes the steps from line to line in asglight's readers."""

    def __init__(self) -> None:
        self.edges: set[tuple[str, int, int]] = set()
        self._last: dict[int, int] = {}

    def enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        """Follow a call into a reader's file, and no other."""
        name = frame.f_code.co_filename
        if any(part in name for part in READERS_OWN):
            self._last[id(frame)] = frame.f_lineno
            return self._step
        return None

    def _step(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "line":
            key, line = id(frame), frame.f_lineno
            name = frame.f_code.co_filename.rpartition("asglight/")[2]
            self.edges.add((name, self._last.get(key, 0), line))
            self._last[key] = line
        return self._step
