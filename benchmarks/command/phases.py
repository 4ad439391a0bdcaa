# SPDX-License-Identifier: Apache-2.0
"""Where the time of a whole `asglight fit` goes: start, first frame, last frame, stage.

    python -m benchmarks.command.phases ../shared/sequences/tunnel --preset live
    python -m benchmarks.command.phases ../shared/sequences/tunnel --preset live --frames 1000
    python -m benchmarks.command.phases ../shared/hdri/lobby.exr --preset fast

Seconds of wall time and, in brackets, of processor time, since the process was started; beside them
those of `import torch`, measured in the same run. The processor time of the process that decodes is
in the last column only. `--frames` runs a sequence to and fro until there are so many.
"""

import argparse
import contextlib
import itertools
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MEASURED = """\
import os, resource, sys, time
from asglight.cli import main as command, progress
from asglight.fitting import sequence
from asglight.shots import frames

def told(name):
    used = resource.getrusage(resource.RUSAGE_SELF)
    seconds = time.time() - float(os.environ["STARTED"])
    print("AT", name, seconds, used.ru_utime + used.ru_stime, file=sys.stderr)

fit_frame, show = frames.fit_frame, progress.Lines.__call__
begun = []

def fit(*arguments):
    if not begun:
        begun.append(told("fit begins"))
    return fit_frame(*arguments)

def shown(self, event):
    if type(event).__name__ == "FrameDone" and event.position in (1, event.frames):
        told("first frame" if event.position == 1 else "last frame")
    if type(event).__name__ == "Refined" and event.done == event.frames:
        told("last frame")
    show(self, event)

frames.fit_frame, progress.Lines.__call__ = fit, shown
status = command.main()
told("stage")
sys.exit(status)
"""
"""Runs the command with the clock read where frames are told of."""

COLUMNS = ("fit begins", "first frame", "last frame", "stage")


def main() -> None:
    """Run the command a few times and print one row for each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("input", type=Path)
    parser.add_argument("--preset", default="live")
    parser.add_argument("--frames", type=int, help="of a sequence run to and fro (default: as is)")
    parser.add_argument("--representations", default="cards")
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    print("import torch   " + "".join(f"{name:<16}" for name in COLUMNS) + "all CPU  peak MB")
    with tempfile.TemporaryDirectory() as folder:
        images = arguments.input
        if arguments.frames:
            images = to_and_fro(images, Path(folder) / "images", arguments.frames)
        words = ["--preset", arguments.preset, "--representations", arguments.representations]
        for repeat in range(arguments.repeats):
            stage = Path(folder) / f"{repeat}" / "shot.usdc"
            stage.parent.mkdir()
            print(row([str(images), "-o", str(stage), *words]))


def to_and_fro(source: Path, folder: Path, count: int) -> Path:
    """Link the images of a folder to and fro as a sequence of so many frames."""
    files = sorted(source.resolve().glob("*.exr"))
    folder.mkdir()
    there_and_back = itertools.cycle([*files, *files[-2:0:-1]])
    for frame, file in zip(range(1001, 1001 + count), there_and_back, strict=False):
        (folder / f"shot.{frame}.exr").symlink_to(file)
    return folder


def row(words: list[str]) -> str:
    """Return what one run of the command takes."""
    torch, _ = run("import torch", [])
    found, said = run(MEASURED, ["fit", *words])
    at = {
        name: (float(wall), float(used))
        for name, wall, used in (
            line.removeprefix("AT ").rsplit(maxsplit=2)
            for line in said.splitlines()
            if line.startswith("AT ")
        )
    }
    at.setdefault("last frame", at["first frame"])
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024
    cells = [f"{wall:6.2f} ({used:5.2f})  " for wall, used in (at[name] for name in COLUMNS)]
    return f"{torch[0]:5.2f} ({torch[1]:4.2f})   {''.join(cells)}{found[1]:7.2f}  {peak:7d}"


def run(code: str, words: list[str]) -> tuple[tuple[float, float], str]:
    """Run Python code; return its seconds of wall and of processor time, and what it said.

    Raises:
        RuntimeError: It failed.
    """
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    environment = os.environ | {"STARTED": str(start)}
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    wall, after = time.time() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(done.stderr)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (wall, used), done.stderr


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
