# SPDX-License-Identifier: Apache-2.0
"""The reference of a page: its map and its balls in each frame, as a JPEG, and the errors.

A JPEG has 8 bits. Radiance is stored as `log2(1 + x / floor)` over the range of the shot, in steps
of some percent: enough for the eye at any exposure. Errors are computed of the maps themselves.

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
from asglight.viewer.balls import Ball

ROWS, BALL = 192, 96
"""Of the stored map, and pixels across a stored ball."""

MATT_ROWS = 32
"""Of the map that lights the matt ball: its cosine is nearly straight over 6 degrees."""

FLOOR = 2.0**-9
"""Of the median radiance of the shot: what is darker than that by far is black."""

QUALITY = "jpeg:88"
"""Blocks of it are not seen at the map's size; 95 doubles the bytes."""

BATCH = 8
"""Frames whose balls are rendered together: the kernels are then made once for all."""


@dataclass(frozen=True)
class Reference:
    """The reference of a page.

    Attributes:
        name: Of the images.
        pictures: A JPEG a frame: the map, and below it the balls in a row.  F
        floor: Radiance of the first step.
        stops: What 255 stands for: `floor (2^stops - 1)`.
        errors: Of each frame, by name.  F
    """

    name: str
    pictures: list[bytes]
    floor: float
    stops: float
    errors: list[dict[str, float]]


def reference_of(
    name: str, maps: Iterable[Tensor], tracks: LobeTracks, balls: Sequence[Ball]
) -> Reference:
    """Render and judge the reference of every frame.

    Args:
        name: What to call it.
        maps: Radiance of the F frames, in order, [H, 2 H, 3] each.
        tracks: Their lobes.
        balls: White metal with a roughness, and matt white ones without.
    """
    pictures: list[np.ndarray] = []
    errors: list[dict[str, float]] = []
    waiting: list[Tensor] = []
    for frame, radiance in zip(tracks.frames, maps, strict=True):
        errors.append(frame_errors(tracks.at(frame), radiance).values)
        waiting.append(radiance)
        if len(waiting) == BATCH or frame == tracks.frames[-1]:
            drawn = zip(waiting, _balls(waiting, balls), strict=True)
            pictures += [_picture(one, shown) for one, shown in drawn]
            waiting = []
    floor, stops = _range(pictures)
    return Reference(name, [_jpeg(one, floor, stops) for one in pictures], floor, stops, errors)


def _balls(maps: Sequence[Tensor], balls: Sequence[Ball]) -> Tensor:
    """Return the balls of some maps.  [F, B, S, S, 3]."""
    roughness = [ball.roughness for ball in balls if ball.roughness is not None]
    rows = max(len(one) for one in maps)
    whole = torch.stack([latlong.reduce(one, rows, 2 * rows) for one in maps])
    layered = iter(render_balls(whole, roughness, size=BALL).unbind(1))
    matt = _matt(maps)
    return torch.stack([matt if ball.roughness is None else next(layered) for ball in balls], dim=1)


def _matt(maps: Sequence[Tensor]) -> Tensor:
    """Return matt white balls: irradiance over pi, by a sum over texels.  [F, S, S, 3]."""
    share, normals = covered(BALL)
    grid = MATT_ROWS, 2 * MATT_ROWS
    light = torch.stack([latlong.reduce(one, *grid) for one in maps])
    light = light * latlong.texel_solid_angles(*grid)[..., None] / math.pi
    cosine = (normals @ latlong.directions(*grid).reshape(-1, 3).mT).clamp(min=0)
    shown = torch.einsum("pt,ftc->fpc", cosine, light.reshape(len(light), -1, 3)) * share[:, None]
    result = torch.zeros(len(light), BALL * BALL, 3)
    result[:, coverage(BALL).flatten() > 0] = shown
    return result.reshape(-1, BALL, BALL, 3)


def _picture(radiance: Tensor, balls: Tensor) -> np.ndarray:
    """Put the map above its balls.  [H, W, 3], [B, S, S, 3] -> [ROWS + S, ., 3]."""
    above = latlong.reduce(radiance, ROWS, 2 * ROWS).numpy()
    below = np.concatenate(list(balls.numpy()), axis=1)
    width = max(above.shape[1], below.shape[1])
    sides = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0))) for one in (above, below)]
    return np.concatenate(sides)


def _range(pictures: Sequence[np.ndarray]) -> tuple[float, float]:
    """Return floor and stops of a shot."""
    every = np.stack([picture[:ROWS].mean(-1) for picture in pictures])
    lit = every[every > 0]
    floor = float(np.median(lit)) * FLOOR if len(lit) else 1.0
    peak = max(float(picture.max()) for picture in pictures)
    return floor, max(math.log2(1 + peak / floor), 1.0)


def _jpeg(picture: np.ndarray, floor: float, stops: float) -> bytes:
    """Encode a picture."""
    levels = np.log2(1 + picture / floor) / stops
    image = np.rint(255 * np.clip(levels, 0, 1)).astype(np.uint8)
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
