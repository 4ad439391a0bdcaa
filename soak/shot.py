# SPDX-License-Identifier: Apache-2.0
"""A tiny shot, and `asglight fit` of it in a process that things are done to.

The process is a fork of one that has loaded everything: a run then takes as long as its frames, and
fifty can be broken in minutes. From the command line on, it is what the command does.
"""

import contextlib
import itertools
import os
import shutil
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

import asglight.cli.commands.fit
import asglight.usd.write.edits.edit_layer
import asglight.usd.write.stage_file
from asglight.cli.main import main
from asglight.images import write_exr

ROWS = 16
FRAMES = 6
OPTIONS = ("--preset", "live", "--lobes", "2", "--dome-height", "8", "--resume")

LOADED = (
    asglight.cli.commands.fit,
    asglight.usd.write.edits.edit_layer,
    asglight.usd.write.stage_file,
)
"""What a run would load by itself, once."""


def sky(frame: int) -> torch.Tensor:
    """Return a dim sky with a lamp that moves a column a frame.  [ROWS, 2 ROWS, 3]."""
    values = np.full((ROWS, 2 * ROWS, 3), 0.1, np.float32)
    values[ROWS // 3, frame % (2 * ROWS)] = (90.0, 60.0, 30.0)
    return torch.from_numpy(values)


def write_shot(folder: Path, frames: range) -> Path:
    """Write frames as `sky.####.exr` into a new folder, and return it."""
    folder.mkdir(parents=True)
    for frame in frames:
        write_exr(folder / f"sky.{frame:04d}.exr", sky(frame))
    return folder


_COUNT = itertools.count()


class Run:
    """A running `asglight fit`.

    Attributes:
        stage: Its output.
        log: What it says on standard error.
    """

    def __init__(self, source: Path, stage: Path, *options: str) -> None:
        """Start it.

        Args:
            source: The images.
            stage: The output.
            options: More of them.
        """
        self.stage = stage
        self.log = source.parent / f"run-{next(_COUNT)}.log"  # not on the disk that is full
        words = ["fit", str(source), "-o", str(stage), *OPTIONS, *options]
        sys.stdout.flush()
        sys.stderr.flush()
        self.pid = os.fork()
        if self.pid == 0:
            _run(words, self.log)
        self._status: int | None = None

    def wait(self, seconds: float = 600.0) -> int:
        """Wait for its end: the exit status, or minus the signal that ended it."""
        end = time.monotonic() + seconds
        while self._status is None:
            if not self.poll():
                assert time.monotonic() < end, f"{self.log}: still running"
                time.sleep(0.005)
        return self._status

    def poll(self) -> bool:
        """Tell whether it has ended."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
        return self._status is not None

    def send(self, number: signal.Signals) -> None:
        """Send a signal, unless it has ended."""
        if not self.poll():
            os.kill(self.pid, number)

    def hold(self) -> bool:
        """Stop it where it is, until SIGCONT; tell whether it had not ended before."""
        self.send(signal.SIGSTOP)
        if self._status is None:
            os.waitid(os.P_PID, self.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        return not self.poll()

    def errors(self) -> list[str]:
        """Return the lines on standard error that are not progress."""
        lines = self.log.read_text().splitlines()
        return [line for line in lines if not line.startswith(("frame ", "refined"))]


def _run(words: list[str], log: Path) -> None:
    status = 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        kept = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(nowhere, 1)
        os.dup2(kept, 2)
        # whoever started this may have put something else in their place
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        status = main(words)
        sys.stderr.flush()
    finally:
        os._exit(status)


def files(folder: Path) -> dict[str, bytes]:
    """Return every file by its path, but for hidden ones: what a killed writer left."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    names = {str(path.relative_to(folder)): path for path in found}
    return {name: path.read_bytes() for name, path in names.items() if name[0] != "."}


def results(folder: Path) -> dict[str, bytes]:
    """Return the files without the checkpoint."""
    return {name: data for name, data in files(folder).items() if "checkpoint" not in name}


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Make an empty folder and remove it afterwards."""
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
