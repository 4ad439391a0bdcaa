# SPDX-License-Identifier: Apache-2.0
"""A Python process of our own, for what native code does to files that may be damaged.

A library that reads a damaged file can abort the process, loop, or take all memory. What it does
here it does to a process that is told what to do, a JSON line at a time, and is ended and started
anew when it dies or does not answer. Replies are JSON, data and never code; bulk goes through
memory that both processes share.

The process is `python -c`, not multiprocessing: it runs nothing of the user's script, so that needs
no `if __name__ == "__main__"`.
"""

import json
import mmap
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any

from asglight.errors import InputError

TIME_LIMIT = 120.0
"""Seconds until a reply. A strip of an image is at most 100 MB: this long at 1 MB/s, the slowest
storage that anyone works on."""

_ENVIRONMENT = {
    # One thread: only the decoder's own are of use.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    # What a strip took is kept for the next one, up to 64 MB, and not given back to the system: a
    # tenth to a fifth of the time of a frame. Other systems than glibc's do not know these.
    "MALLOC_MMAP_THRESHOLD_": str(2**25),
    "MALLOC_TRIM_THRESHOLD_": str(2**26),
}

_START = """\
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from asglight.images.decoding import apart_child
import {module}
apart_child.serve({module}.handle, int(sys.argv[2]))
"""


class ApartError(Exception):
    """The process died, or did not answer in time; the message says which, as a clause."""


class Apart:
    """One such process, for one thread at a time."""

    def __init__(self, module: str) -> None:
        """Start the process; it needs no time of the caller.

        Args:
            module: Where its `handle` is (apart_child.py).
        """
        self._shared = _shared_file()
        self._memory: mmap.mmap | None = None
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-c", _START.format(module=module)),
                *(json.dumps(sys.path), str(self._shared)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,  # what a library says when it aborts is not one line
            bufsize=0,
            pass_fds=(self._shared,),
            start_new_session=True,  # Ctrl-C is for us: this process ends when we close its input
            env={**os.environ, **_ENVIRONMENT},
        )
        self._received = b""

    def grow(self, size: int) -> mmap.mmap:
        """Return the memory that both processes see, at least this many bytes.

        Raises:
            InputError: The system has or gives no more.
        """
        if self._memory is None or len(self._memory) < size:
            try:
                os.ftruncate(self._shared, size)
                self._memory = mmap.mmap(self._shared, size)
            except OSError as error:
                raise InputError(
                    f"memory: {size} bytes for rows of an image cannot be had ({error.strerror}); "
                    "expected so much memory and no lower limit of file sizes. See ulimit -a."
                ) from error
        return self._memory

    def tell(self, request: dict[str, Any]) -> None:
        """Send a line.

        Raises:
            ApartError: The process is dead.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
        except BrokenPipeError as error:
            raise ApartError(self._end()) from error

    def reply(self) -> dict[str, Any]:
        """Wait for a line, at most `TIME_LIMIT`, and return it.

        Raises:
            ApartError: The process died, or said nothing until then.
            RuntimeError: It met a bug.
        """
        assert self._process.stdout is not None
        descriptor, end = self._process.stdout.fileno(), time.monotonic() + TIME_LIMIT
        poll = select.poll()
        poll.register(descriptor, select.POLLIN)
        while b"\n" not in self._received:
            left = end - time.monotonic()
            if left <= 0 or not poll.poll(1000 * left):
                self.close()
                raise ApartError(f"no progress in {TIME_LIMIT:g} s")
            found = os.read(descriptor, 65536)
            if not found:
                raise ApartError(self._end())
            self._received += found
        line, _, self._received = self._received.partition(b"\n")
        reply = json.loads(line)
        if "bug" in reply:
            raise RuntimeError(reply["bug"])
        return reply

    def close(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                stream.close()
        if self._shared >= 0:
            os.close(self._shared)
            self._shared = -1

    def _end(self) -> str:
        """Return how the process ended, which it is about to if it has not."""
        try:
            status = self._process.wait(5)  # its pipe is closed, so it is on the way out
        except subprocess.TimeoutExpired:
            status = None
        self.close()
        if status is None or status >= 0:
            return "its reader stopped"
        return f"its reader was stopped by {signal.Signals(-status).name}"


def _shared_file() -> int:
    """Return a file without a name, in memory where the system has such files."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("asglight")
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
