# SPDX-License-Identifier: Apache-2.0
"""The method of Clausen et al. 2024, "Fitting Spherical Gaussians to Dynamic HDRI Sequences".

Loss per texel, w the solid angle:  L = w (alpha L_R + beta L_D) + gamma L_T,  with
    L_R  L1 error of the radiance,
    L_D  L1 error of the Lambertian light map made from degree-3 spherical harmonics,
    L_T  sum over lobes i of || (g_i[t] - g_i[t-1]) / max_i g_i[t-1] ||_2 over the lobe's
         sharpnesses, x axis, z axis and amplitude g,
alpha = beta = 1, gamma = 0.5. Adam takes 24,000 steps for the first frame and 6,000 for each next
one, which starts from the frame before. 15 lobes on 256 x 512 texels.

The poster leaves open, and this file chooses:
    start             axes on a Fibonacci sphere turned at random by the seed, both sharpnesses
                      4 N / 15 (neighbouring lobes just overlap), amplitude the mean radiance over
                      N / 4
    parameters        quaternion, log sharpness, log amplitude: positive without clamping
    Adam              learning rate 1e-2 falling to 0 along a half cosine, torch's other defaults
    units             L_R and L_D are divided by the flux of the reference, so that the loss does
                      not depend on exposure and gamma weighs the same in every scene; the other
                      losses that the paper compares are in losses.py
    light map         irradiance over pi
    max_i             of the absolute value, over the lobes and the components of a vector together
    lobe function     `asg` unless the caller asks for another form; the poster's formula, read
                      with squared dot products, is `bingham`
"""

import math
from collections.abc import Callable

import torch
from torch import Tensor

from asglight.fitting.paper.losses import Loss, frame_loss, target
from asglight.lobes import Form, Lobes
from asglight.lobes.frames import axes_around, axes_from_quaternion, quaternion_from_axes
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

GAMMA = 0.5
FIRST_FRAME_STEPS, NEXT_FRAME_STEPS = 24_000, 6_000
HEIGHT = 256
LEARNING_RATE = 1e-2
AMPLITUDE_FLOOR = 1e-12
"""Relative to the mean radiance: keeps the logarithm of a black lobe's amplitude finite."""


def temporal_loss(lobes: Lobes, previous: Lobes) -> Tensor:
    """Return L_T: how far the lobes went from the previous frame's."""
    changes: list[Tensor] = []
    for now, before in zip(_components(lobes), _components(previous), strict=True):
        changes.append((now - before) / before.abs().max().clamp(min=1e-20))
    # the root has no derivative at 0, where every next frame starts
    return (torch.cat(changes, dim=-1).square().sum(-1) + 1e-16).sqrt().sum()


def start(reference: Tensor, count: int, form: Form, seed: int) -> Lobes:
    """Return the lobes that the first frame starts from.  [N, .]."""
    generator = torch.Generator().manual_seed(seed)
    turn = axes_from_quaternion(torch.randn(4, generator=generator, dtype=torch.float64))
    axis_z = (fibonacci_directions(count, dtype=torch.float64) @ turn).to(reference)
    height, width, _ = reference.shape
    weight = latlong.texel_solid_angles(height, width, device=reference.device)[..., None]
    mean = (weight * reference).sum((0, 1)) / (4 * math.pi)
    sharpness = torch.full((count, 2), 4 * count / 15).to(reference)
    return Lobes(axes_around(axis_z), sharpness, (mean * 4 / count).expand(count, 3), form)


def fit_frame(
    reference: Tensor,
    lobes: Lobes,
    *,
    steps: int,
    previous: Lobes | None = None,
    loss: Loss = Loss.L1_LD,
    on_step: Callable[[int, float], None] | None = None,
) -> Lobes:
    """Fit one frame with Adam.

    Args:
        reference: Repaired radiance.  [H, W, 3]
        lobes: Where to start.  [N, .]
        steps: Adam steps.
        previous: The frame before; None leaves the temporal term out.
        loss: What is minimised beside it.
        on_step: Called with the step's number and its loss. Reading the loss waits for the device.

    Returns:
        The lobes after the last step.  [N, .]
    """
    frame = target(reference)
    floor = AMPLITUDE_FLOOR * max(float(reference.mean()), torch.finfo(torch.float32).tiny)
    raw = [
        quaternion_from_axes(lobes.axes),
        lobes.sharpness.log(),
        lobes.amplitude.clamp(min=floor).log(),
    ]
    raw = [value.detach().clone().requires_grad_(True) for value in raw]
    optimiser = torch.optim.Adam(raw, lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        optimiser.zero_grad()
        current = _lobes(raw, lobes.form)
        error = frame_loss(current, frame, loss)
        if previous is not None:
            error = error + GAMMA * temporal_loss(current, previous)
        error.backward()
        optimiser.step()
        schedule.step()
        if on_step is not None:
            on_step(step + 1, float(error.detach()))
    return _lobes([value.detach() for value in raw], lobes.form)


def _lobes(raw: list[Tensor], form: Form) -> Lobes:
    quaternion, log_sharpness, log_amplitude = raw
    sharpness = log_sharpness.exp()
    if form is Form.SG:  # one sharpness: the second is a copy of the first
        sharpness = sharpness[..., :1].expand(-1, 2)
    return Lobes(axes_from_quaternion(quaternion), sharpness, log_amplitude.exp(), form)


def _components(lobes: Lobes) -> tuple[Tensor, ...]:
    """Return g of every lobe, one tensor for each quantity with a scale of its own.  [N, .]."""
    first, second = lobes.sharpness.split(1, dim=-1)
    return first, second, lobes.axis_x, lobes.axis_z, lobes.amplitude
