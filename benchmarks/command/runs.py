# SPDX-License-Identifier: Apache-2.0
"""Wall time, processor time and peak memory of a whole command.

Linux counts to a process what the one that started it held at that moment. This one holds torch, so
commands are started by a small one: this file as a script.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class CommandFailed(Exception):  # noqa: N818  what happened, not an error of this program
    """A command ended with another status than 0."""


@dataclass(frozen=True)
class Run:
    """A command that was run.

    Attributes:
        wall: Seconds from its start to its end.
        cpu: Seconds of the processor, of its own processes together.
        peak: Bytes of the largest of its processes, at most.
        printed: What it printed.
    """

    wall: float
    cpu: float
    peak: int
    printed: str

    def as_json(self) -> dict[str, float]:
        """Return the run as it is in the JSON."""
        return {"wall_seconds": self.wall, "cpu_seconds": self.cpu, "peak_bytes": self.peak}


def run(words: Sequence[str]) -> Run:
    """Run Python with arguments.

    Raises:
        CommandFailed: It did.
    """
    told = {**os.environ, "PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        target = Path(folder) / "used.json"
        # -S: the starter stays small
        starting = [sys.executable, "-S", str(Path(__file__)), str(target), *words]
        done = subprocess.run(starting, capture_output=True, text=True, check=False, env=told)
        used = json.loads(target.read_text())
    if used["status"]:
        last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
        raise CommandFailed(f"{' '.join(words)} ended with {used['status']}: {last}")
    return Run(used["wall"], used["cpu"], used["peak"], done.stdout)


def in_turn(commands: Mapping[str, Sequence[str]], times: int) -> dict[str, list[Run]]:
    """Run commands in turn, each so many times: what slows the machine meets all of them."""
    found: dict[str, list[Run]] = {name: [] for name in commands}
    for _ in range(times):
        for name, words in commands.items():
            found[name].append(run(words))
    return found


def start(target: str, words: Sequence[str]) -> None:
    """Run Python with arguments, and write what it took and its status."""
    begin = time.perf_counter()
    process = os.posix_spawn(sys.executable, [sys.executable, *words], os.environ)
    _, status, used = os.wait4(process, 0)  # of it and those that it waited for
    wall = time.perf_counter() - begin
    found = {
        "wall": wall,
        "cpu": used.ru_utime + used.ru_stime,
        "peak": (1 if sys.platform == "darwin" else 1024) * used.ru_maxrss,
        "status": os.waitstatus_to_exitcode(status),
    }
    Path(target).write_text(json.dumps(found))


if __name__ == "__main__":
    start(sys.argv[1], sys.argv[2:])
