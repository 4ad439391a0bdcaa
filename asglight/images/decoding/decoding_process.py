# SPDX-License-Identifier: Apache-2.0
"""What the process that decodes images does: headers, and pixels in strips (decoders.py)."""

import dataclasses
import os
from pathlib import Path
from typing import Any

from asglight.images.decoding.apart_child import Channel, allow_memory
from asglight.images.decoding.decode import Header, read_header, unreadable
from asglight.images.decoding.layers import Layer
from asglight.images.decoding.strips import read_strips

SLOTS = 2
"""Strips in the shared memory: while one is repaired and reduced, the next is decoded."""

MEMORY_FACTOR = 4
"""Times the declared size of the image, with all its channels, that decoding may take."""

MEMORY_FREE = 256 * 2**20
"""Bytes that it may take besides: the header, two strips of the largest image, tables."""


def handle(request: dict[str, Any], channel: Channel) -> None:
    """Answer `{path, layer, folder}` with the header, `{header, slot, folder}` with the pixels.

    A slot is the size of a strip in bytes; strips lie in the shared memory, in turn at 0 and after
    one slot. Each is told by its shape, and after the last one none. The first SLOTS are written at
    once, each later one when a request says that a slot is free.
    """
    if "folder" in request:  # this process may have been started in another one
        os.chdir(request["folder"])
    if "path" in request:
        allow_memory(MEMORY_FREE)
        header = read_header(Path(request["path"]), request["layer"])
        channel.tell({"header": to_json(header)})
    elif "header" in request:  # else a slot that became free when there was nothing left to write
        header = from_json(request["header"])
        allow_memory(MEMORY_FREE + MEMORY_FACTOR * header.stored_bytes)
        _tell_strips(header, channel, request["slot"])
        channel.tell({"shape": None})


def to_json(header: Header) -> dict[str, Any]:
    """Return a header as JSON values."""
    return dataclasses.asdict(header) | {"path": str(header.path)}


def from_json(values: dict[str, Any]) -> Header:
    """Return the header that `to_json` made JSON values of."""
    layer, chromaticities = values["layer"], values["chromaticities"]
    return Header(
        **values
        | {
            "path": Path(values["path"]),
            "layer": Layer(**layer | {"channels": tuple(layer["channels"])}),
            "axes": tuple(values["axes"]),
            "chromaticities": None if chromaticities is None else tuple(chromaticities),
        }
    )


def _tell_strips(header: Header, channel: Channel, slot: int) -> None:
    memory = channel.memory(SLOTS * slot)
    for number, strip in enumerate(read_strips(header)):
        if number >= SLOTS and channel.next_request() is None:
            return
        if strip.nbytes > slot:
            raise unreadable(header.path, "it changed while it was read")
        place = number % SLOTS * slot
        memory[place : place + strip.nbytes] = strip.data.cast("B")
        channel.tell({"shape": strip.shape})
