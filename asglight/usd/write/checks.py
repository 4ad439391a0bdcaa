# SPDX-License-Identifier: Apache-2.0
"""What is refused before a file is touched: tracks that cannot be lights, targets of no use."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import torch

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.lobes.data import Lobes, check_frames
from asglight.usd.options import check_stage_name, image_folder, stages_beside
from asglight.usd.read.files import files_of

FRAME_ERROR_MAX = 1e-4
"""Largest entry of A A^T - I in the axes A: a thousand float32 roundings; more is not a frame."""

SHARPNESS_RANGE = (1e-4, 1e8)
"""Ten times beyond the limits of asglight.lobes.asg on both sides, so no rounding of a fit at its
limit is refused; to a renderer such lobes are half spheres and points."""

AMPLITUDE_MAX = 1e37
"""Intensities, at most 4 pi times as large, stay finite in float32."""


def check_target(path: Path, suffixes: Sequence[str]) -> None:
    """Check that a stage can be written at a path.

    Args:
        path: The target.
        suffixes: Extensions that it may have.

    Raises:
        InputError: The name or the folder is no place for a stage.
    """
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{shown(path)}: extension {path.suffix!r}; expected {one_of(suffixes)}.")
    check_stage_name(path)
    if not path.parent.is_dir():
        raise InputError(
            f"{shown(path)}: no folder {shown(path.parent)}; expected an existing folder. "
            "Create it or check the output path."
        )
    if path.is_dir():
        raise InputError(f"{shown(path)}: is a folder; expected a file to write.")
    if path.exists() and not path.is_file():
        raise InputError(f"{shown(path)}: is a pipe or a device; expected a file to write.")


def check_images_apart(path: Path) -> None:
    """Check that the images of a stage would not replace those of another one.

    Raises:
        InputError: A stage of the same name with another extension shows images of its folder.
    """
    folder = image_folder(path)
    for other in stages_beside(path) if folder.is_dir() else ():
        if _shows_images_of(other, folder):
            raise InputError(
                f"{shown(path)}: its images would replace those of {shown(other)} in "
                f"{shown(folder.name)}; expected one stage for each folder of images. Write to "
                "another name or folder, or delete the other stage."
            )


def _shows_images_of(stage: Path, folder: Path) -> bool:
    try:
        return any(file.resolve().parent == folder.resolve() for file in files_of(stage))
    except InputError:  # nobody can light with it
        return False


def one_of(words: Sequence[str]) -> str:
    """Return words as a choice: `a, b or c`."""
    *others, last = words
    return f"{', '.join(others)} or {last}"


def check_tracks(tracks: LobeTracks) -> None:
    """Check that tracks can be lights.

    Raises:
        InputError: They are empty, or a value is out of range or not finite.
    """
    lobes = tracks.lobes
    if not tracks.frames or not lobes.count:
        raise InputError(
            f"tracks: {lobes.count} lobes in {len(tracks.frames)} frames; "
            "expected at least one lobe in one frame."
        )
    if not (math.isfinite(tracks.fps) and tracks.fps > 0):
        raise InputError(f"fps: {tracks.fps}; expected a finite number above 0.")
    check_frames(tracks.frames)
    low, high = SHARPNESS_RANGE
    sharp = (lobes.sharpness >= low) & (lobes.sharpness <= high)
    _check_lobes(tracks, "sharpness", sharp, lobes.sharpness, f"from {low:g} to {high:g}")
    bright = (lobes.amplitude >= 0) & (lobes.amplitude <= AMPLITUDE_MAX)
    _check_lobes(tracks, "amplitude", bright, lobes.amplitude, f"from 0 to {AMPLITUDE_MAX:g}")
    orthonormal = _frame_error(lobes) <= FRAME_ERROR_MAX
    _check_lobes(tracks, "axes", orthonormal, lobes.axes, "that form a right-handed frame")
    if not all(name.isidentifier() for name in tracks.names):
        raise InputError(
            f"tracks: lobes are called {shown(', '.join(tracks.names))}; expected names of "
            "letters, digits and _ that begin with no digit."
        )
    try:
        json.dumps(dict(tracks.metadata), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(f"metadata: {error}; expected JSON values.") from error


def _frame_error(lobes: Lobes) -> torch.Tensor:
    """Return how far each frame is from right-handed and orthonormal.  [F, N, 1]."""
    axes = lobes.axes.to("cpu", torch.float64)
    gram = (axes @ axes.mT - torch.eye(3, dtype=torch.float64)).abs().amax((-2, -1))
    handed = (torch.linalg.det(axes) - 1).abs()  # 2 for a mirrored frame
    return torch.maximum(gram, handed)[..., None]


def _check_lobes(
    tracks: LobeTracks,
    name: str,
    in_range: torch.Tensor,
    values: torch.Tensor,
    expected: str,
) -> None:
    """Raise for the first lobe whose value is out of range or not finite."""
    good = in_range.flatten(2).all(-1).cpu() & torch.isfinite(values).flatten(2).all(-1).cpu()
    if bool(good.all()):
        return
    frame, lobe = torch.nonzero(~good)[0].tolist()
    found = [float(f"{value:.4g}") for value in values[frame, lobe].flatten().tolist()]
    raise InputError(
        f"tracks: {name} of lobe {lobe} is {found} at frame {tracks.frames[frame]}; "
        f"expected finite numbers {expected}."
    )
