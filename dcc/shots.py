# SPDX-License-Identifier: Apache-2.0
"""What is measured: shots, fitted and exported, at a few frames."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.images import open_sequence, read_latlong, write_exr
from asglight.lobes import Lobes, LobeTracks
from asglight.shots import fit_shot
from asglight.sky import SkyConfig, radiance
from asglight.usd import StageOptions, read_usd, write_usd
from asglight.usd.options import OF_LOBES
from dcc import renderers

SEQUENCES = ("day", "tunnel", "handheld")

UP_AXES = ("Y", "Z")
"""Of the stages; the first is what a fit writes."""

SKY_ROWS = 128
SKY_FRAMES = (1001, 1002, 1003)
"""Of the built-in environment: few, because the short run fits them each time."""


@dataclass(frozen=True)
class Shot:
    """A fitted shot.

    Attributes:
        name: Of the sequence.
        frames: Those that are measured.
        images: File of each of them.
        stages: Up axis to exported stage.
        tracks: The lobes, read from the stage.
    """

    name: str
    frames: tuple[int, ...]
    images: tuple[Path, ...]
    stages: dict[str, Path]
    tracks: LobeTracks

    def lobes(self, frame: int) -> Lobes:
        """Return the lobes of a frame in float64.  [N, .]."""
        return self.tracks.lobes[self.tracks.frames.index(frame)].to(torch.float64)


def from_sequences(
    folder: Path, count: int, output: Path, names: Sequence[str] = SEQUENCES
) -> list[Shot]:
    """Fit sequences and export them.

    Args:
        folder: Holds a folder for each sequence.
        count: Frames to measure of each, evenly chosen, with the first and the last.
        output: Folder for the stages.
        names: Sequences.

    Raises:
        InputError: A sequence is missing.
    """
    missing = [name for name in names if not (folder / name).is_dir()]
    if missing:
        raise InputError(
            f"{folder}: no folder {missing[0]}; expected the sequences {', '.join(names)}. "
            "Say where they are with --sequences, or measure the built-in sky with --short."
        )
    return [_shot(name, folder / name, count, output) for name in names]


def built_in(output: Path) -> Shot:
    """Draw the first frames of the built-in environment, fit them and measure the second."""
    folder = output / "sky"
    folder.mkdir(parents=True, exist_ok=True)
    for frame in SKY_FRAMES:
        write_exr(folder / f"sky.{frame}.exr", radiance(SkyConfig(), frame, SKY_ROWS))
    return _shot("sky", folder, 1, output)


def rows_of(image: Path) -> int:
    """Return the rows of a latlong file."""
    return len(read_latlong(image).radiance)


def _shot(name: str, folder: Path, count: int, output: Path) -> Shot:
    sequence = open_sequence(folder)
    stage = output / f"{name}-Y.usda"
    every = tuple(map(str, OF_LOBES))
    options = StageOptions(representations=every)
    fit_shot(folder, stage, FitOptions(preset=Preset.LIVE), stage=options, resume=True)
    tracks = read_usd(stage)
    stages = {"Y": stage}
    for axis in UP_AXES[1:]:
        stages[axis] = output / f"{name}-{axis}.usda"
        write_usd(tracks, stages[axis], representations=every, up_axis=axis)
    middle = len(tracks.frames) // 2
    chosen = [middle] if count == 1 else np.linspace(0, len(tracks.frames) - 1, count).round()
    frames = tuple(tracks.frames[int(index)] for index in chosen)
    images = tuple(sequence.source.files[frame] for frame in frames)
    return Shot(name, frames, images, stages, tracks)


def parser(room: str, description: str | None, output: str) -> argparse.ArgumentParser:
    """Return a parser of the options that measures of shots have in common.

    Args:
        room: `dcc` or a room of it.
        description: Of the measure.
        output: Folder that is written where none is said.
    """
    found = argparse.ArgumentParser(prog=f"python -m {room}.measure", description=description)
    add = found.add_argument
    add("--sequences", type=Path, default=Path("../shared/sequences"), metavar="DIR")
    add("--short", action="store_true", help="the built-in sky only, in Blender only")
    add("--size", type=int, default=16, metavar="S", help="pixels across a ball")
    add("--samples", type=int, default=1024, metavar="N", help="of a pixel and seed")
    add("-o", "--output", type=Path, default=Path(output), metavar="DIR")
    return found


def extension_parser(room: str, description: str | None, output: str) -> argparse.ArgumentParser:
    """Return `parser` for shots that go through the Blender extension."""
    found = parser(room, description, output)
    found.add_argument("--zip", type=Path, required=True, metavar="ZIP", help="the extension")
    python = "an interpreter that has bpy"
    found.add_argument("--python", type=Path, default=renderers.PYTHON, help=python)
    return found
