# SPDX-License-Identifier: Apache-2.0
"""Frames to fit, made up: lamps that go about under a sky, at any size."""

from pathlib import Path

import torch
from torch import Tensor

from asglight.images import write_exr
from asglight.sphere import latlong

LAMPS = ((20.0, 2.0, 900.0), (140.0, 4.0, 300.0), (230.0, 9.0, 60.0), (310.0, 1.0, 3000.0))
"""Longitude and radius in degrees, and radiance, of each; all 25 degrees high."""

DEGREES = 1.0
"""By which a lamp goes on from frame to frame."""

GRAIN = 0.2
"""Of the sky's radiance: a file of even tones would be decoded sooner than any that is shot."""


def frame_of(number: int, rows: int) -> Tensor:
    """Return a frame.  [H, 2 H, 3].

    Args:
        number: Of the frame, from 0.
        rows: H.
    """
    directions = latlong.directions(rows, 2 * rows)
    generator = torch.Generator().manual_seed(number)
    grain = 1 + GRAIN * torch.rand(rows, 2 * rows, 1, generator=generator)
    sky = (0.3 + 0.7 * directions[..., 1:2].clamp(min=0)) * torch.tensor([0.6, 0.8, 1.0]) * grain
    for longitude, radius, radiance in LAMPS:
        angle = torch.deg2rad(torch.tensor(longitude + DEGREES * number))
        high = torch.deg2rad(torch.tensor(25.0))
        lamp = torch.stack([high.cos() * angle.sin(), high.sin(), high.cos() * angle.cos()])
        beside = 1 - directions @ lamp
        sharp = 1 / (1 - torch.deg2rad(torch.tensor(radius)).cos())
        sky = sky + radiance * torch.exp(-sharp * beside)[..., None]
    return sky


def written(folder: Path, count: int, rows: int) -> Path:
    """Write frames as OpenEXR, half floats and ZIP; return the folder.

    Args:
        folder: Made if need be.
        count: How many.
        rows: Of each.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        write_exr(folder / f"sky.{1001 + number}.exr", frame_of(number, rows))
    return folder
