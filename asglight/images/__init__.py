# SPDX-License-Identifier: Apache-2.0
"""Latlong images and image sequences: reading, repairing, writing.

Everything that enters asglight as pixels passes through here and leaves as radiance: linear,
Rec.709, [H, W, 3], row 0 = +Y, without negative or non-finite texels, and with a record of what
was changed on the way.

The names load what they need when they are first used: the process that decodes needs no torch.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asglight.images.exr_writer import write_exr
    from asglight.images.latlong_image import LatlongImage, read_latlong
    from asglight.images.repair import Repair
    from asglight.images.sequence import Sequence, open_sequence

__all__ = [
    "LatlongImage",
    "Repair",
    "Sequence",
    "open_sequence",
    "read_latlong",
    "write_exr",
]

_HOME = {
    "LatlongImage": "latlong_image",
    "Repair": "repair",
    "Sequence": "sequence",
    "open_sequence": "sequence",
    "read_latlong": "latlong_image",
    "write_exr": "exr_writer",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its file."""
    if name not in _HOME:
        raise AttributeError(f"module 'asglight.images' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"asglight.images.{_HOME[name]}"), name)
    globals()[name] = value
    return value
