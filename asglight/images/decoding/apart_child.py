# SPDX-License-Identifier: Apache-2.0
"""What a process of `apart.Apart` runs: it reads requests from its input until that is closed."""

import json
import mmap
import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from asglight.errors import InputError
from asglight.images.decoding.apart import TIME_LIMIT

THREADS = 16 * 2**20 * (os.cpu_count() or 1)
"""Bytes of the stacks (8 MB) and buffers of a library's threads, one for each core."""

Handle = Callable[[dict[str, Any], "Channel"], None]
"""Answers a request, a line or several, through the channel."""


class Channel:
    """The way back to the process that asks."""

    def __init__(self, replies: int, shared: int) -> None:
        """Take the descriptors of the pipe for replies and of the shared memory."""
        self._replies = replies
        self._shared = shared
        self._memory: mmap.mmap | None = None

    def memory(self, size: int) -> mmap.mmap:
        """Return the memory that both processes see, which the other one has made so large."""
        if self._memory is None or len(self._memory) < size:
            self._memory = mmap.mmap(self._shared, size)
        return self._memory

    def tell(self, reply: dict[str, Any]) -> None:
        """Send a line; the time for the next one begins."""
        signal.alarm(0)
        os.write(self._replies, json.dumps(reply).encode() + b"\n")
        _watch()

    def next_request(self) -> dict[str, Any] | None:
        """Wait for a line; None at the end."""
        signal.alarm(0)
        line = sys.stdin.buffer.readline()
        _watch()
        return json.loads(line) if line else None


def serve(handle: Handle, shared: int) -> None:
    """Answer requests until there are no more.

    Args:
        handle: Answers one.
        shared: Descriptor of the memory that both processes see.
    """
    # Libraries print; only our lines may reach the pipe.
    replies = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    channel = Channel(replies, shared)
    while (request := channel.next_request()) is not None:
        try:
            handle(request, channel)
        except InputError as error:
            finding = getattr(error, "finding", None)  # of a damaged file
            channel.tell({"refused": str(error), "finding": finding})
        except Exception:
            channel.tell({"bug": traceback.format_exc()})


def allow_memory(size: int) -> None:
    """Let this process take so much memory more, and what threads take; what takes more fails.

    Args:
        size: Bytes that a file has good reason to need.
    """
    statistics = Path("/proc/self/statm")
    if not statistics.exists():  # not Linux: the system's own limits hold
        return
    data = int(statistics.read_text().split()[5]) * resource.getpagesize()
    limit, hard = data + size + THREADS, resource.getrlimit(resource.RLIMIT_DATA)[1]
    soft = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _watch() -> None:
    """End this process if it is stuck and nobody is left to end it; a second after they would."""
    signal.alarm(int(TIME_LIMIT) + 1)
