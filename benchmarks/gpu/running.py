# SPDX-License-Identifier: Apache-2.0
"""A measure in a process of its own: whatever ends it leaves the others alone."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from benchmarks.gpu.plan import Measure
from benchmarks.gpu.rows import Given

ROOT = Path(__file__).resolve().parents[2]

LEAST = 5.0
"""Seconds without which a measure is not begun: torch takes as long to load."""


class State(StrEnum):
    """How a measure ended."""

    DONE = "done"
    FAILED = "failed"
    OVER_TIME = "over time"
    NOT_BEGUN = "not begun"


def taken(measure: Measure, given: Given, left: float) -> dict[str, Any]:
    """Take a measure.

    Args:
        measure: Which.
        given: What it is given, but for its seconds and its choice.
        left: Seconds until the deadline of the whole.

    Returns:
        Its state, seconds, rows found, and why there are no more; as it is in the JSON.
    """
    seconds = min(measure.seconds, left)
    if seconds < LEAST:
        return _told(State.NOT_BEGUN, 0.0, [], "the time of the whole is over")
    own = replace(given, seconds=seconds, choice=measure.choice)
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        asked, rows, errors = (Path(folder) / name for name in ("asked", "rows", "errors"))
        asked.write_text(json.dumps({"module": measure.module, **asdict(own)}, default=str))
        words = [sys.executable, "-m", "benchmarks.gpu.worker", str(asked), str(rows)]
        with errors.open("w") as stream:
            process = subprocess.Popen(
                words, cwd=ROOT, stdout=stream, stderr=stream, start_new_session=True
            )
            try:
                status = process.wait(seconds)
            except subprocess.TimeoutExpired:
                status = None
            finally:
                _end(process)
        lines = rows.read_text().splitlines() if rows.is_file() else []
        said = errors.read_text(errors="replace").strip()
    found = [json.loads(line) for line in lines if line.endswith("}")]
    passed = time.monotonic() - begin
    if status is None:
        return _told(State.OVER_TIME, passed, found, f"ended after {seconds:.0f} s")
    if status:
        why = said or f"exit status {status}"
        return _told(State.FAILED, passed, found, why)
    return _told(State.DONE, passed, found, "")


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a measure and what it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _told(state: State, seconds: float, rows: list[dict[str, Any]], why: str) -> dict[str, Any]:
    return {"state": state.value, "seconds": round(seconds, 1), "rows": rows, "why": why}
