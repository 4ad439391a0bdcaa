# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks as time-sampled USD lights: write, read, check.

The names load pxr when they are first used, so that options can be checked without it.
"""

import importlib
from typing import TYPE_CHECKING, Any

from asglight.usd.options import STAGE_SUFFIXES, Representation, StageOptions, check_stage_options

if TYPE_CHECKING:
    from asglight.usd.edit_layer import write_edit_layer
    from asglight.usd.lint import lint_stage
    from asglight.usd.read import Reading, read_stage, read_usd
    from asglight.usd.schema import SCHEMA_FOLDER
    from asglight.usd.staging import WriteReport
    from asglight.usd.write import write_usd

__all__ = [
    "SCHEMA_FOLDER",
    "STAGE_SUFFIXES",
    "Reading",
    "Representation",
    "StageOptions",
    "WriteReport",
    "check_stage_options",
    "lint_stage",
    "read_stage",
    "read_usd",
    "write_edit_layer",
    "write_usd",
]

_HOME = {
    "SCHEMA_FOLDER": "schema",
    "WriteReport": "staging",
    "lint_stage": "lint",
    "Reading": "read",
    "read_stage": "read",
    "read_usd": "read",
    "write_edit_layer": "edit_layer",
    "write_usd": "write",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its file."""
    if name not in _HOME:
        raise AttributeError(f"module 'asglight.usd' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"asglight.usd.{_HOME[name]}"), name)
    globals()[name] = value
    return value
