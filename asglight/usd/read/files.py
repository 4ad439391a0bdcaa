# SPDX-License-Identifier: Apache-2.0
"""The files that a stage is made of."""

from collections.abc import Iterator
from pathlib import Path

from pxr import UsdUtils

from asglight.usd.check.references import may_open
from asglight.usd.stage import open_stage, readable


def files_of(path: Path) -> Iterator[Path]:
    """Yield the layers of a stage and the files that they name, in variants that are off, too.

    Raises:
        InputError: It cannot be read.
    """
    with readable(path):
        stage = open_stage(path)  # kept: its layers die with it
        for layer in stage.GetUsedLayers():
            if not layer.realPath:
                continue
            yield Path(layer.realPath)
            for names in UsdUtils.ExtractExternalReferences(layer.realPath):
                for name in names:
                    file = layer.ComputeAbsolutePath(name)
                    if file and may_open(path, file):
                        yield Path(file)
