# SPDX-License-Identifier: Apache-2.0
"""The reference of a page: its map and its balls in each frame, as a JPEG, and the errors.

A JPEG has 8 bits. The map and each ball have a range of their own, from `low` to `high`:

    level = 16 + 239 (log2 x - low) / (high - low)       0 is black, and so is what is below 8

A matte ball spans a few stops and has steps below a percent, a map with the sun in it some percent:
enough for the eye at any exposure. Errors are computed of the maps themselves.

Dimension letters: F frames, B balls.
"""

import math
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO
import torch
from torch import Tensor

from asglight.judging.metrics import frame_errors
from asglight.lobes import LobeTracks
from asglight.shading.balls import coverage, covered, render_balls
from asglight.sphere import latlong
from asglight.viewer.state.balls import Ball

ROWS, BALL = 192, 96
"""Of the stored map, and pixels across a stored ball."""

MATTE_ROWS = 32
"""Of the map that lights the matte ball: its cosine is nearly straight over 6 degrees."""

RANGE_MAX = 24.0
"""Stops from the brightest texel down to what is stored as black: the eye sees 14 at once."""

DARKEST = 16
"""Level of the darkest radiance that is not black: blocks of a JPEG stray by a few levels."""

QUALITY = "jpeg:92"
"""Blocks of it are not seen; 98 doubles the bytes."""

BATCH = 32
"""Frames whose balls are rendered together: their kernels, which take nearly all of the time, are
made once for all; the maps of 32 frames are 50 MB."""


@dataclass(frozen=True)
class Reference:
    """The reference of a page.

    Attributes:
        name: Of the images.
        pictures: A JPEG a frame: the map, and below it the balls in a row.  F
        ranges: Low and high of the map and of each ball in each frame, in stops.  F, [1 + B, 2]
        errors: Of each frame, by name.  F
    """

    name: str
    pictures: list[bytes]
    ranges: list[list[tuple[float, float]]]
    errors: list[dict[str, float]]


def reference_of(
    name: str, maps: Iterable[Tensor], tracks: LobeTracks, balls: Sequence[Ball]
) -> Reference:
    """Render and judge the reference of every frame.

    Args:
        name: What to call it.
        maps: Radiance of the F frames, in order, [H, 2 H, 3] each.
        tracks: Their lobes.
        balls: White metal with a roughness, and matte white ones without.
    """
    pictures: list[bytes] = []
    ranges: list[list[tuple[float, float]]] = []
    errors: list[dict[str, float]] = []
    waiting: list[Tensor] = []
    for frame, radiance in zip(tracks.frames, maps, strict=True):
        errors.append(frame_errors(tracks.at(frame), radiance).values)
        waiting.append(radiance)
        if len(waiting) < BATCH and frame != tracks.frames[-1]:
            continue
        for one, drawn in zip(waiting, _balls(waiting, balls), strict=True):
            parts = [latlong.reduce(one, ROWS, 2 * ROWS), *drawn]
            ranges.append([_range(part) for part in parts])
            levels = [_levels(part, *own) for part, own in zip(parts, ranges[-1], strict=True)]
            pictures.append(_jpeg(levels[0], np.concatenate(levels[1:], axis=1)))
        waiting = []
    return Reference(name, pictures, ranges, errors)


def _balls(maps: Sequence[Tensor], balls: Sequence[Ball]) -> Tensor:
    """Return the balls of some maps; what lies around them has their mean.  [F, B, S, S, 3]."""
    roughness = [ball.roughness for ball in balls if ball.roughness is not None]
    rows = max(len(one) for one in maps)
    whole = torch.stack([latlong.reduce(one, rows, 2 * rows) for one in maps])
    layered = iter(render_balls(whole, roughness, size=BALL).unbind(1))
    matte = _matt(maps)
    rows_of = [matte if ball.roughness is None else next(layered) for ball in balls]
    drawn = torch.stack(rows_of, dim=1)  # multiplied by the coverage, which the page does itself
    share = coverage(BALL)[..., None]
    mean = drawn.sum((2, 3), keepdim=True) / share.sum()
    return torch.where(share > 0, drawn / share.clamp(min=1e-6), mean)


def _matt(maps: Sequence[Tensor]) -> Tensor:
    """Return matte white balls: irradiance over pi, by a sum over texels.  [F, S, S, 3]."""
    share, normals = covered(BALL)
    grid = MATTE_ROWS, 2 * MATTE_ROWS
    light = torch.stack([latlong.reduce(one, *grid) for one in maps])
    light = light * latlong.texel_solid_angles(*grid)[..., None] / math.pi
    cosine = (normals @ latlong.directions(*grid).reshape(-1, 3).mT).clamp(min=0)
    shown = torch.einsum("pt,ftc->fpc", cosine, light.reshape(len(light), -1, 3)) * share[:, None]
    result = torch.zeros(len(light), BALL * BALL, 3)
    result[:, coverage(BALL).flatten() > 0] = shown
    return result.reshape(-1, BALL, BALL, 3)


def _range(radiance: Tensor) -> tuple[float, float]:
    """Return low and high of a part, in stops; of a black one, any."""
    lit = radiance[radiance > 0]
    if not len(lit):
        return 0.0, 1.0
    high = math.log2(float(lit.max()))
    low = max(math.log2(float(lit.min())), high - RANGE_MAX)
    return low, max(high, low + 1e-3)


def _levels(radiance: Tensor, low: float, high: float) -> np.ndarray:
    """Return the levels of a part, 8 bits.  [H, W, 3]."""
    stops = radiance.clamp(min=2.0**-100).log2()
    levels = DARKEST + (255 - DARKEST) * (stops - low) / (high - low)
    lit = torch.where(radiance > 0, levels.clamp(min=DARKEST), 0)
    return lit.round().clamp(0, 255).to(torch.uint8).numpy()


def _jpeg(above: np.ndarray, below: np.ndarray) -> bytes:
    """Encode two pictures, one above the other."""
    width = max(above.shape[1], below.shape[1])
    sides = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0))) for one in (above, below)]
    image = np.ascontiguousarray(np.concatenate(sides))
    spec = OpenImageIO.ImageSpec(image.shape[1], image.shape[0], 3, OpenImageIO.UINT8)
    spec["Compression"] = QUALITY
    spec["jpeg:subsampling"] = "4:4:4"
    with tempfile.TemporaryDirectory(prefix="asglight-") as folder:
        path = Path(folder) / "frame.jpg"
        writer = OpenImageIO.ImageOutput.create(str(path))
        assert writer is not None, OpenImageIO.geterror()
        done = writer.open(str(path), spec) and writer.write_image(image) and writer.close()
        assert done, writer.geterror()
        return path.read_bytes()
