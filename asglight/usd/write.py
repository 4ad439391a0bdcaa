# SPDX-License-Identifier: Apache-2.0
"""Writing lobe tracks as a USD stage with three representations.

Everything is written into a hidden folder beside the target, checked there, and only then renamed
into place: the dome's images one by one, the stage last. A write that fails before leaves every
file as it was. One that is killed between two renames leaves the old stage with some images of the
new one; whenever it ends, the stage that stands at the target finds all its images.
"""

import json
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import torch
from pxr import Tf

from asglight.errors import InputError
from asglight.images.message import shown
from asglight.lobes import LobeTracks
from asglight.lobes.data import Lobes
from asglight.usd import dome, layer
from asglight.usd.authoring import TrackAuthor
from asglight.usd.faults import reason
from asglight.usd.lint import lint_stage
from asglight.usd.schema import Representation

FILE_FORMATS = {".usda": "usda", ".usdc": "usdc", ".usd": "usdc"}

FRAME_ERROR_MAX = 1e-4
"""Largest entry of A A^T - I in the axes A: a thousand float32 roundings; more is not a frame."""


SHARPNESS_RANGE = (1e-4, 1e8)
"""Ten times beyond the limits of asglight.lobes.asg on both sides, so no rounding of a fit at its
limit is refused; to a renderer such lobes are half spheres and points."""

AMPLITUDE_MAX = 1e37
"""Intensities, at most 4 pi times as large, stay finite in float32."""


@dataclass(frozen=True)
class WriteReport:
    """What was written.

    Attributes:
        files: The stage, then the dome's images.
        bytes: Their size together.
        samples_written: Time samples in the stage.
        samples_left_out: Time samples that interpolation or a constant default reproduces.
    """

    files: tuple[Path, ...]
    bytes: int
    samples_written: int
    samples_left_out: int


def write_usd(
    tracks: LobeTracks,
    path: str | Path,
    *,
    representation: Representation | str = Representation.CARDS,
    distance: float = 1000.0,
    dome_height: int = 128,
    meters_per_unit: float = 1.0,
) -> WriteReport:
    """Write tracks as one stage that holds cards, distant lights and a dome as variants.

    The dome's images go to the folder `<stem>_dome` beside the stage, `<stem>.<frame>.exr`; tracks
    that never change have one. Images of an earlier, longer write stay where they are.

    Args:
        tracks: Lobes of F frames; metadata of JSON values, which come back as JSON gives them.
        path: Target: `.usda` is text, `.usdc` and `.usd` are crates.
        representation: The variant that the stage shows: `cards`, `distant` or `dome`.
        distance: Of the cards from the origin, in stage units.
        dome_height: Rows of the dome's images; there are twice as many columns.
        meters_per_unit: Length of a stage unit.

    Returns:
        Files and sample counts.

    Raises:
        InputError: The tracks cannot be lights, an option is out of range, or nothing can be
            written there.
    """
    path = Path(path)
    _check_options(representation, distance, dome_height, meters_per_unit)
    _check_tracks(tracks)
    _check_target(path)
    try:
        # Beside the target, hence on its file system, where a rename is atomic.
        with tempfile.TemporaryDirectory(
            prefix=".asglight-", dir=path.parent, ignore_cleanup_errors=True
        ) as folder:
            staged = Path(folder) / path.name
            textures = _write_dome(tracks, staged, dome_height)
            placement = layer.Placement(
                Representation(representation),
                distance,
                meters_per_unit,
                [f"./{texture.parent.name}/{texture.name}" for texture in textures],
            )
            author = _write_stage(tracks, staged, placement)
            files = _move_into_place(staged, path, textures)
    except (OSError, Tf.ErrorException) as error:
        raise InputError(
            f"{shown(path)}: cannot be written ({reason(error)}); expected a folder with room and "
            "the permission to write. Check the output path."
        ) from error
    size = sum(file.stat().st_size for file in files)
    return WriteReport(files, size, author.written, author.left_out)


def _write_dome(tracks: LobeTracks, staged: Path, height: int) -> list[Path]:
    folder = staged.parent / f"{staged.stem}_dome"
    folder.mkdir()
    try:
        return dome.write_textures(tracks, folder, staged.stem, height)
    except InputError as error:  # names a file of the hidden folder, which nobody asked for
        raise InputError(
            str(error).replace(shown(staged.parent), shown(staged.parent.parent))
        ) from error


def _write_stage(tracks: LobeTracks, staged: Path, placement: layer.Placement) -> TrackAuthor:
    built, author = layer.build(tracks, placement)
    if not built.Export(str(staged), args={"format": FILE_FORMATS[staged.suffix.lower()]}):
        raise OSError(None, "USD could not save the layer")
    findings = lint_stage(staged)
    if findings:
        raise RuntimeError(f"the stage breaks its own contract: {findings}")
    return author


def _move_into_place(staged: Path, path: Path, textures: list[Path]) -> tuple[Path, ...]:
    folder = path.parent / f"{path.stem}_dome"
    folder.mkdir(exist_ok=True)
    images = [folder / texture.name for texture in textures]
    for texture, image in zip(textures, images, strict=True):
        os.replace(texture, image)
    os.replace(staged, path)
    return (path, *images)


def _check_options(
    representation: str, distance: float, dome_height: int, meters_per_unit: float
) -> None:
    if representation not in set(Representation):
        known = ", ".join(Representation)
        raise InputError(f"representation: {representation!r}; expected one of {known}.")
    for name, value in (("distance", distance), ("meters_per_unit", meters_per_unit)):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{name}: {value}; expected a finite number above 0.")
    if dome_height < 2:
        raise InputError(f"dome_height: {dome_height}; expected 2 rows or more.")


def _check_target(path: Path) -> None:
    if path.suffix.lower() not in FILE_FORMATS:
        raise InputError(
            f"{shown(path)}: extension {path.suffix!r}; expected .usda, .usdc or .usd."
        )
    if not path.name.isprintable():
        raise InputError(f"{shown(path)}: control characters in the name; expected none.")
    if not path.parent.is_dir():
        raise InputError(
            f"{shown(path)}: no folder {shown(path.parent)}; expected an existing folder. "
            "Create it or check the output path."
        )
    if path.is_dir():
        raise InputError(f"{shown(path)}: is a folder; expected a file to write.")


def _check_tracks(tracks: LobeTracks) -> None:
    lobes = tracks.lobes
    if not tracks.frames or not lobes.count:
        raise InputError(
            f"tracks: {lobes.count} lobes in {len(tracks.frames)} frames; "
            "expected at least one lobe in one frame."
        )
    if not (math.isfinite(tracks.fps) and tracks.fps > 0):
        raise InputError(f"fps: {tracks.fps}; expected a finite number above 0.")
    low, high = SHARPNESS_RANGE
    sharp = (lobes.sharpness >= low) & (lobes.sharpness <= high)
    _check_lobes(tracks, "sharpness", sharp, lobes.sharpness, f"from {low:g} to {high:g}")
    bright = (lobes.amplitude >= 0) & (lobes.amplitude <= AMPLITUDE_MAX)
    _check_lobes(tracks, "amplitude", bright, lobes.amplitude, f"from 0 to {AMPLITUDE_MAX:g}")
    orthonormal = _frame_error(lobes) <= FRAME_ERROR_MAX
    _check_lobes(tracks, "axes", orthonormal, lobes.axes, "that form a right-handed frame")
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
