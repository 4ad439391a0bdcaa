# SPDX-License-Identifier: Apache-2.0
"""Commands in processes of their own that need not load torch again.

Each process is a fork of one that has loaded everything (loaded.py). From the command line on it is
what the command does: it may be killed, and what it changes of its modules ends with it.
"""

import os
import subprocess
import sys
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import loaded


class Forks:
    """Starts commands, one at a time."""

    def __init__(self, folder: Path) -> None:
        """Take a folder for what the commands say."""
        self._folder = folder
        self._count = 0
        self._process: ForkServerProcess | None = None

    def begin(self, *words: str | Path, hook: str = "") -> int:
        """Start a command after a few lines of Python; return the number of its process."""
        self._count += 1
        given = (list(map(str, words)), hook, str(self._said))
        self._process = loaded.context().Process(target=_run, args=given)
        self._process.start()
        assert self._process.pid is not None
        return self._process.pid

    def end(self) -> "subprocess.CompletedProcess[str]":
        """Wait for the command that was started last."""
        assert self._process is not None
        self._process.join()
        out, err = (Path(f"{self._said}.{name}").read_text() for name in ("out", "err"))
        return subprocess.CompletedProcess([], self._process.exitcode or 0, out, err)

    def run(self, *words: str | Path, hook: str = "") -> "subprocess.CompletedProcess[str]":
        """Run a command, as `commands.run_asglight`."""
        self.begin(*words, hook=hook)
        return self.end()

    @property
    def _said(self) -> Path:
        return self._folder / f"said-{self._count}"


def _run(words: list[str], hook: str, said: str) -> None:
    """Be the command: this is what the process runs."""
    from asglight.cli.main import main

    for number, path in enumerate((os.devnull, f"{said}.out", f"{said}.err")):
        flags = os.O_RDWR | (os.O_CREAT if number else 0)
        os.dup2(os.open(path, flags, 0o600), number)
    sys.argv[1:] = words
    exec(hook, {"main": main, "sys": sys})
    sys.exit(main(words))
