# SPDX-License-Identifier: Apache-2.0
"""How much a search for faults tries: a fifth each time, all of it in `make soak`."""

import os

THOROUGH = "ASGLIGHT_THOROUGH"
"""Variable of the environment that asks for all; tests that heed it are marked `thorough`."""


def is_thorough() -> bool:
    """Tell whether all is asked for."""
    return bool(os.environ.get(THOROUGH))


def tries(count: int) -> int:
    """Return how many of `count` examples to try."""
    return count if is_thorough() else max(10, count // 5)
