# SPDX-License-Identifier: Apache-2.0
"""Tiny sequences on disk."""

from pathlib import Path

import numpy as np
import OpenEXR


def sky(frame: int, height: int = 8) -> np.ndarray:
    """Return an even sky with one lamp that moves a column a frame.  [H, 2 H, 3]."""
    values = np.full((height, 2 * height, 3), 0.1, dtype=np.float32)
    values[height // 3, frame % (2 * height)] = (9.0, 6.0, 3.0)
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
