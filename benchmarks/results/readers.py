# SPDX-License-Identifier: Apache-2.0
"""What commands print or write, as tables in Markdown."""

import json
from collections.abc import Callable, Sequence
from html.parser import HTMLParser
from typing import Any

from asglight.judging.metrics import METRIC_NAMES
from benchmarks.results.blocks import tables


def read_tables(text: str, suffix: str, reader: str | None) -> list[str]:
    """Return the tables of a text.

    Args:
        text: What a command printed or wrote.
        suffix: `.html` for HTML; all else is Markdown, unless a reader of JSON is named.
        reader: Name of a reader of JSON.
    """
    if reader is not None:
        return READERS[reader](json.loads(text))
    return _of_html(text) if suffix == ".html" else tables(text)


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose first row is its head; all columns but the first are numbers."""
    rule = ["---", *["--:"] * (len(rows[0]) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [rows[0], rule, *rows[1:]])


class _Tables(HTMLParser):
    """Collects the cells of every table."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[list[list[str]]] = []
        self._is_bold = self._is_in_cell = False

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag == "table":
            self.found.append([])
        elif tag == "tr":
            self.found[-1].append([])
        elif tag in ("td", "th"):
            self.found[-1][-1].append("")
            self._is_in_cell = True
        self._is_bold |= tag in ("b", "strong")

    def handle_endtag(self, tag: str) -> None:
        self._is_bold &= tag not in ("b", "strong")
        self._is_in_cell &= tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        text = data.strip()
        if text and self._is_in_cell:
            self.found[-1][-1][-1] += f"**{text}**" if self._is_bold else text


def _of_html(text: str) -> list[str]:
    parser = _Tables()
    parser.feed(text)
    return [markdown([row for row in table if row]) for table in parser.found]


def compared(document: dict[str, Any]) -> list[str]:
    """Return the errors and the three spheres of every method of `asglight compare --json`."""
    methods = document["frames"][0]["methods"]
    errors = [
        [
            _with_steps(method),
            str(method["floats"]),
            f"{method['cpu_seconds']:.1f}",
            *(f"{method[name]:.4f}" for name in METRIC_NAMES),
            "–" if method["psnr_db"] is None else f"{method['psnr_db']:.1f}",
            "–" if method["hdr_flip"] is None else f"{method['hdr_flip']:.3f}",
        ]
        for method in methods
    ]
    head = ["method", "floats", "CPU s", *METRIC_NAMES, "PSNR", "FLIP"]
    spheres = list(methods[0]["spheres"])
    looks = {"rmse": "RMSE", "si_rmse": "si-RMSE", "angular": "angle"}
    balls = [
        [
            _with_steps(method),
            *(f"{method['spheres'][sphere][key]:.3g}" for sphere in spheres for key in looks),
        ]
        for method in methods
    ]
    named = [f"{sphere} {look}" for sphere in spheres for look in looks.values()]
    return [markdown([head, *errors]), markdown([["three spheres", *named], *balls])]


def _with_steps(method: dict[str, Any]) -> str:
    """Return the title of a method, with the part of its published steps that it took."""
    if method["steps"] == method["published_steps"]:
        return method["title"]
    return f"{method['title']}, {method['steps']:,} of {method['published_steps']:,} steps"


READERS: dict[str, Callable[[dict[str, Any]], list[str]]] = {"compared": compared}
