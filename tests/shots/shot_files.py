# SPDX-License-Identifier: Apache-2.0
"""Tiny sequences, settings and records for the tests of shots."""

from pathlib import Path

import numpy as np
import OpenEXR
import torch

from asglight.fitting.options import FitOptions
from asglight.images import Repair
from asglight.lobes import Form, Lobes
from asglight.shots.records import FrameRecord

OPTIONS = FitOptions(lobes=2)


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


def lobes(seed: int = 0, count: int = 2) -> Lobes:
    generator = torch.Generator().manual_seed(seed)
    axes = torch.linalg.qr(torch.randn(count, 3, 3, generator=generator)).Q
    axes[..., 2, :] *= torch.linalg.det(axes).sign()[:, None]
    sharpness = torch.rand(count, 2, generator=generator) * 50 + 1
    return Lobes(axes, sharpness, torch.rand(count, 3, generator=generator), Form.ASG)


def record(frame: int, **changes: object) -> FrameRecord:
    values = {
        "frame": frame,
        "lobes": lobes(frame),
        "loss": 0.1 + 1 / 3,
        "flux_error": -1e-7,
        "repair": Repair(3, 1, 0.25, (4, 5), (1000, 1002)),
        "stamp": (1234, 1_700_000_000_123_456_789),
        "seconds": 0.5,
    }
    return FrameRecord(**(values | changes))
