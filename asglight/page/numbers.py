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
from asglight.luminance import luminance
from asglight.shader_files import enum_number
from asglight.shading.rectified import irradiance_over_pi
from asglight.shading.sheets import Sheets, amplitudes, sheets
from asglight.viewer.state.balls import Ball
from asglight.viewer.uniforms.ball_blocks import BALL, packed
from asglight.viewer.uniforms.map_lobes import widened
from asglight.viewer.uniforms.outlines import half_angles, outlines

MAP_ROWS = 256
"""Of the map, as in the viewer."""

MATTE_GREY = 0.36
"""What the middle of the matte ball shows at the exposure that the page opens with: a stop above
middle grey, where a photographer puts a matte white ball."""

OF_SHEET = ("axis_z", "mean", "spread_x", "variance_z", "spread_y")
OF_GGX_SHEET = ("axis_x", "disc_variance_x", "half_vector", "disc_variance_y")
OF_TILT = ("slope_x", "slope_y")
"""Fields of `ball_blocks` in the order in which the page has them: 11 numbers, after which come
three of the light; 8; and 6, which are those of the first ball: others have them multiplied."""

STRAIGHT = 2.5e-4
"""Of the map's width: a point of an outline that lies nearer to the line between its neighbours is
left out. It is a quarter of a pixel of a map of 1,000."""

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Numbers:
    """A shot as the page's script reads it: frame after frame what is lit, L sheets or lobes.

    Attributes:
        sheets: 11 numbers of `OF_SHEET`, 3 of light, 8 of `OF_GGX_SHEET`, 6 of `OF_TILT`.  [L, 28]
        layers: Of each ball with a layer: what the slopes are multiplied by, the mean of Schlick's
            factor, the weights of both approximations.  [L, B, 4]
        lobes: Of the map: axes, sharpness and amplitude, none narrower than a texel.  [L, 14]
        outlines: Where lit lobes are on the map: of each curve its lobe, how many points, and u
            and v of each in 65535ths. 16 bits, little-endian.
        balls: The blocks of the balls; cells and runs are the page's to fill.
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
    lit = [(shine != 0).any(-1).numpy() for shine in light]
    lit_lobes = [(lobes.amplitude > 0).any(-1).numpy() for lobes in frames]
    pairs = [_frame(one, shine, layered) for one, shine in zip(made, light, strict=True)]
    blocks = packed(
        made[0], light[0], balls, [(0, 0, 1)] * len(balls), len(light[0]), specialise=False
    )[2]
    assert blocks.dtype == BALL
    curves = [_outlines(lobes) for lobes in frames]
    return Numbers(
        np.concatenate([pair[0][mark] for pair, mark in zip(pairs, lit, strict=True)]),
        np.concatenate([pair[1][mark] for pair, mark in zip(pairs, lit, strict=True)]),
        np.concatenate(
            [
                _lobes(widened(lobes, MAP_ROWS))[mark]
                for lobes, mark in zip(frames, lit_lobes, strict=True)
            ]
        ),
        b"".join(curves),
        blocks.tobytes(),
        {
            "form": str(tracks.lobes.form),
            "formNumber": enum_number(tracks.lobes.form),
            "window": enum_number(made[0].window),
            "sheetCount": len(light[0]),
            "lobeCount": tracks.lobes.count,
            "litSheets": [np.flatnonzero(one).tolist() for one in lit],
            "litLobes": [np.flatnonzero(one).tolist() for one in lit_lobes],
            "mapRows": MAP_ROWS,
            "outlineBytes": [len(one) for one in curves],
            "width": [_rounded(torch.rad2deg(half_angles(lobes)).flatten()) for lobes in frames],
            "frames": list(tracks.frames),
            "fps": tracks.fps,
            "names": list(tracks.names),
            "roughness": [ball.roughness for ball in balls],
            "flux": [_rounded(asg.flux(lobes).sum(-1)) for lobes in frames],
            "exposure": round(_exposure(made, light), 2),
        },
    )


def _frame(made: Sheets, light: torch.Tensor, layered: Sequence[Ball]) -> tuple[Array, Array]:
    """Return the numbers of one frame.  [M, 28] and [M, B, 4]."""
    count = len(light)
    cells = [(0, 0, 1)] * len(layered)
    sheet, ggx_sheet, _ = packed(made, light, layered, cells, count, specialise=False)
    shared = [sheet[name][0] for name in OF_SHEET]
    shared.append(sheet["light"][0, :, :3])
    shared += [ggx_sheet[name][0] for name in (*OF_GGX_SHEET, *OF_TILT)]
    own = [_factor(ggx_sheet), sheet["grazing"], ggx_sheet["narrow"], ggx_sheet["broad"]]
    return (
        np.concatenate([values.reshape(count, -1) for values in shared], axis=-1),
        np.stack([values.T for values in own], axis=-1),
    )


def _factor(ggx_sheet: np.ndarray) -> np.ndarray:
    """Return what the slopes of the first ball are multiplied by in each ball: their gain.  [B, M].

    The larger of the two tells; slopes of no length stay so.
    """
    slopes = np.stack([ggx_sheet[name].astype(np.float64) for name in OF_TILT], axis=-2)
    length = np.sqrt((slopes**2).sum((-2, -1)))
    return (length / np.maximum(length[0], 1e-300)).astype(np.float32)


def _lobes(lobes: Lobes) -> Array:
    """Return axes, sharpness and amplitude.  [N, 14]."""
    parts = [lobes.axes.flatten(-2), lobes.sharpness, lobes.amplitude]
    return torch.cat(parts, dim=-1).float().numpy()


def _outlines(lobes: Lobes) -> bytes:
    """Return the curves of lit lobes."""
    curves = []
    for index, outline in enumerate(outlines(lobes)):
        for curve in outline.curves if bool((lobes.amplitude[index] > 0).any()) else ():
            points = np.rint(65535 * np.clip(_thinned(curve), 0, 1)).astype("<u2")
            curves.append(np.array([index, len(points)], "<u2").tobytes() + points.tobytes())
    return b"".join(curves)


def _thinned(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out every second point that the line between its neighbours shows as well.  [K, 2]."""
    before, point, after = curve[:-2:2], curve[1:-1:2], curve[2::2]
    away = np.linalg.norm(point - (before + after) / 2, axis=-1)
    keep = np.ones(len(curve), dtype=bool)
    keep[1 : 1 + 2 * len(away) : 2] = away > STRAIGHT
    return curve[keep]


def _exposure(made: Sequence[Sheets], light: Sequence[torch.Tensor]) -> float:
    """Return the stops that bring the matte ball of the median frame to `MATTE_GREY`, or 0."""
    facing = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    levels = [
        float(luminance(torch.einsum("mp,mc->pc", irradiance_over_pi(one, facing), shine)[0]))
        for one, shine in zip(made, light, strict=True)
    ]
    lit = sorted(level for level in levels if level > 0)
    return math.log2(MATTE_GREY / lit[len(lit) // 2]) if lit else 0.0


def _rounded(values: torch.Tensor) -> list[float]:
    """Return numbers in five digits."""
    return [float(f"{value:.5g}") for value in values.tolist()]
