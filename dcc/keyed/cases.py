# SPDX-License-Identifier: Apache-2.0
"""Keyed stages that are rendered, each beside the images that it was made of."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.images import open_sequence, read_latlong, write_exr
from asglight.lobes import asg
from asglight.shots import fit_shot
from asglight.sky import SkyConfig, radiance
from asglight.usd import StageOptions, read_keys
from asglight.usd.options import KeyOptions
from dcc.shots import SKY_FRAMES, SKY_ROWS

FRAMES = 3
"""Of a shot that are rendered: the first, the middle, the last."""

ROWS_MIN = 512
"""Of the images that are rendered, those of the rest too; the texels of smaller ones are repeated.
Cycles interpolates between texels, so a lamp of two texels is wider in it than a card can know: on
a ball of roughness 0.25 an image of 128 rows is 1.7 % off by that."""


@dataclass(frozen=True)
class Case:
    """A keyed stage.

    Attributes:
        name: Of its images.
        stage: The stage.
        frames: Those that are rendered.
        images: Of each what the stage was made of: the image as asglight reads it, its texels as
            even as asglight takes them. Images may hold negative texels, which filters leave beside
            lamps; Cycles takes their light away.
        rows: Of these images before their texels were repeated.
        key: Direction to the key with most light in the first of them.  [3]
    """

    name: str
    stage: Path
    frames: tuple[int, ...]
    images: tuple[Path, ...]
    rows: int
    key: NDArray[np.float64]


def case(source: Path, output: Path, count: int = FRAMES) -> Case:
    """Fit images, cut their keys, and choose frames.

    Args:
        source: A folder of a sequence, or an image.
        output: Folder for the stage.
        count: Frames of a sequence, evenly chosen.

    Raises:
        InputError: There are no such images, or they have no lamp.
    """
    (output / "images").mkdir(parents=True, exist_ok=True)
    stage = output / f"{source.stem}.usda"
    options = StageOptions(representations=("keys",))
    fit_shot(
        source,
        stage,
        FitOptions(preset=Preset.LIVE),
        stage=options,
        keys=KeyOptions(),
        resume=True,
    )
    keys = read_keys(stage)
    assert keys is not None
    if keys.tracks is None:
        raise InputError(f"{source}: has no lamp; expected images with keys.")
    every = keys.tracks.frames
    chosen = [len(every) // 2] if count == 1 else np.linspace(0, len(every) - 1, count).round()
    places = sorted({int(place) for place in chosen})
    frames = tuple(every[place] for place in places)
    images, rows = [], 0
    for place, frame in zip(places, frames, strict=True):
        image = open_sequence(source).read(frame).radiance
        rows = len(image)
        images.append(output / "images" / f"{source.stem}.{frame:04d}.exr")
        write_exr(images[-1], repeated(image), half=False)
        rest = Path(keys.rest.images[place])
        write_exr(rest, repeated(read_latlong(rest).radiance), half=False)
    lobes = keys.tracks.lobes[places[0]]
    strongest = int(asg.flux(lobes).sum(-1).argmax())
    key = lobes.axis_z[strongest].double().numpy()
    return Case(source.stem, stage, frames, tuple(images), rows, key)


def repeated(radiance: Tensor) -> Tensor:
    """Repeat the texels of a small image.  [H, 2 H, 3] -> [H', 2 H', 3], H' >= ROWS_MIN."""
    times = -(-ROWS_MIN // len(radiance))
    return radiance.repeat_interleave(times, 0).repeat_interleave(times, 1)


def built_in(output: Path) -> Case:
    """Draw the first frames of the built-in environment; the second is rendered."""
    folder = output / "sky"
    folder.mkdir(parents=True, exist_ok=True)
    for frame in SKY_FRAMES:
        write_exr(folder / f"sky.{frame}.exr", radiance(SkyConfig(), frame, SKY_ROWS))
    return case(folder, output, 1)


def of_sequences(folder: Path, names: Sequence[str], output: Path) -> list[Case]:
    """Make the cases of sequences.

    Raises:
        InputError: One is missing.
    """
    missing = [name for name in names if not (folder / name).is_dir()]
    if missing:
        raise InputError(
            f"{folder}: no folder {missing[0]}; expected the sequences {', '.join(names)}. "
            "Say where they are with --sequences, or measure the built-in sky with --short."
        )
    return [case(folder / name, output) for name in names]
