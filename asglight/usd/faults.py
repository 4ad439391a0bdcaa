# SPDX-License-Identifier: Apache-2.0
"""What USD and the file system say, as one printable line."""

from pxr import Tf

from asglight.images.message import shown

REASON_MAX = 200
"""Characters of a library's own words that are passed on: enough for a cause and a place."""


def reason(error: OSError | Tf.ErrorException) -> str:
    """Return the first cause that an error names, without USD's place in its sources."""
    if isinstance(error, OSError):
        return error.strerror or type(error).__name__
    try:
        causes = [getattr(cause, "commentary", None) or str(cause) for cause in error.args]
    except UnicodeDecodeError:  # it quotes the file
        causes = ["a text in it is not UTF-8"]
    first = causes[0] if causes else "no reason given"
    return shown(" ".join(first.split()))[:REASON_MAX].rstrip(".")
