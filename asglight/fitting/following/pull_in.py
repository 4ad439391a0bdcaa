# SPDX-License-Identifier: Apache-2.0
"""Drawing lobes after lamps that moved further than their own width.

A gradient sees no lamp beyond the lobe's own reach: a sun of one texel that has moved by two is
gone from it. One step of expectation-maximisation does: each lobe takes of every adaptive cell's
flux the share that it has of the radiance there, and goes to the mean and the in-plane covariance
of what it took [Banerjee et al. 2005 for isotropic lobes]. What no narrow lobe claims falls to the
nearest that reaches that far, so two lamps keep two lobes.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.seeding import sharpness_from_variance
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.lobe_images import Images
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import parallel_transport

TAKEN_MIN = 1e-6
"""Flux, in mean radiances of the map, from which a lobe that took it moves."""

LOST_SHARE = 0.5
"""A lobe that takes less than this share of the flux it had has lost its lamp."""

REACH = math.radians(3.3)
"""Sigma with which it looks for it: three of these are as far as a lit lobe may go in a frame."""


def responsibilities(shown: Images) -> Tensor:
    """Return the share of each adaptive cell's radiance that each lobe claims.  [F, N, P]."""
    own = shown.light.sum(-1, keepdim=True) * shown.values
    return own / own.sum(1, keepdim=True).clamp(min=torch.finfo(own.dtype).tiny)


def pulled_in(lobes: Lobes, taken: Tensor, frame: objective.Target, width_min: float) -> Lobes:
    """Take one step of expectation-maximisation.

    Args:
        lobes: Lobes in the exposure of the frame.  [F, N, .]
        taken: Their `responsibilities`.  [F, N, P]
        frame: The maps.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    total, moments = _moments(taken, frame)
    axes = _turned(lobes, total, moments)
    second = moments[..., 3:][..., [0, 1, 2, 1, 3, 4, 2, 4, 5]].unflatten(-1, (3, 3))
    variance, turn = _in_plane(axes[..., :2, :] @ second @ axes[..., :2, :].mT, lobes.form)
    axes = torch.cat([turn @ axes[..., :2, :], axes[..., 2:, :]], dim=-2)
    sharpness = sharpness_from_variance(variance.clamp(min=width_min**2), lobes.form)
    moved = _moves(total, moments)
    moved_lobes = replace(
        lobes,
        axes=torch.where(moved[..., None, None], axes, lobes.axes),
        sharpness=torch.where(moved[..., None], sharpness, lobes.sharpness),
    )
    light = 4 * math.pi * (taken * frame.places.share[:, None]) @ frame.radiance.mT  # [F, N, 3]
    amplitude = light / asg.integral(moved_lobes)[..., None]
    return replace(moved_lobes, amplitude=amplitude)


def re_detected(lobes: Lobes, taken: Tensor, frame: objective.Target) -> Lobes | None:
    """Turn narrow lobes that lost their lamp to what they see with the width of `REACH`.

    A sun that moves by many of its widths is out of its lobe's sight, and the faint sky there would
    claim it.

    Args:
        lobes: Lobes in the exposure of the frame.  [F, N, .]
        taken: Their `responsibilities`.  [F, N, P]
        frame: The maps.

    Returns:
        The lobes, shapes as they were, or None where no lobe lost its lamp.
    """
    own = asg.flux(lobes)
    total, _ = _moments(taken, frame)
    factor = asg.per_variance(lobes.form)
    wide = torch.full_like(lobes.sharpness, 1 / (factor * REACH**2))
    lost = (total < LOST_SHARE * own.sum(-1) / (4 * math.pi)) & (lobes.sharpness > wide).all(-1)
    if not bool(lost.any()):
        return None
    seeking = replace(lobes, sharpness=torch.where(lost[..., None], wide, lobes.sharpness))
    amplitude = own / asg.integral(seeking)[..., None]
    seeking = replace(seeking, amplitude=torch.where(lost[..., None], amplitude, lobes.amplitude))
    sought = responsibilities(lobe_images.images(seeking, frame.places))
    axes = _turned(lobes, *_moments(sought, frame))
    return replace(lobes, axes=torch.where(lost[..., None, None], axes, lobes.axes))


def seen(lobes: Lobes, taken: Tensor, frame: objective.Target) -> tuple[Tensor, Tensor]:
    """Return the mean directions of what lobes took [F, N, 3], and its flux over 4 pi [F, N].

    Args:
        lobes: Lobes in the exposure of the frame.  [F, N, .]
        taken: Their `responsibilities`.  [F, N, P]
        frame: The maps.
    """
    total, moments = _moments(taken, frame)
    return _turned(lobes, total, moments)[..., 2, :], total


def _moments(taken: Tensor, frame: objective.Target) -> tuple[Tensor, Tensor]:
    """Return the flux that lobes take, over 4 pi [F, N], and its mean monomials [F, N, 9]."""
    places = frame.places
    flux = taken * (frame.radiance.sum(1) * places.share)[:, None]
    total = flux.sum(-1)
    moments = [flux[..., place] @ monomials[..., 1:, :].mT for _, monomials, place in places.levels]
    return total, torch.stack(moments).sum(0) / total[..., None].clamp(min=TAKEN_MIN)


def _moves(total: Tensor, moments: Tensor) -> Tensor:
    """Tell which lobes took light that has a mean direction: a mean of all is none.  [F, N]."""
    return (total > TAKEN_MIN) & (moments[..., :3].norm(dim=-1) > 1e-3)


def _turned(lobes: Lobes, total: Tensor, moments: Tensor) -> Tensor:
    """Return the lobes' axes turned to the mean direction of what they took.  [F, N, 3, 3]."""
    axis_z = moments[..., :3] / moments[..., :3].norm(dim=-1, keepdim=True).clamp(min=1e-3)
    moved = _moves(total, moments)[..., None]
    return parallel_transport(lobes.axes, torch.where(moved, axis_z, lobes.axis_z))


def _in_plane(covariance: Tensor, form: Form) -> tuple[Tensor, Tensor]:
    """Return the variances [..., 2] and the rotation to their axes [..., 2, 2].

    x stays nearest to where it was.
    """
    xx, yy, xy = covariance[..., 0, 0], covariance[..., 1, 1], covariance[..., 0, 1]
    middle, half = (xx + yy) / 2, (xx - yy) / 2
    if form is Form.SG:
        identity = torch.eye(2, dtype=xx.dtype, device=xx.device).expand(*xx.shape, 2, 2)
        return torch.stack([middle, middle], dim=-1), identity
    radius = (half * half + xy * xy).sqrt() * torch.where(half < 0, -1.0, 1.0).to(half)
    angle = 0.5 * torch.atan(xy / torch.where(half == 0, torch.finfo(xy.dtype).tiny, half))
    sin, cos = angle.sin(), angle.cos()
    turn = torch.stack([cos, sin, -sin, cos], dim=-1).unflatten(-1, (2, 2))
    return torch.stack([middle + radius, middle - radius], dim=-1), turn
