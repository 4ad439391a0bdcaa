# SPDX-License-Identifier: Apache-2.0
"""Words for messages about files: always one line, always printable."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

# Longest library finding that is passed on: about two terminal lines, enough for a cause.
FINDING_MAX = 160
# Names listed before the rest is only counted.
LISTED_MAX = 8


def shown(path: str | Path) -> str:
    """Return a path, or a text from a file, as one printable line, whatever it holds."""
    try:
        text = os.fsencode(path).decode("utf-8", "replace")
    except UnicodeEncodeError:  # half a surrogate pair, as JSON may hold: no path
        text = str(path)
    return "".join(character if character.isprintable() else "?" for character in text)


def has_backslash(path: str | Path) -> bool:
    """Tell whether a path has backslashes where they separate no folders."""
    return os.sep == "/" and "\\" in str(path)


def forward(path: str | Path) -> str:
    """Return a path with slashes in the place of backslashes."""
    return str(path).replace("\\", "/")


def compressed(finding: str) -> str:
    """Return what a library said as one short clause: no codes, no path, no full stop."""
    line = next((line for line in finding.splitlines() if line.strip()), "no reason given")
    line = re.sub(r"^EXR Error \(.*?\): (EXR_ERR_\w+ )?", "", line)
    line = re.sub(r'^.*image file ".*?"\.? ', "", line)
    printable = "".join(character if character.isprintable() else "?" for character in line)
    return printable.strip().rstrip(".")[:FINDING_MAX]


def listing(names: Iterable[object]) -> str:
    """Return names as `a, b, c`, cut with a count where there are many."""
    every = [shown(str(name)) for name in names]
    if len(every) <= LISTED_MAX:
        return ", ".join(every)
    return f"{', '.join(every[:LISTED_MAX])} and {len(every) - LISTED_MAX} more"
