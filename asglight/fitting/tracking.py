# SPDX-License-Identifier: Apache-2.0
"""Drawing lobes after lamps that moved further than their own width.

A gradient sees no lamp beyond the lobe's own reach: a sun of one texel that has moved by two is
gone from it. One step of expectation-maximisation does: each lobe takes of every leaf's flux the
share that it has of the radiance there, and goes to the mean and the in-plane covariance of what it
took [Banerjee et al. 2005 for isotropic lobes]. What no narrow lobe claims falls to the nearest
that reaches that far, so two lamps keep two lobes.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting import lobe_images, objective
from asglight.fitting.seeding import sharpness_from_variance
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import parallel_transport

TAKEN_MIN = 1e-6
"""Flux, in mean radiances of the map, from which a lobe that took it moves."""


def drawn(lobes: Lobes, frame: objective.Target, width_min: float) -> Lobes:
    """Take one step of expectation-maximisation.

    Args:
        lobes: Lobes in the exposure of the frame.  [F, N, .]
        frame: The maps.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    places = frame.places
    shown = lobe_images.images(lobes, places)
    own = shown.light.sum(-1, keepdim=True) * shown.values  # [F, N, P]
    taken = own / own.sum(1, keepdim=True).clamp(min=torch.finfo(own.dtype).tiny)
    flux = taken * (frame.radiance.sum(1) * places.share)[:, None]
    total = flux.sum(-1)
    moments = sum(
        flux[..., place] @ monomials[..., 1:, :].mT for _, monomials, place in places.levels
    ) / total[..., None].clamp(min=TAKEN_MIN)
    moments = torch.as_tensor(moments)
    length = moments[..., :3].norm(dim=-1)
    moved = (total > TAKEN_MIN) & (length > 1e-3)  # a mean of all directions is none
    axis_z = moments[..., :3] / length[..., None].clamp(min=1e-3)
    axes = parallel_transport(lobes.axes, torch.where(moved[..., None], axis_z, lobes.axis_z))
    second = moments[..., 3:][..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].unflatten(-1, (3, 3))
    variance, turn = _in_plane(axes[..., :2, :] @ second @ axes[..., :2, :].mT, lobes.form)
    axes = torch.cat([turn @ axes[..., :2, :], axes[..., 2:, :]], dim=-2)
    sharpness = sharpness_from_variance(variance.clamp(min=width_min**2), lobes.form)
    moved_lobes = replace(
        lobes,
        axes=torch.where(moved[..., None, None], axes, lobes.axes),
        sharpness=torch.where(moved[..., None], sharpness, lobes.sharpness),
    )
    light = 4 * math.pi * (taken * places.share[:, None]) @ frame.radiance.mT  # flux  [F, N, 3]
    amplitude = light / asg.integral(moved_lobes)[..., None]
    return replace(moved_lobes, amplitude=amplitude)


def _in_plane(covariance: Tensor, form: Form) -> tuple[Tensor, Tensor]:
    """Return the variances [..., 2] and the rotation to their axes [..., 2, 2].

    x stays nearest to where it was.
    """
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    middle, half = (xx + yy) / 2, (xx - yy) / 2
    if form is Form.SG:
        identity = torch.eye(2, dtype=xx.dtype, device=xx.device).expand(*xx.shape, 2, 2)
        return torch.stack([middle, middle], dim=-1), identity
    radius = (half * half + xy * xy).sqrt() * torch.where(half < 0, -1.0, 1.0)
    angle = 0.5 * torch.atan(xy / torch.where(half == 0, torch.finfo(xy.dtype).tiny, half))
    sin, cos = angle.sin(), angle.cos()
    turn = torch.stack([cos, sin, -sin, cos], dim=-1).unflatten(-1, (2, 2))
    return torch.stack([middle + radius, middle - radius], dim=-1), turn
