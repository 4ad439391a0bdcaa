# SPDX-License-Identifier: Apache-2.0
"""What USD and the file system say, as one printable line."""

import os

from pxr import Tf

REASON_MAX = 200
"""Characters of a library's own words that are passed on: enough for a cause and a place."""


def shown(path: str | os.PathLike[str]) -> str:
    """Return a path as one printable line, whatever its name holds."""
    return _printable(os.fspath(path))


def reason(error: OSError | Tf.ErrorException) -> str:
    """Return the first cause that an error names, without USD's place in its sources."""
    if isinstance(error, OSError):
        return error.strerror or type(error).__name__
    causes = [getattr(cause, "commentary", str(cause)) for cause in error.args]
    first = causes[0] if causes else "no reason given"
    return _printable(" ".join(first.split()))[:REASON_MAX].rstrip(".")


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)
