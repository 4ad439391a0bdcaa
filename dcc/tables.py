# SPDX-License-Identifier: Apache-2.0
"""The rows as Markdown."""

from collections.abc import Iterable, Sequence

from dcc.rows import FacingRow, Row, limit_of

ERRORS = ("fit", "export", "mean_export", "reading", "total", "noise")


def markdown(balls: Sequence[Row], facing: Sequence[FacingRow]) -> str:
    """Return all tables."""
    return f"{ball_table(balls)}\n\n{facing_table(facing)}"


def ball_table(balls: Iterable[Row]) -> str:
    """Return one line for each picture, the balls beside each other in each cell, in percent."""
    pictures: dict[tuple[str, ...], list[Row]] = {}
    for row in balls:
        key = row.program, row.sequence, str(row.frame), row.up_axis, row.representation
        pictures.setdefault(key, []).append(row)
    head = ["program", "sequence", "frame", "up", "stage shows"]
    head += [*(name.replace("_", " ") for name in ERRORS), "limit"]
    lines = [
        [*key, *(_cell(rows, name) for name in ERRORS), _verdict(rows)]
        for key, rows in pictures.items()
    ]
    return _table(head, lines)


def _cell(rows: Sequence[Row], name: str) -> str:
    values = [getattr(row, name) for row in rows]
    return "" if None in values else " / ".join(map(_percent, values))


def _verdict(rows: Sequence[Row]) -> str:
    limit = limit_of(rows[0])
    if limit is None:
        return ""
    missed = any(getattr(row, limit.of) > limit.most for row in rows)
    return f"{limit.of} {limit.most:.0%}" + ", missed" * missed


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


def _percent(value: float) -> str:
    return f"{100 * value:.2f}"


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)
