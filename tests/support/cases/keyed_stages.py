# SPDX-License-Identifier: Apache-2.0
"""Keyed stages of a lamp that passes the seam, over a sky."""

import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from key_cases import Rectangle, with_lamps
from torch import Tensor
from usd_tracks import contents, moving

from asglight.images import open_sequence, read_latlong, write_exr
from asglight.lobes import LobeTracks
from asglight.shots.keying import Keying
from asglight.usd import WriteReport, write_usd
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


def write(
    folder: Path, name: str = "shot.usda", frames: tuple[int, ...] = FRAMES, **options: Any
) -> WriteReport:
    """Write a stage with keys cut from the images of the folder: once for the same images."""
    seen = {one.name: one.read_bytes() for one in sorted(folder.glob("sky.*.exr"))}
    case = name, frames, repr(sorted(options.items())), tuple(seen.items())
    if (folder / name).exists():  # whose names are kept
        return _written(folder, name, frames, options)
    if case not in _KEPT:
        with tempfile.TemporaryDirectory() as place:
            first = Path(place)
            for image, data in seen.items():
                (first / image).write_bytes(data)
            report = _written(first, name, frames, options)
            made = {k: v for k, v in contents(first).items() if k not in seen}
            _KEPT[case] = replace(report, files=_relative(report.files, first)), made
    report, made = _KEPT[case]
    for place, data in made.items():
        (folder / place).parent.mkdir(exist_ok=True)
        (folder / place).write_bytes(data)
    return replace(report, files=tuple(folder / file for file in report.files))


_KEPT: dict[tuple[Any, ...], tuple[WriteReport, dict[str, bytes]]] = {}
"""Reports and files: cutting keys takes longer than what tests do with a stage."""


def _relative(files: Iterable[Path], folder: Path) -> tuple[Path, ...]:
    return tuple(file.relative_to(folder) for file in files)


def _written(
    folder: Path, name: str, frames: tuple[int, ...], options: dict[str, Any]
) -> WriteReport:
    of_keys = {k: v for k, v in options.items() if k in ("count", "lights", "texture")}
    others = {k: v for k, v in options.items() if k not in of_keys}
    keys = Keying(open_sequence(folder / "sky.####.exr"), KeyOptions(**of_keys))
    others = {"representations": ("keys",), **others}
    return write_usd(tracks_of(frames), folder / name, keys=keys, **others)
