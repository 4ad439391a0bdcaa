# SPDX-License-Identifier: Apache-2.0
"""What the page's shaders need of every frame, as arrays of float32, and what it prints.

Balls are seen from +Z with +Y up, as the viewer opens. The page puts sheets of lobes that are lit
and shown into the order in which a ball goes through them, as `ball_blocks.runs`.

Dimension letters: F frames, N lobes, M sheets, B balls.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from asglight.lobes import Lobes, LobeTracks, asg
from asglight.shader_files import enum_number
from asglight.shading.rectified import irradiance_over_pi
from asglight.shading.sheets import Sheets, amplitudes, sheets
from asglight.sphere import latlong
from asglight.viewer.ball_blocks import BALL, packed
from asglight.viewer.balls import Ball
from asglight.viewer.display import LUMINANCE
from asglight.viewer.map_lobes import widened
from asglight.viewer.outlines import half_angles, outlines

MAP_ROWS = 256
"""Of the map, as in the viewer."""

MATT_GREY = 0.36
"""What the middle of the matt ball shows at the exposure that the page opens with: a stop above
middle grey, where a photographer puts a matt white ball."""

OF_SHEET = ("axis_z", "mean", "spread_x", "variance_z", "spread_y")
OF_GGX_SHEET = ("axis_x", "disc_variance_x", "half_vector", "disc_variance_y")
OF_BALL = ("slope_x", "slope_y", "narrow", "broad")
"""Fields of `ball_blocks`, in the order in which the page has them: 11 numbers, after which come
three of the light; 8; and, after the mean of Schlick's factor, 8."""

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Numbers:
    """A shot as the page's script reads it.

    Attributes:
        sheets: Of every frame: 11 of `OF_SHEET`, 3 of light, 8 of `OF_GGX_SHEET`.  [F, M, 22]
        layers: Of every frame and ball with a layer: 1 + 8 numbers.  [F, B, M, 9]
        lobes: Of the map: axes, sharpness and amplitude, none narrower than a texel.  [F, N, 14]
        outlines: Where lit lobes are on the map: of each curve its lobe, its count of points, and
            u and v of each in 65535ths. 16 bits, little-endian, frame after frame.
        balls: The blocks of the balls; cells and runs are the page's to fill.  bytes
        document: What there is besides, as JSON values.
    """

    sheets: Array
    layers: Array
    lobes: Array
    outlines: bytes
    balls: bytes
    document: dict[str, Any]


def numbers_of(tracks: LobeTracks, balls: Sequence[Ball]) -> Numbers:
    """Compute what a page needs of tracks.

    Args:
        tracks: Lobes of F frames.
        balls: Those that have a layer first.
    """
    layered = [ball for ball in balls if ball.roughness is not None]
    frames = [tracks.lobes[place].to("cpu", torch.float64) for place in range(len(tracks.frames))]
    made = [sheets(lobes) for lobes in frames]
    light = [amplitudes(lobes) for lobes in frames]
    pairs = [_frame(one, shine, layered) for one, shine in zip(made, light, strict=True)]
    cells = [(0, 0, 1)] * len(balls)
    blocks = packed(made[0], light[0], balls, cells, light[0].shape[0], specialise=False)[2]
    assert blocks.dtype == BALL
    window = made[0].window
    curves = [_outlines(lobes) for lobes in frames]
    return Numbers(
        np.stack([pair[0] for pair in pairs]),
        np.stack([pair[1] for pair in pairs]),
        np.stack([_lobes(widened(lobes, MAP_ROWS)) for lobes in frames]),
        b"".join(curves),
        blocks.tobytes(),
        {
            "form": str(tracks.lobes.form),
            "formNumber": enum_number(tracks.lobes.form),
            "window": enum_number(window),
            "sheetCount": int(light[0].shape[0]),
            "lobeCount": tracks.lobes.count,
            "mapRows": MAP_ROWS,
            "outlineBytes": [len(one) for one in curves],
            "direction": [_rounded(_latlong_of(lobes).flatten()) for lobes in frames],
            "width": [_rounded(torch.rad2deg(half_angles(lobes)).flatten()) for lobes in frames],
            "frames": list(tracks.frames),
            "fps": tracks.fps,
            "names": list(tracks.names),
            "roughness": [ball.roughness for ball in balls],
            "flux": [_rounded(asg.flux(lobes) @ _luminance()) for lobes in frames],
            "exposure": round(_exposure(made, light), 2),
        },
    )


def _frame(made: Sheets, light: torch.Tensor, layered: Sequence[Ball]) -> tuple[Array, Array]:
    """Return the numbers of one frame.  [M, 22] and [B, M, 9]."""
    count = len(light)
    cells = [(0, 0, 1)] * len(layered)
    sheet, ggx_sheet, _ = packed(made, light, layered, cells, count, specialise=False)
    shared = [sheet[name][0] for name in OF_SHEET]
    shared += [sheet["light"][0, :, :3], *(ggx_sheet[name][0] for name in OF_GGX_SHEET)]
    own = [sheet["grazing"], *(ggx_sheet[name] for name in OF_BALL)]
    return (
        np.concatenate([values.reshape(count, -1) for values in shared], axis=-1),
        np.concatenate([values.reshape(len(layered), count, -1) for values in own], axis=-1),
    )


def _lobes(lobes: Lobes) -> Array:
    """Return axes, sharpness and amplitude.  [N, 14]."""
    parts = [lobes.axes.flatten(-2), lobes.sharpness, lobes.amplitude]
    return torch.cat(parts, dim=-1).float().numpy()


def _outlines(lobes: Lobes) -> bytes:
    """Return the curves of lit lobes."""
    curves = []
    for index, outline in enumerate(outlines(lobes)):
        for curve in outline.curves if bool((lobes.amplitude[index] > 0).any()) else ():
            points = np.rint(65535 * np.clip(curve, 0, 1)).astype("<u2")
            curves.append(np.array([index, len(points)], "<u2").tobytes() + points.tobytes())
    return b"".join(curves)


def _latlong_of(lobes: Lobes) -> torch.Tensor:
    """Return u and v of each lobe's direction.  [N, 2]."""
    return torch.stack(latlong.uv_from_direction(lobes.axis_z), dim=-1)


def _exposure(made: Sequence[Sheets], light: Sequence[torch.Tensor]) -> float:
    """Return the stops that bring the matt ball of the median frame to `MATT_GREY`; 0 for black."""
    facing = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    levels = [
        float(torch.einsum("mp,mc->pc", irradiance_over_pi(one, facing), shine)[0] @ _luminance())
        for one, shine in zip(made, light, strict=True)
    ]
    lit = sorted(level for level in levels if level > 0)
    return math.log2(MATT_GREY / lit[len(lit) // 2]) if lit else 0.0


def _luminance() -> torch.Tensor:
    return torch.tensor(LUMINANCE, dtype=torch.float64)


def _rounded(values: torch.Tensor) -> list[float]:
    """Return numbers in five digits."""
    return [float(f"{value:.5g}") for value in values.tolist()]
