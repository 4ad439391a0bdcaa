# SPDX-License-Identifier: Apache-2.0
"""The rows as Markdown."""

from collections.abc import Iterable, Sequence

from dcc.rows import FacingRow, Row, limit_of

_HEADS = {
    "program": "program",
    "sequence": "sequence",
    "frame": "frame",
    "up_axis": "up",
    "representation": "stage shows",
    "material": "ball",
}


def markdown(balls: Sequence[Row], facing: Sequence[FacingRow]) -> str:
    """Return all tables."""
    return f"{ball_table(balls)}\n\n{facing_table(facing)}"


def ball_table(balls: Iterable[Row]) -> str:
    """Return one line for each ball, in percent."""
    errors = ("fit", "export", "mean_export", "reading", "total", "noise")
    head = [*_HEADS.values(), *(name.replace("_", " ") for name in errors), "limit"]
    lines = []
    for row in balls:
        limit = limit_of(row)
        verdict = "" if limit is None else f"{limit.of} {limit.most:.0%}"
        if limit is not None and getattr(row, limit.of) > limit.most:
            verdict += ", missed"
        words = [str(getattr(row, name)) for name in _HEADS]
        lines.append([*words, *(_percent(getattr(row, name)) for name in errors), verdict])
    return _table(head, lines)


def facing_table(facing: Iterable[FacingRow]) -> str:
    """Return one line for each frame's distant lights."""
    head = [
        "program",
        "sequence",
        "frame",
        "up",
        "lights",
        "worst",
        "wide lights",
        "worst",
        "turned",
    ]
    lines = [
        [
            row.program,
            row.sequence,
            str(row.frame),
            row.up_axis,
            str(row.narrow),
            _percent(row.narrow_error),
            str(row.wide),
            _percent(row.wide_error),
            f"{row.direction_deg:.3f}°",
        ]
        for row in facing
    ]
    return _table(head, lines)


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2f}"


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
