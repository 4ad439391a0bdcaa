# SPDX-License-Identifier: Apache-2.0
"""Stages to be edited, and tracks with edits that scipy and numpy made."""

import functools
import tempfile
from dataclasses import replace
from pathlib import Path

import torch
from scipy.spatial.transform import Rotation
from usd_tracks import contents, of_every_kind, write_every
from written_stages import calm

from asglight.lobes import Form, LobeTracks
from asglight.usd import read_usd

FRAMES = (1001, 1002, 1005, 1006, 1010)


def changed(tracks: LobeTracks, lobe: int, frames: slice, *kinds: str) -> LobeTracks:
    """Turn, brighten and sharpen one lobe in some frames, with scipy and numpy alone."""
    lobes = tracks.lobes.clone()
    if "turn" in kinds:
        turn = torch.from_numpy(Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()).float()
        lobes.axes[frames, lobe] = lobes.axes[frames, lobe] @ turn.T
    if "brighten" in kinds:
        lobes.amplitude[frames, lobe] *= torch.tensor([4.0, 2.0, 0.5])
    if "sharpen" in kinds:
        # the greater of the two remains the greater: a stage that is written anew has it along x
        own = lobes.sharpness[frames, lobe]
        is_greater = own == own.amax(-1, keepdim=True)
        factor = 2.0 if lobes.form is Form.SG else torch.where(is_greater, 8.0, 2.0)
        lobes.sharpness[frames, lobe] = own * factor
    return replace(tracks, lobes=lobes)


def fit(folder: Path, form: Form = Form.ASG, name: str = "fit.usda") -> tuple[Path, LobeTracks]:
    """Put a stage of three lobes into a folder, and read it."""
    for place, data in _written(form, name).items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_bytes(data)
    return folder / name, read_usd(folder / name)


@functools.cache
def _written(form: Form, name: str) -> dict[str, bytes]:
    """Return the files of the stage: what tests change is a copy."""
    with tempfile.TemporaryDirectory() as folder:
        write_every(
            calm(of_every_kind, FRAMES, form),
            Path(folder, name),
            distance=50.0,
            meters_per_unit=0.01,
            dome_height=8,
        )
        return contents(Path(folder))
