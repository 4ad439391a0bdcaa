# SPDX-License-Identifier: Apache-2.0
"""A small set in Blender under an HDRI, its lobes, and its keys and rest."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from asglight.images import open_sequence, write_exr
from asglight.shots import fit_shot
from asglight.usd import StageOptions, read_usd, write_usd
from asglight.usd.options import KeyOptions
from dcc import renderers, stages

SAMPLES = 128
"""Before Blender's denoiser."""

MIRROR = 0.0
"""Roughness of the right ball."""


def pictures(
    source: Path, folder: Path, package: Path, size: tuple[int, int], *, textured: bool
) -> list[Tensor]:
    """Render the set three times.

    Args:
        source: A latlong map.
        folder: For stages and renders.
        package: The Blender extension.
        size: Columns and rows.
        textured: Whether keys carry the pixels of their lamps.

    Returns:
        Under the HDRI, its lobes, its keys and rest: linear, alpha beside.  3 x [H, W, 4]
    """
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    keyed, lobes, image = (folder / name for name in ("keyed.usda", "lobes.usda", "hdri.exr"))
    options = StageOptions(representations=("keys",))
    fit_shot(source, keyed, stage=options, keys=KeyOptions(texture=textured))
    tracks = read_usd(keyed)
    write_usd(tracks, lobes)
    frame = tracks.frames[0]
    write_exr(image, open_sequence(source).read(frame).radiance, half=False)
    shown = {
        "original": stages.original(image, folder / "hdri.usda"),
        "lobes": lobes,
        "keyed": keyed,
    }
    jobs = [
        {
            "stage": str(stage),
            "way": "original" if name == "original" else "hook",
            "frames": [frame],
            "width": size[0],
            "height": size[1],
            "samples": SAMPLES,
            "glossy": MIRROR,
            "zip": str(package.resolve()),
            "out": str(folder / f"{name}.npz"),
        }
        for name, stage in shown.items()
    ]
    renderers.run("dcc.moving.picture_render", jobs, folder)
    return [torch.from_numpy(np.load(job["out"])["pictures"][0]).double() for job in jobs]
