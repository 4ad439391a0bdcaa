# SPDX-License-Identifier: Apache-2.0
"""Settings and records for the tests of shots."""

import torch

from asglight.fitting.options import FitOptions
from asglight.images import Repair
from asglight.lobes import Form, Lobes
from asglight.shots.kept.records import FrameRecord

OPTIONS = FitOptions(lobes=2)


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
