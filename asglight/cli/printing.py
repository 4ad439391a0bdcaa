# SPDX-License-Identifier: Apache-2.0
"""How results are printed: JSON documents, aligned tables, durations, sizes, counts."""

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

from fileseq import framesToFrameRange


def print_json(document: dict[str, Any]) -> None:
    """Print one JSON document on standard output; infinite and undefined numbers become null."""
    print(json.dumps(_finite(document), indent=2, allow_nan=False))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return rows as text with aligned columns: the first to the left, the others to the right."""
    every = [header, *rows]
    widths = [max(len(row[column]) for row in every) for column in range(len(header))]
    lines = []
    for row in every:
        first, *rest = (
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  ".join([first, *rest]).rstrip())
    return "\n".join(lines)


def summed_up(subject: str, lines: Sequence[str]) -> str:
    """Return the first of some findings on a stage, and how many more there are."""
    more = f"; and {len(lines) - 1} more, see asglight info" if len(lines) > 1 else ""
    return f"{subject}: {lines[0]}{more}"


def duration(seconds: float) -> str:
    """Return a time in the two largest units that matter."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest:02d} s"
    return f"{minutes // 60} h {minutes % 60:02d} min"


def size(count: int) -> str:
    """Return a number of bytes in decimal units."""
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count} B"


def counted(count: int, noun: str) -> str:
    """Return `1 frame`, `2 frames`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def frame_range(frames: Sequence[int]) -> str:
    """Return frames as `1001-1048`, `1001-1047x2` or `1001,1003,1010`."""
    return framesToFrameRange(frames)


def percent(ratio: float | None) -> str:
    """Return a signed error in percent; a rounded zero has no sign."""
    if ratio is None:
        return "unknown"
    text = f"{100 * ratio:+.2f} %"
    return text[1:] if text in ("+0.00 %", "-0.00 %") else text


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
