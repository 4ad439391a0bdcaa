# SPDX-License-Identifier: Apache-2.0
"""A disk that is full for every file beyond a size, as this process sees it."""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def full_beyond(size: int) -> Iterator[None]:
    """Let writes to a file fail beyond so many bytes; Python ignores the signal for it."""
    import resource  # which Windows lacks

    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
