# SPDX-License-Identifier: Apache-2.0
"""The readers that the fuzzer calls, each as the product calls it."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from asglight.errors import InputError
from asglight.export.sg_array import SgLayout, read_sg_array
from asglight.export.track_file import read_json
from asglight.images import read_latlong
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.decoders import APART
from asglight.images.options import ReadOptions
from asglight.lobes import Lobes
from asglight.shots.kept.checkpoint import Checkpoint
from asglight.shots.watching import ShotWatch
from asglight.usd import read_usd
from asglight.usd.read.read_options import read_options
from soak.seeds import CHECKPOINT_HEADER

ROWS = 8
"""Rows that images are reduced to, as a fit reduces them."""

Read = Callable[[Path], None]


@dataclass(frozen=True)
class Reader:
    """What reads one kind of file.

    Attributes:
        name: Of the kind.
        suffix: Of its seeds, and of the damaged files.
        read: Reads a file; it returns, or raises an InputError.
        share: Of a thousand files, how many are of this kind.
        apart: Reads a file in another process, where that is what the product does; None where
            `read` is it. Then `read` shows what would happen without.
    """

    name: str
    suffix: str
    read: Read
    share: int
    apart: Read | None = None


def reading_of(path: Path) -> ReadOptions:
    """Return how a file is read: images of integers need a space, and then everything is read."""
    is_plain = path.suffix in (".exr", ".hdr")
    return ReadOptions() if is_plain else ReadOptions(colorspace="sRGB", repair=1)


def _image_here(path: Path) -> None:
    radiance = read_latlong(path, height=ROWS, reading=reading_of(path)).radiance
    assert bool((radiance >= 0).all()), "negative radiance"
    assert bool(torch.isfinite(radiance).all()), "radiance that is not finite"


def _image_apart(path: Path) -> None:
    read_latlong(path, height=ROWS, reading=reading_of(path), decoder=APART)


def _check_finite(lobes: Lobes) -> None:
    for values in (lobes.axes, lobes.sharpness, lobes.amplitude):
        assert bool(torch.isfinite(values).all()), "lobes that are not finite"


def _usd(path: Path) -> None:
    _check_finite(read_usd(path).lobes)
    read_options(path)


def _tracks(path: Path) -> None:
    _check_finite(read_json(path).lobes)


def _sg_array(path: Path) -> None:
    for layout in SgLayout:
        _check_finite(read_sg_array(path, layout).lobes)


def _checkpoint(path: Path) -> None:
    with contextlib.suppress(InputError):  # both read it, each with faults of its own to find
        ShotWatch(path.with_suffix("")).look()
    with Checkpoint(path, CHECKPOINT_HEADER, resume=True) as checkpoint:
        for record in checkpoint.records:
            _check_finite(record.lobes)


READERS = (
    Reader("OpenEXR", ".exr", _image_here, 360, _image_apart),
    Reader("Radiance", ".hdr", _image_here, 100, _image_apart),
    Reader("TIFF", ".tif", _image_here, 10, _image_apart),
    Reader("PFM", ".pfm", _image_here, 10, _image_apart),
    Reader("PNG", ".png", _image_here, 10, _image_apart),
    Reader("JPEG", ".jpg", _image_here, 5, _image_apart),
    Reader("WebP", ".webp", _image_here, 5, _image_apart),
    Reader("USD text", ".usda", _usd, 100),
    Reader("USD binary", ".usdc", _usd, 100),
    Reader("USD package", ".usdz", _usd, 50),
    Reader("JSON tracks", ".json", _tracks, 100),
    Reader("SG arrays", ".npy", _sg_array, 50),
    Reader("checkpoint", ".checkpoint", _checkpoint, 100),
)


def declared_bytes(path: Path) -> int:
    """Return the size that an image declares, as float32 with all its channels; else 0."""
    try:
        return read_header(path).stored_bytes
    except InputError:
        return 0
