# SPDX-License-Identifier: Apache-2.0
"""Lobes and maps of the stress cases. Angles are in degrees, as a person places a lamp.

Longitude 0 is the middle of a map, 90 a quarter from its left edge, 180 its seam.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, texels
from asglight.lobes.frames import axes_around

ROWS = 64
"""Of a map whose subject needs no more: 128 x 64 texels of 2.8 degrees."""

Direction = tuple[float, float, float]
SUN: Direction = (0.55666, 0.5, 0.66341)
"""30 degrees high, at longitude 40."""


def toward(longitude_deg: float, latitude_deg: float) -> Direction:
    """Return the unit direction of a place on the map."""
    longitude, latitude = math.radians(longitude_deg), math.radians(latitude_deg)
    level = math.cos(latitude)
    return level * math.sin(longitude), math.sin(latitude), level * math.cos(longitude)


def lobe(
    direction: Direction,
    sharpness: float | tuple[float, float],
    amplitude: float | tuple[float, float, float] = 1.0,
    *,
    form: Form = Form.ASG,
    turn_deg: float = 0.0,
) -> Lobes:
    """Return one lobe in float64.  [1, .].

    Args:
        direction: Of the light, of any length.
        sharpness: Along x and y, or the same along both.
        amplitude: RGB, or grey.
        form: Lobe function.
        turn_deg: Of the frame about the light's direction.
    """
    axes = axes_around(
        torch.nn.functional.normalize(torch.tensor([direction], dtype=torch.float64), dim=-1)
    )
    cos, sin = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    turn = torch.tensor([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    both = sharpness if isinstance(sharpness, tuple) else (sharpness, sharpness)
    rgb = amplitude if isinstance(amplitude, tuple) else (amplitude,) * 3
    return Lobes(
        turn @ axes,
        torch.tensor([both], dtype=torch.float64),
        torch.tensor([rgb], dtype=torch.float64),
        form,
    )


def together(*parts: Lobes) -> Lobes:
    """Return lobes of one form as one set.  [N, .]."""
    return Lobes(
        torch.cat([part.axes for part in parts]),
        torch.cat([part.sharpness for part in parts]),
        torch.cat([part.amplitude for part in parts]),
        parts[0].form,
    )


def render(lobes: Lobes, rows: int = ROWS) -> Tensor:
    """Return the mean of lobes over each texel, computed in float64.  [H, 2 H, 3] float32."""
    return texels.texel_means(lobes, rows, 2 * rows).float()


def sun_and_sky(rows: int = ROWS) -> Tensor:
    """Return a blue sky with a warm sun of 0.6 degrees, half of the light.  [H, 2 H, 3]."""
    sky = lobe((0.0, 1.0, 0.1), 1.0, (0.3, 0.5, 1.0))
    return render(together(sky, lobe(SUN, 4e3, (3e3, 0.9 * 3e3, 0.7 * 3e3))), rows)


def constant(value: float, rows: int = ROWS) -> Tensor:
    """Return a map of one value.  [H, 2 H, 3]."""
    return torch.full((rows, 2 * rows, 3), value)


def texel(row: int, column: int, value: float, around: float = 0.0) -> Tensor:
    """Return a map with one other texel.  [H, 2 H, 3]."""
    radiance = constant(around)
    radiance[row, column] = value
    return radiance


def rectangle(
    latitude_deg: tuple[float, float],
    longitude_deg: tuple[float, float],
    value: float = 1.0,
    around: float = 0.0,
) -> Tensor:
    """Return a map with another value where texels lie between angles.  [H, 2 H, 3]."""
    latitude = 90 - 180 * (torch.arange(ROWS) + 0.5) / ROWS
    longitude = 180 - 360 * (torch.arange(2 * ROWS) + 0.5) / (2 * ROWS)
    high = (latitude > latitude_deg[0]) & (latitude < latitude_deg[1])
    wide = (longitude > longitude_deg[0]) & (longitude < longitude_deg[1])
    inside = (high[:, None] & wide)[..., None].expand(-1, -1, 3)
    return torch.where(inside, value, around)


def checkerboard(size: int) -> Tensor:
    """Return squares of so many texels, black and white.  [H, 2 H, 3]."""
    row, column = torch.arange(ROWS) // size, torch.arange(2 * ROWS) // size
    return ((row[:, None] + column) % 2).float()[..., None].expand(-1, -1, 3).contiguous()


def noise(power: float = 1.0, seed: int = 0) -> Tensor:
    """Return even noise from 0 to 1 to a power: the higher, the rarer are bright texels."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(ROWS, 2 * ROWS, 3, generator=generator) ** power


def panned(radiance: Tensor, degrees: float) -> Tensor:
    """Return a map as a camera sees it that panned about the vertical."""
    return torch.roll(radiance, round(degrees / 360 * radiance.shape[1]), 1)


def enlarged(radiance: Tensor, factor: int) -> Tensor:
    """Return a map with every texel as a square of them: the same light, finer."""
    return radiance.repeat_interleave(factor, 0).repeat_interleave(factor, 1)


def lamps(directions: Sequence[Direction], sharpness: float) -> Lobes:
    """Return equal lobes.  [N, .]."""
    return together(*(lobe(direction, sharpness) for direction in directions))
