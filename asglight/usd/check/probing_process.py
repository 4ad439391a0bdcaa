# SPDX-License-Identifier: Apache-2.0
"""What the process that tries out layers does (references.py): opens one and unpacks all it holds.

USD reads binary layers with code that a damaged file makes loop or take all memory, and it reads a
value when somebody asks for it. Writing a copy asks for every value.
"""

import dataclasses
import os
import tempfile
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from asglight.images.decoding.apart_child import Channel, allow_memory
from asglight.images.message import compressed
from asglight.usd.check.layer_facts import facts_of
from asglight.usd.faults import reason

MEMORY_FACTOR = 64
"""Times the size of the file that reading it may take. asglight's own binary stages take three to
ten times theirs."""

MEMORY_FREE = 32 * 2**20
"""Bytes that it may take besides: what USD loads with its first layer takes 18 MB."""


def handle(request: dict[str, Any], channel: Channel) -> None:
    """Answer `{layer, bytes, folder}` with `LayerFacts`, or with why USD cannot read the layer."""
    os.chdir(request["folder"])
    allow_memory(MEMORY_FREE + MEMORY_FACTOR * request["bytes"])
    with tempfile.TemporaryFile() as heard:
        # USD goes on after some kinds of damage, and says so on standard error only.
        before = os.dup(2)
        os.dup2(heard.fileno(), 2)
        answer = _tried(request["layer"])
        os.dup2(before, 2)
        os.close(before)
        heard.seek(0)
        said = heard.read(4096).decode(errors="replace").strip()
    channel.tell({"unreadable": compressed(said)} if said else answer)


def _tried(path: str) -> dict[str, Any]:
    try:
        layer = Sdf.Layer.FindOrOpen(path)
        if layer is None:
            return {"unreadable": "of no known kind"}
        with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
            layer.Export(str(Path(folder) / "copy.usdc"))
        return dataclasses.asdict(facts_of(layer))
    except Tf.ErrorException as error:
        return {"unreadable": reason(error)}
    except (UnicodeDecodeError, MemoryError) as error:
        return {"unreadable": type(error).__name__}
