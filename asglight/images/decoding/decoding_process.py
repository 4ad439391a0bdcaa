# SPDX-License-Identifier: Apache-2.0
"""What the process that decodes images does: headers, and pixels repaired and reduced."""

import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np

from asglight.images.decoding.apart_child import Channel, allow_memory
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.header import SLOTS, Header, from_json, row_bytes, slot_rows, to_json
from asglight.images.decoding.strips import reduced_strips
from asglight.images.options import ReadOptions

MEMORY_FACTOR = 4
"""Times the declared size of the image, with all its channels, that decoding may take."""

MEMORY_FREE = 256 * 2**20
"""Bytes that it may take besides: the header, two strips of the largest image, tables."""


def handle(request: dict[str, Any], channel: Channel) -> None:
    """Answer `{path, reading, folder}` by the header, `{header, height, folder}` by pixels.

    Rows of the result lie in the shared memory, as many as `slot_rows` says in a slot, in turn at 0
    and after one slot. Each slot is told by its number of rows, and after the last one what was
    repaired. The first SLOTS are written at once, each later one when a request says that a slot is
    free.
    """
    if "folder" in request:  # this process may have been started in another one
        os.chdir(request["folder"])
    if "path" in request:
        allow_memory(MEMORY_FREE)
        header = read_header(Path(request["path"]), ReadOptions(**request["reading"]))
        channel.tell({"header": to_json(header)})
    elif "header" in request:  # else a slot that became free when there was nothing left to write
        header = from_json(request["header"])
        allow_memory(MEMORY_FREE + MEMORY_FACTOR * header.stored_bytes)
        _tell_rows(header, request["height"], channel)


def _tell_rows(header: Header, height: int, channel: Channel) -> None:
    count = slot_rows(height)
    memory = channel.memory(SLOTS * count * row_bytes(height))
    values = SLOTS * count * 2 * height * 3  # the memory may be larger, from another height
    slots = np.frombuffer(memory, np.float32, values).reshape(SLOTS, count, 2 * height, 3)
    strips = reduced_strips(header, height, is_quiet=True)
    number = filled = 0
    while True:
        try:
            rows = next(strips)
        except StopIteration as end:
            tally = end.value
            break
        while len(rows):
            if filled == 0 and number >= SLOTS and channel.next_request() is None:
                return
            taken = rows[: count - filled]
            slots[number % SLOTS, filled : filled + len(taken)] = taken
            rows = rows[len(taken) :]
            filled += len(taken)
            if filled == count:
                channel.tell({"rows": filled})
                number, filled = number + 1, 0
    if filled:
        channel.tell({"rows": filled})
    channel.tell({"rows": 0, "tally": dataclasses.asdict(tally)})
