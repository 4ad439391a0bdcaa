# SPDX-License-Identifier: Apache-2.0
"""Lobes and maps that the fitting tests share."""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import FrameFit
from asglight.fitting.loss import objective
from asglight.fitting.loss.adaptive_cells import adaptive_cells
from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import StepCallback, fit_frame
from asglight.lobes import Form, Lobes, texels
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around, axes_from_quaternion

DOUBLE = torch.float64


def random_lobes(form: Form, count: int = 5, seed: int = 0) -> Lobes:
    """Return lobes of all widths, the first near-round, in float64."""
    generator = torch.Generator().manual_seed(seed)
    axes = axes_from_quaternion(torch.randn(count, 4, generator=generator, dtype=DOUBLE))
    sharpness = 10 ** (2 * torch.rand(count, 2, generator=generator, dtype=DOUBLE))
    sharpness[0, 1] = 1.2 * sharpness[0, 0]
    if form is Form.SG:
        sharpness[:, 1] = sharpness[:, 0]
    amplitude = 0.2 + torch.rand(count, 3, generator=generator, dtype=DOUBLE)
    return Lobes(axes, sharpness, amplitude, form)


def lamps(
    directions: list[tuple[float, float, float]], sharpness: list[float], light: list[float]
) -> Lobes:
    """Return round grey asg lobes."""
    axis_z = torch.nn.functional.normalize(torch.tensor(directions).float(), dim=-1)
    grey = torch.tensor(light)[:, None].expand(-1, 3).contiguous()
    return Lobes(axes_around(axis_z), torch.tensor(sharpness)[:, None].expand(-1, 2), grey)


def sky_and_sun(sun_degrees: float, height: int = 64) -> Tensor:
    """Return a broad sky with a narrow sun at a longitude, 30 degrees high.  [H, 2 H, 3]."""
    angle = math.radians(sun_degrees)
    cos, sin = math.cos(math.radians(30)), math.sin(math.radians(30))
    sun = (cos * math.sin(angle), sin, cos * math.cos(angle))
    scene = lamps([(0.0, 1.0, 0.1), sun], [1.0, 4000.0], [1.0, 3000.0])
    return texels.texel_means(scene, height, 2 * height)


def flat(maps: Tensor) -> Tensor:
    """Go to channels first.  [F, H, W, 3] -> [F, 3, P]."""
    return maps.flatten(1, 2).mT.contiguous()


def noise(height: int = 32, count: int = 1) -> Tensor:
    """Return maps of noise with a few bright texels.  [F, 3, P]."""
    generator = torch.Generator().manual_seed(0)
    return flat(5 * torch.rand(count, height, 2 * height, 3, generator=generator) ** 4)


def target(maps: Tensor, rows: int = 64, refined: int = 0) -> objective.Target:
    """Return the target of maps on so many adaptive cells.  [F, 3, P]."""
    return objective.target(maps, places=adaptive_cells(maps, rows, refined))


def shown(lobes: Lobes, height: int) -> objective.Target:
    """Return the target of one frame's lobes, averaged over texels."""
    return objective.target(flat(texels.texel_means(lobes, height, 2 * height).float()[None]))


def follow(
    references: list[Tensor], options: FitOptions, on_step: StepCallback | None = None
) -> list[FrameFit]:
    """Fit frames in order, each from the one before."""
    options = replace(options, moving=True)
    fits: list[FrameFit] = []
    for reference in references:
        previous = fits[-1].lobes if fits else None
        earlier = fits[-2].lobes if len(fits) > 1 else None
        fits.append(fit_frame(reference, options, previous, earlier, on_step))
    return fits


def angle_deg(a: Tensor, b: Tensor) -> float:
    return math.degrees(float(torch.arccos((a * b).sum().clamp(-1, 1))))


KNOWN = lamps([(0, 1, 0.2), (1, 0.2, 0), (-0.5, 0.3, -1)], [2.0, 30.0, 90.0], [1.0, 8.0, 5.0])
"""A wide, a narrow and a very narrow lobe, apart."""


def alike(form: Form, count: int = 5, seeds: tuple[int, ...] = (0,)) -> Lobes:
    """Return random lobes of a frame for each seed, in float32.  [F, N, .]."""
    return stack([random_lobes(form, count, seed) for seed in seeds]).to(torch.float32)
