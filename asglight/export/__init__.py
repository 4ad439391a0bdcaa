# SPDX-License-Identifier: Apache-2.0
"""Lobes for other programs: tracks as JSON, glTF, SG arrays, surfaces under them as GLSL."""

from asglight.export.environment import write_glsl
from asglight.export.gltf import write_gltf
from asglight.export.sg_array import SgLayout, read_sg_array, write_sg_array
from asglight.export.track_file import read_json, write_json

__all__ = [
    "SgLayout",
    "read_json",
    "read_sg_array",
    "write_glsl",
    "write_gltf",
    "write_json",
    "write_sg_array",
]
