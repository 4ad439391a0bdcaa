# SPDX-License-Identifier: Apache-2.0
"""Peak memory of a part of a run.

Linux keeps the largest resident set of a process, and forgets it when asked to (proc(5),
/proc/PID/clear_refs). What earlier work has freed the allocator holds in reserve, and the next part
would be served from there unseen: it is given back first (malloc_trim(3), of glibc). Where either
is missing there is no answer: the peak of the whole run says nothing of a part.
"""

import contextlib
import ctypes
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_FORGET_PEAK = "5"


@dataclass
class Peak:
    """Memory of a part of a run.

    Attributes:
        grown: Bytes at the highest point above those at the start; None where nobody tells.
    """

    grown: int | None = None


@contextlib.contextmanager
def peak_memory() -> Iterator[Peak]:
    """Watch the memory of a part of a run; `Peak.grown` is there when it ends."""
    peak = Peak()
    start = _forgotten()
    yield peak
    if start is not None:
        peak.grown = max(_bytes("VmHWM") - start, 0)


def _forgotten() -> int | None:
    """Forget the peak so far; return the bytes in memory now, or None where that is unknown."""
    try:
        ctypes.CDLL(None).malloc_trim(0)
        _RESET.write_text(_FORGET_PEAK)
        return _bytes("VmRSS")
    except (OSError, AttributeError):  # no such file, no such function
        return None


def _bytes(name: str) -> int:
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith(f"{name}:"))
    return 1024 * int(line.split()[1])
