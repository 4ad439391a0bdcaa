# SPDX-License-Identifier: Apache-2.0
"""Copies of images for a decoder that does not know how they are stored.

The process that decodes is killed when a user or a time limit ends it, and a copy is as large as
the image. So it has no name in any folder where the system can do that, and is gone with the
process, however that ends.
"""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

OPEN_FILES = Path("/proc/self/fd")
"""Where this process finds its open files by their number, also those without a name: on Linux."""


@contextlib.contextmanager
def empty(suffix: str) -> Iterator[tuple[IO[bytes], Path]]:
    """Give an empty file to be written, in the folder for temporary files.

    Args:
        suffix: What its name ends with where it needs one.

    Yields:
        The file, and a path that opens it in this process until it is gone afterwards.

    Raises:
        OSError: There is no room.
    """
    if OPEN_FILES.is_dir():
        with tempfile.TemporaryFile() as file:
            yield file, OPEN_FILES / str(file.fileno())
    else:
        with tempfile.NamedTemporaryFile(suffix=suffix) as file:
            yield file, Path(file.name)
