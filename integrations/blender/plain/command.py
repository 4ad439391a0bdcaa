# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's `asglight` command as a process beside Blender."""

import os
import queue
import re
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import dataclass

COUNTED = re.compile(r"\((\d+)/(\d+)\)|refined (\d+)/(\d+)")
"""What the command writes of its frames where nobody looks at a terminal."""

KEYS = "--keys"

BLENDERS_OWN = ("PYTHONHOME", "PYTHONPATH")
"""Variables that are for Blender's Python and would lead another astray."""

_STARTED_APART = {"creationflags": 0x08000000} if os.name == "nt" else {}
"""On Windows no window opens for it (CREATE_NO_WINDOW)."""


@dataclass(frozen=True)
class Images:
    """What of a World is fitted.

    Attributes:
        pattern: A file, or the pattern of a sequence.
        first: Number of the first file of a sequence; None for a still.
        last: Of the last.
    """

    pattern: str
    first: int | None = None
    last: int | None = None


def pattern_of(path: str) -> str:
    """Return the pattern of a sequence by one of its files: its last number becomes `#` signs."""
    folder, name = os.path.split(path)
    found = re.fullmatch(r"(.*?)(\d+)(\D*)", name)
    if found is None:
        raise ValueError(f"{name}: has no number; expected an image of a sequence")
    return os.path.join(folder, f"{found[1]}{'#' * len(found[2])}{found[3]}")


def shown_files(scene: tuple[int, int], played: tuple[int, int, int]) -> tuple[int, int]:
    """Return the first and last file of a sequence that a scene shows.

    Args:
        scene: Its first and last frame.
        played: Frame at which the sequence starts, how many it has, and what is added to their
            numbers: Blender's `frame_start`, `frame_duration` and `frame_offset`.
    """
    start, count, offset = played
    first, last = (min(max(frame - start + 1, 1), count) + offset for frame in scene)
    return first, last


def fit_line(command: str, images: Images, stage: str, fps: float, keys: str) -> list[str]:
    """Return the command line of a fit.

    Args:
        command: The `asglight` command.
        images: What to fit.
        stage: The stage to write.
        fps: Frames per second.
        keys: What `--keys` is to say; nothing without keys.
    """
    line = [command, "fit", images.pattern, "-o", stage, "--fps", f"{fps:.12g}"]
    if images.first is not None:
        line += ["--frames", f"{images.first}-{images.last}"]
    return [*line, KEYS, keys] if keys else line


def has_keys(command: str) -> bool:
    """Tell whether the command can fit keys.

    Raises:
        OSError: It cannot be started.
    """
    line = [command, "fit", "--help"]
    found = subprocess.run(
        line, env=environment(), capture_output=True, text=True, check=False, **_STARTED_APART
    )
    return KEYS in found.stdout.split()


def environment() -> dict[str, str]:
    """Return the variables that the command is started with."""
    return {name: value for name, value in os.environ.items() if name not in BLENDERS_OWN}


class Run:
    """A command that runs.

    Attributes:
        share: Of its work that is done, from 0 to 1.
        line: The last that it said.
    """

    def __init__(self, line: Sequence[str]) -> None:
        """Start it.

        Raises:
            OSError: It cannot be started.
        """
        self.share = 0.0
        self.line = ""
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._process = subprocess.Popen(
            list(line),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            **_STARTED_APART,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def poll(self) -> int | None:
        """Take what was said since; return the exit status, or None while it runs."""
        status = self._process.poll()
        if status is not None:
            self._reader.join()
        while not self._lines.empty():
            self.line = self._lines.get()
            self.share = share_of(self.line, self.share)
        return status

    def wait(self) -> int:
        """Wait for its end; return the exit status."""
        self._process.wait()
        return self.poll() or 0

    def cancel(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.wait()
        self._reader.join()

    def _read(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as said:
            for line in said:
                if line.strip():
                    self._lines.put(line.strip())


def share_of(line: str, before: float) -> float:
    """Return the share of the work that is done, from a line of the command; it never falls."""
    found = COUNTED.search(line)
    if found is None:
        return before
    done, whole = (int(number) for number in found.groups() if number is not None)
    return max(before, min(done / max(whole, 1), 1.0))
