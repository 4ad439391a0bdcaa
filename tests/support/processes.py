# SPDX-License-Identifier: Apache-2.0
"""Waiting for what other processes and threads do."""

import os
import time
from collections.abc import Callable

PATIENCE = 60.0
"""Seconds before a test gives up: loading torch takes a second, on a loaded machine many."""


def wait_until(is_true: Callable[[], object]) -> None:
    """Ask again and again until a function returns something true."""
    end = time.monotonic() + PATIENCE
    while not is_true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def is_running(pid: int) -> bool:
    """Tell whether a process exists that has not ended."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    try:
        with open(f"/proc/{pid}/stat") as stream:
            return stream.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
