# SPDX-License-Identifier: Apache-2.0
"""What a process of `apart.Apart` does to be tested: takes memory, prints, and fails."""

import os
from typing import Any

from asglight.images.decoding.apart_child import Channel, allow_memory


def handle(request: dict[str, Any], channel: Channel) -> None:
    """Print what is to be printed; else take 100 MB and then 3 GB."""
    if "print" in request:
        for descriptor in (1, 2):
            os.write(descriptor, request["print"].encode())
        channel.tell({"printed": True})
        return
    allow_memory(256 * 2**20)
    channel.tell({"got": [_can_have(100 * 2**20), _can_have(3 * 2**30)]})


def _can_have(size: int) -> bool:
    try:
        bytearray(size)
    except MemoryError:
        return False
    return True
