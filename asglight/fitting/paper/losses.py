# SPDX-License-Identifier: Apache-2.0
"""The loss of one frame in Clausen et al. 2024, and the five that the paper compares it with.

With f the fit, r the reference, w the solid angle, m the reference's mean radiance over sphere and
channels, and sums over texels and channels:

    L1          sum w |f - r| / sum w r
    L2          sum w (f - r)^2 / sum w r^2
    L2 of log   mean over the sphere of (log(1 + f / m) - log(1 + r / m))^2
    L2 of sRGB  the same of the sRGB curve of 0.18 f / m and 0.18 r / m
    L_D         L1 of the Lambertian light map made from degree-3 spherical harmonics

The poster leaves units open, and what a logarithm makes of black and an sRGB curve of light beyond
white. Here L1, L2 and L_D are 1 for a black fit (L_D nearly), so that L_D weighs alike beside both;
the logarithm's and the curve's unit is that of the reference, so that exposure changes nothing; and
the curve goes on beyond white, because what is clipped there has no slope and would keep any value.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.sphere import harmonics, latlong

ALPHA, BETA = 1.0, 1.0
"""Weights of the error of the radiance and of L_D."""

SH_DEGREE = 3
MIDDLE_GREY = 0.18
"""Of display white: where the mean radiance lies on the sRGB curve."""


class Loss(StrEnum):
    """What is minimised."""

    L1_LD = "L1 + L_D"
    """The published one."""
    L1 = "L1"
    L2_LD = "L2 + L_D"
    L2 = "L2"
    L2_LOG = "L2 of log"
    L2_SRGB = "L2 of sRGB"


@dataclass(frozen=True)
class Target:
    """One frame as the loss needs it.

    Attributes:
        radiance: Reference, flattened.  [P, 3]
        light_map: Its degree-3 irradiance over pi.  [P, 3]
        directions: Texel centres.  [P, 3]
        solid_angle: Steradians over the reference's flux.  [P, 1]
        harmonics: Real harmonics up to degree 3.  [P, 16]
        project: Harmonics times solid angle and Lambert's factors over pi.  [16, P]
    """

    radiance: Tensor
    light_map: Tensor
    directions: Tensor
    solid_angle: Tensor
    harmonics: Tensor
    project: Tensor


def target(reference: Tensor) -> Target:
    """Prepare the loss of one frame.  reference: [H, W, 3]."""
    height, width, _ = reference.shape
    like = {"device": reference.device, "dtype": reference.dtype}
    directions = latlong.directions(height, width, **like).reshape(-1, 3)
    solid_angle = latlong.texel_solid_angles(height, width, **like).reshape(-1, 1)
    radiance = reference.reshape(-1, 3)
    flux = (solid_angle * radiance).sum().clamp(min=torch.finfo(torch.float32).tiny)
    basis = harmonics.basis(SH_DEGREE, directions)
    factors = (harmonics.lambert_factors(SH_DEGREE) / math.pi).to(radiance)
    project = (basis * solid_angle * factors).mT.contiguous()
    light_map = basis @ (project @ radiance)
    return Target(radiance, light_map, directions, solid_angle / flux, basis, project)


def frame_loss(lobes: Lobes, frame: Target, loss: Loss = Loss.L1_LD) -> Tensor:
    """Return what is minimised in one frame, without its temporal term."""
    fit = asg.evaluate(lobes, frame.directions)  # [P, 3]
    error = ALPHA * RADIANCE_ERRORS[loss](fit, frame)
    return error + BETA * light_map_l1(fit, frame) if loss in WITH_LIGHT_MAP else error


def radiance_l1(fit: Tensor, frame: Target) -> Tensor:
    """Return L1, relative to the reference's flux.  fit: [P, 3]."""
    return (frame.solid_angle * (fit - frame.radiance).abs()).sum()


def radiance_l2(fit: Tensor, frame: Target) -> Tensor:
    """Return L2, relative to the reference's.  fit: [P, 3]."""
    squares = (frame.solid_angle * frame.radiance.square()).sum()
    return (frame.solid_angle * (fit - frame.radiance).square()).sum() / squares


def log_l2(fit: Tensor, frame: Target) -> Tensor:
    """Return the mean squared difference of log(1 + radiance / mean).  fit: [P, 3]."""
    mean = _mean_radiance(frame)
    return _mean_square((fit / mean).log1p() - (frame.radiance / mean).log1p(), frame)


def srgb_l2(fit: Tensor, frame: Target) -> Tensor:
    """Return the mean squared difference on the sRGB curve.  fit: [P, 3]."""
    scale = MIDDLE_GREY / _mean_radiance(frame)
    return _mean_square(srgb_curve(scale * fit) - srgb_curve(scale * frame.radiance), frame)


def light_map_l1(fit: Tensor, frame: Target) -> Tensor:
    """Return L_D, relative to the reference's flux.  fit: [P, 3]."""
    light_map = frame.harmonics @ (frame.project @ fit)
    return (frame.solid_angle * (light_map - frame.light_map).abs()).sum()


def srgb_curve(linear: Tensor) -> Tensor:
    """Return the curve of IEC 61966-2-1, continued beyond 1.  linear: >= 0.  [...]."""
    # the clamp keeps the root's slope, infinite at 0, out of what torch.where leaves aside
    power = 1.055 * linear.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(linear <= 0.0031308, 12.92 * linear, power)


RADIANCE_ERRORS: dict[Loss, Callable[[Tensor, Target], Tensor]] = {
    Loss.L1_LD: radiance_l1,
    Loss.L1: radiance_l1,
    Loss.L2_LD: radiance_l2,
    Loss.L2: radiance_l2,
    Loss.L2_LOG: log_l2,
    Loss.L2_SRGB: srgb_l2,
}
WITH_LIGHT_MAP = (Loss.L1_LD, Loss.L2_LD)


def _mean_radiance(frame: Target) -> Tensor:
    """Return the reference's mean over sphere and channels: the weights sum to 4 pi over flux."""
    return 1 / (3 * frame.solid_angle.sum())


def _mean_square(difference: Tensor, frame: Target) -> Tensor:
    weight = frame.solid_angle / frame.solid_angle.sum()
    return (weight * difference.square()).sum() / 3
