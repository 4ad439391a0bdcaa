# SPDX-License-Identifier: Apache-2.0
"""Isotropic lobes by plain gradient descent, as inverse renderers fit their lights.

[Zhang, Luan, Wang, Bala and Snavely 2021, "PhySG: inverse rendering with spherical Gaussians for
physics-based material editing and relighting", CVPR]: what its public fitting script does. Axis,
sharpness and amplitude start at random (normal, the sharpness times 100) and are used by
direction and absolute value; Adam with a learning rate of 1e-2 takes 100,000 steps on the mean
squared error over the texels of 256 x 512, without solid angles.

Departures: texel centres instead of a grid with rows on the poles and the seam twice, and the same
sum as one matrix product. An amplitude moves by about 0.01 a step, so a sun of 30,000 is out of
reach; the script's own map is clamped. Here no map is.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes
from asglight.lobes.frames import axes_around
from asglight.peers.approximation import LOBE_FLOATS, LobeSum, free_lobes
from asglight.sphere import latlong

STEPS = 100_000
LEARNING_RATE = 1e-2
SHARPNESS_START = 100.0


def fit(
    reference: Tensor,
    floats: int,
    *,
    steps: int,
    on_step: Callable[[int], None] | None = None,
) -> LobeSum:
    """Fit as many lobes as the budget holds.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        floats: Budget, 6 or more.
        steps: Adam steps.
        on_step: Called with the number of each step when it is done.
    """
    height, width, _ = reference.shape
    directions = latlong.directions(height, width).reshape(-1, 3)
    wanted = reference.reshape(-1, 3)
    generator = torch.Generator().manual_seed(0)
    raw = torch.randn(floats // LOBE_FLOATS[Form.SG], 7, generator=generator)
    raw[:, 3] *= SHARPNESS_START
    raw.requires_grad_(True)
    optimiser = torch.optim.Adam([raw], lr=LEARNING_RATE)
    for step in range(steps):
        optimiser.zero_grad()
        axis_z, sharpness, amplitude = _used(raw)
        values = torch.exp(sharpness * (axis_z @ directions.mT - 1))  # [N, P]
        loss = (values.mT @ amplitude - wanted).square().mean()
        loss.backward()
        optimiser.step()
        if on_step is not None:
            on_step(step + 1)
    axis_z, sharpness, amplitude = _used(raw.detach())
    both = sharpness.expand(-1, 2).contiguous()
    return free_lobes(Lobes(axes_around(axis_z), both, amplitude, Form.SG))


def _used(raw: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return axes [N, 3], sharpness [N, 1] and amplitude [N, 3] of the parameters [N, 7]."""
    axis_z = torch.nn.functional.normalize(raw[:, :3], dim=-1)
    return axis_z, raw[:, 3:4].abs(), raw[:, 4:].abs()
