# SPDX-License-Identifier: Apache-2.0
"""Whether the machine that `fit.py` runs on is its own."""

import sys
from typing import Any

BUSY_LOAD = 0.5
"""Load for each core above which others are at work: one core of two."""


def warn_where_busy(at: dict[str, Any]) -> None:
    """Say so where other programs run: two threads of which one must wait run at a crawl."""
    if at["load"] > BUSY_LOAD * at["cores"]:
        print(
            f"bench-fit: load {at['load']} on {at['cores']} cores: times will be too long. Wait, "
            "or give --threads 1.",
            file=sys.stderr,
        )
