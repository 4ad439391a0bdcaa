# SPDX-License-Identifier: Apache-2.0
"""Round lobes on the horizon."""

from collections.abc import Sequence
from dataclasses import replace

import torch

from asglight.lobes import Lobes, asg
from asglight.lobes.frames import axes_around


def lobes_at(degrees: Sequence[float], light: Sequence[float], sharpness: Sequence[float]) -> Lobes:
    """Return round lobes on the horizon, each with a flux of light in every channel.  [N, .]."""
    angle = torch.deg2rad(torch.tensor(degrees, dtype=torch.float64))
    axis_z = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()], -1)
    shape = torch.tensor(sharpness, dtype=torch.float64)[:, None].expand(-1, 2)
    unit = Lobes(axes_around(axis_z), shape, torch.ones(len(degrees), 3, dtype=torch.float64))
    flux = torch.tensor(light, dtype=torch.float64)[:, None]
    return replace(unit, amplitude=(flux / asg.integral(unit)[:, None]).expand(-1, 3))
