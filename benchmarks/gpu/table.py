# SPDX-License-Identifier: Apache-2.0
"""What was found as one Markdown table."""

from typing import Any

from benchmarks.gpu.running import State

WHY_MAX = 200
"""Characters of why a measure failed; the whole is in the JSON."""


def table(document: dict[str, Any]) -> str:
    """Return the run as Markdown: where it ran, and a row for each thing measured."""
    lines = [
        f"{document['device']}, torch {document['machine']['torch']}, "
        f"{document['machine']['processor']}, {document['machine']['cores']} cores"
        + (", a short run that says nothing of speed" if document["short"] else ""),
        "",
        "| measure | what | found | goal |",
        "|---|---|---|---|",
    ]
    for name, measure in document["measures"].items():
        lines += [_row(name, row) for row in measure["rows"]]
        if measure["state"] != State.DONE:
            last = measure["why"].splitlines()[-1] if measure["why"] else ""
            lines.append(_line(name, f"**{measure['state']}**: {last[:WHY_MAX]}", "", ""))
    return "\n".join(lines) + "\n"


def _row(name: str, row: dict[str, Any]) -> str:
    found = ", ".join(f"{key} {_shown(value)}" for key, value in row["found"].items())
    goals = ", ".join(f"{key} ≤ {most:g}" for key, most in row["goal"].items())
    return _line(name, row["what"], found, f"**missed**: {goals}" if row["missed"] else goals)


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def _line(*cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
