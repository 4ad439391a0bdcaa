# SPDX-License-Identifier: Apache-2.0
"""Tiny sequences on disk."""

from pathlib import Path

import numpy as np
import OpenEXR


def sky(frame: int, height: int = 8) -> np.ndarray:
    """Return an even sky with one lamp that moves a quarter of a column a frame.  [H, 2 H, 3].

    A lamp that jumped by a column, here 22 degrees, would have each frame fitted from the start.
    """
    values = np.full((height, 2 * height, 3), 0.1, dtype=np.float32)
    column, quarters = divmod(frame, 4)
    for place, share in ((column, 1 - quarters / 4), (column + 1, quarters / 4)):
        values[height // 3, place % (2 * height)] += share * np.float32([8.9, 5.9, 2.9])
    return values


def write_frame(path: Path, values: np.ndarray) -> Path:
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": values}).write(str(path))
    return path


def write_sequence(folder: Path, frames: range = range(1001, 1005)) -> Path:
    """Write `sky.####.exr` into a new folder and return the folder."""
    folder.mkdir()
    for frame in frames:
        write_frame(folder / f"sky.{frame}.exr", sky(frame))
    return folder
