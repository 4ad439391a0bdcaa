# SPDX-License-Identifier: Apache-2.0
"""Latlong images and image sequences: reading, repairing, writing.

Everything that enters asglight as pixels passes through here and leaves as radiance: linear,
Rec.709, [H, W, 3], row 0 = +Y, without negative or non-finite texels, and with a record of what
was changed on the way.
"""

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
