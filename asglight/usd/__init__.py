# SPDX-License-Identifier: Apache-2.0
"""Lobe tracks as time-sampled USD lights: write, read, check."""

from asglight.usd.edit_layer import write_edit_layer
from asglight.usd.lint import lint_stage
from asglight.usd.read import read_usd
from asglight.usd.schema import SCHEMA_FOLDER, Representation
from asglight.usd.staging import WriteReport
from asglight.usd.write import write_usd

__all__ = [
    "SCHEMA_FOLDER",
    "Representation",
    "WriteReport",
    "lint_stage",
    "read_usd",
    "write_edit_layer",
    "write_usd",
]
