# SPDX-License-Identifier: Apache-2.0
"""A layer that lies over a stage: how it names the stage, and what it has to say again."""

import os
from pathlib import Path

from pxr import Sdf

STAGE_KEYS = (
    "defaultPrim",
    "upAxis",
    "metersPerUnit",
    "timeCodesPerSecond",
    "framesPerSecond",
    "startTimeCode",
    "endTimeCode",
)
"""Metadata that USD does not compose from sublayers."""


def with_metadata(root: Sdf.Layer) -> Sdf.Layer:
    """Return a new layer with the metadata of a stage's root layer."""
    built = Sdf.Layer.CreateAnonymous(".usda")
    for key in STAGE_KEYS:
        if root.pseudoRoot.HasInfo(key):
            built.pseudoRoot.SetInfo(key, root.pseudoRoot.GetInfo(key))
    return built


def reference(source: Path, folder: Path) -> str:
    """Return how a layer in a folder names the stage below it."""
    absolute = os.path.abspath(source)
    try:
        relative = Path(os.path.relpath(absolute, os.path.abspath(folder))).as_posix()
    except ValueError:  # another drive of Windows
        return Path(absolute).as_posix()
    return relative if relative.startswith("../") else f"./{relative}"
