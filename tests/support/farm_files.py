# SPDX-License-Identifier: Apache-2.0
"""Tiny shots of broad lamps, which turn by up to 170 degrees over the shot."""

from pathlib import Path

import sky_files
import torch
import usd_tracks

from asglight.lobes import asg
from asglight.sphere.latlong import directions


def write_shot(folder: Path, frames: range, seed: int = 0, lamps: int = 3) -> Path:
    """Write `<folder name>.####.exr` of 16 x 32 texels into a new folder and return the folder."""
    folder.mkdir(parents=True)
    tracks = usd_tracks.moving(frames, lamps, seed=seed)
    lobes = tracks.lobes.to(torch.float64)
    lobes.sharpness.clamp_(max=12.0)  # a lamp of several texels
    rays = directions(16, 32).reshape(-1, 3).double()
    for index, frame in enumerate(frames):
        values = asg.evaluate(lobes[index], rays).reshape(16, 32, 3)
        sky_files.write_frame(folder / f"{folder.name}.{frame}.exr", values.float().numpy())
    return folder
