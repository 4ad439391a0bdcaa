# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks as time-sampled USD lights: write, read, check.

The names load what they need when they are first used: options can be checked without pxr, and the
process that tries out layers needs no torch.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asglight.usd.check.lint import lint_stage
    from asglight.usd.options import (
        STAGE_SUFFIXES,
        Representation,
        StageOptions,
        check_stage_options,
    )
    from asglight.usd.read.keys import Keys, read_keys
    from asglight.usd.read.tracks import Reading, read_stage, read_usd
    from asglight.usd.schema import SCHEMA_FOLDER
    from asglight.usd.write.edits.edit_layer import write_edit_layer
    from asglight.usd.write.edits.key_edits import write_key_edits
    from asglight.usd.write.representing import add_representations
    from asglight.usd.write.stage_file import write_usd
    from asglight.usd.write.staging import WriteReport

__all__ = [
    "SCHEMA_FOLDER",
    "STAGE_SUFFIXES",
    "Keys",
    "Reading",
    "Representation",
    "StageOptions",
    "WriteReport",
    "add_representations",
    "check_stage_options",
    "lint_stage",
    "read_keys",
    "read_stage",
    "read_usd",
    "write_edit_layer",
    "write_key_edits",
    "write_usd",
]

_HOME = {
    "Representation": "options",
    "STAGE_SUFFIXES": "options",
    "StageOptions": "options",
    "check_stage_options": "options",
    "SCHEMA_FOLDER": "schema",
    "WriteReport": "write.staging",
    "add_representations": "write.representing",
    "lint_stage": "check.lint",
    "Keys": "read.keys",
    "read_keys": "read.keys",
    "Reading": "read.tracks",
    "read_stage": "read.tracks",
    "read_usd": "read.tracks",
    "write_edit_layer": "write.edits.edit_layer",
    "write_key_edits": "write.edits.key_edits",
    "write_usd": "write.stage_file",
}


def __getattr__(name: str) -> Any:
    """Load a public name from its file."""
    if name not in _HOME:
        raise AttributeError(f"module 'asglight.usd' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"asglight.usd.{_HOME[name]}"), name)
    globals()[name] = value
    return value
