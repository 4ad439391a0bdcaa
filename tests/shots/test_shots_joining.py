# SPDX-License-Identifier: Apache-2.0
"""Parts of a shot, read and joined: a name means the light that it meant in an earlier fit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from usd_tracks import rows

from asglight.lobes import Lobes, LobeTracks
from asglight.shots.parts.joining import join
from asglight.usd import read_usd, write_usd


def lamps(places: dict[str, float], frames: tuple[int, ...]) -> LobeTracks:
    """Return lamps on the equator, by name at an angle in degrees."""
    turns = Rotation.from_euler("y", np.reshape(list(places.values()), (-1, 1)), degrees=True)
    axes = torch.from_numpy(rows(turns)).float().expand(len(frames), -1, -1, -1).clone()
    shape = (len(frames), len(places))
    lobes = Lobes(axes, torch.full((*shape, 2), 50.0), torch.ones(*shape, 3))
    return LobeTracks(frames, 24.0, lobes, {}, tuple(places))


def test_a_shot_in_parts_has_the_names_of_an_earlier_fit(tmp_path: Path) -> None:
    earlier = lamps({"lobe_00": 0.0, "lobe_01": 90.0, "lobe_02": 180.0}, (1, 2, 3, 4))
    earlier = replace(earlier, display_names={"lobe_02": "Window"})
    parts = [
        lamps({"lobe_00": 0.0}, (1, 2, 3)),
        lamps({"lobe_00": 180.0, "lobe_01": 0.0}, (3, 4, 5)),  # named by nobody
    ]
    files = [str(tmp_path / name) for name in ("a.usdc", "b.usdc")]
    for file, part in zip(files, parts, strict=True):
        write_usd(part, file)
    write_usd(earlier, tmp_path / "earlier.usda")
    shot = str(tmp_path / "shot.usda")
    join(files, shot, names_from=str(tmp_path / "earlier.usda"))
    found = read_usd(shot)
    x, _, z = found.lobes.axis_z[-1].unbind(-1)
    places = (torch.rad2deg(torch.atan2(x, z)) % 360).round().tolist()
    assert dict(zip(found.names, places, strict=True)) == {"lobe_00": 0.0, "lobe_02": 180.0}
    assert found.display_names == {"lobe_02": "Window"}
