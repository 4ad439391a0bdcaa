# SPDX-License-Identifier: Apache-2.0
"""Lobes for real-time engines: tracks as JSON, surfaces under them as a GLSL include."""

from asglight.export.environment import write_glsl
from asglight.export.track_file import read_json, write_json

__all__ = ["read_json", "write_glsl", "write_json"]
