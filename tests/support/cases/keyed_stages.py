# SPDX-License-Identifier: Apache-2.0
"""Keyed stages of a lamp that passes the seam, over a sky."""

from pathlib import Path

from key_cases import Rectangle, with_lamps
from torch import Tensor
from usd_tracks import moving

from asglight.images import open_sequence, read_latlong, write_exr
from asglight.lobes import LobeTracks
from asglight.shots.keying import Keying
from asglight.usd import write_usd
from asglight.usd.options import KeyOptions

ROWS = 64
FRAMES = tuple(range(1001, 1007))


def lamp_at(frame: int) -> Rectangle:
    return Rectangle(168 + 4 * (frame - 1001), 20, 15, 20, 9)


def images(
    folder: Path, frames: tuple[int, ...] = FRAMES, *, half: bool = False
) -> dict[int, Tensor]:
    """Write a lamp that passes the seam, over a sky; return what is read of it."""
    found = {}
    for frame in frames:
        path = folder / f"sky.{frame}.exr"
        write_exr(path, with_lamps(ROWS, lamp_at(frame), rays=4), half=half)
        found[frame] = read_latlong(path).radiance
    return found


def tracks_of(frames: tuple[int, ...] = FRAMES) -> LobeTracks:
    return moving(frames)


def write(folder: Path, name: str = "shot.usda", frames: tuple[int, ...] = FRAMES, **options):
    keys = KeyOptions(**{k: options.pop(k) for k in ("count", "lights", "texture") if k in options})
    sequence = open_sequence(folder / "sky.####.exr")
    options = {"representations": ("keys",), **options}
    return write_usd(tracks_of(frames), folder / name, keys=Keying(sequence, keys), **options)
