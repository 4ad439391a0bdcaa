# SPDX-License-Identifier: Apache-2.0
"""Commands in processes of their own that need not load torch again.

Each process is a fork of one that has loaded everything. From the command line on it is what the
command does: it may be killed, and what it changes of its modules ends with it.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from places import SUPPORT

LOADED = (
    "asglight.cli.commands.fit",
    "asglight.usd.write.edits.edit_layer",
    "asglight.usd.write.stage_file",
)
"""What a fit would load by itself, once."""


class Nursery:
    """A process that has loaded everything, and forks."""

    def __init__(self, process: "subprocess.Popen[str]", folder: Path) -> None:
        """Take the process, and a folder for what its children say."""
        self._process = process
        self._folder = folder
        self._count = 0

    def begin(self, *words: str | Path, hook: str = "") -> int:
        """Start a command after a few lines of Python; return the number of its process."""
        self._count += 1
        request = {"words": list(map(str, words)), "hook": hook, "said": str(self._said)}
        return self._answer(request)

    def end(self) -> "subprocess.CompletedProcess[str]":
        """Wait for the command that was started last."""
        status = self._answer({})
        out, err = (Path(f"{self._said}.{name}").read_text() for name in ("out", "err"))
        return subprocess.CompletedProcess([], status, out, err)

    def run(self, *words: str | Path, hook: str = "") -> "subprocess.CompletedProcess[str]":
        """Run a command, as `commands.run_asglight`."""
        self.begin(*words, hook=hook)
        return self.end()

    @property
    def _said(self) -> Path:
        return self._folder / f"said-{self._count}"

    def _answer(self, request: dict[str, object]) -> int:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(json.dumps(request), file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())


@contextmanager
def nursery(folder: Path) -> Iterator[Nursery]:
    """Start a process that forks, and end it."""
    line = [sys.executable, str(SUPPORT / "forked.py")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    # OpenMP with threads hangs in a process forked off
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(SUPPORT.parents[1])}
    with subprocess.Popen(line, env=environment, **pipes) as process:
        yield Nursery(process, folder)
        assert process.stdin is not None
        process.stdin.close()  # which ends it


def _serve() -> tuple[list[str], str]:
    """Fork for each request and tell of the child; return, in a child, its words and hook."""
    child = 0
    for line in sys.stdin:
        request = json.loads(line)
        if not request:
            print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
            continue
        child = os.fork()
        if child == 0:
            _redirect(request["said"])
            return request["words"], request["hook"]
        print(child, flush=True)
    os._exit(0)


def _redirect(said: str) -> None:
    for number, path in enumerate((os.devnull, f"{said}.out", f"{said}.err")):
        flags = os.O_RDWR | (os.O_CREAT if number else 0)
        os.dup2(os.open(path, flags, 0o600), number)


if __name__ == "__main__":
    import importlib

    from asglight.cli.main import main

    for name in LOADED:
        importlib.import_module(name)
    words, hook = _serve()
    sys.argv[1:] = words
    exec(hook)
    sys.exit(main(words))
