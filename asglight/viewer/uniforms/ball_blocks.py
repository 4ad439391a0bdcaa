# SPDX-License-Identifier: Apache-2.0
"""What shaders/balls.frag needs of lobes and balls, computed in float64 and laid out as its blocks.

Everything that does not depend on the point of a ball is here: moments, half vectors (the camera is
far away, so the view is the same everywhere), weights. Each ball has its own order of the sheets:
first those that it shows by `ggx_lobes.narrow` alone, then those that it shows by both, then those
by `broad` alone, so that neither loop of the shader meets a sheet of no weight.

Symbols: N lobes, M sheets (asglight.shading.sheets), B balls.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from asglight.shader_files import enum_number
from asglight.shading import ggx_layer, ggx_lobes
from asglight.shading.sheets import Sheets
from asglight.viewer.state.balls import Ball

Cell = tuple[int, int, int]
"""x, y and size, in pixels of the target, of a ball's square; y counts from the image's top row."""

SHEET = np.dtype(
    [
        ("axis_z", "<f4", 3),
        ("mean", "<f4"),
        ("spread_x", "<f4", 3),
        ("variance_z", "<f4"),
        ("spread_y", "<f4", 3),
        ("grazing", "<f4"),
        ("light", "<f4", 4),
    ]
)
GGX_SHEET = np.dtype(
    [
        ("axis_x", "<f4", 3),
        ("disc_variance_x", "<f4"),
        ("half_vector", "<f4", 3),
        ("disc_variance_y", "<f4"),
        ("slope_x", "<f4", 3),
        ("narrow", "<f4"),
        ("slope_y", "<f4", 3),
        ("broad", "<f4"),
    ]
)
BALL = np.dtype(
    {
        "names": ["cell", "f0", "base", "runs", "kind", "disc", "kernel"],
        "formats": [
            ("<f4", 4),
            ("<f4", 4),
            ("<f4", 4),
            ("<i4", 4),
            ("<i4", 4),
            "<f4",
            ("<f4", (4 * ggx_lobes.TERMS, 4)),
        ],
        "offsets": [0, 16, 32, 48, 64, 72, 80],
        # Uniform blocks start at multiples of what the driver asks for: at most 256.
        "itemsize": 512,
    }
)
_LAMBERTIAN = 1.0
"""Stands for the roughness of a ball that has no layer."""

_VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


class Runs(NamedTuple):
    """The order in which balls go through the sheets.

    Attributes:
        order: Indices of the sheets.  [B, M]
        narrow_stop: Sheets before it are shown by `narrow`.  [B]
        broad_start: Sheets from it on are shown by `broad`.  [B]
    """

    order: Tensor
    narrow_stop: Tensor
    broad_start: Tensor


def runs(share: Tensor) -> Runs:
    """Sort sheets by what they are shown by.

    Args:
        share: Of `narrow`, exactly 0 or 1 where there is one only.  [B, M]
    """
    group = (share < 1).long() + (share == 0).long()
    order = torch.argsort(group, dim=1, stable=True)
    return Runs(order, (group < 2).sum(1), (group == 0).sum(1))


def packed(
    made: Sheets,
    light: Tensor,
    balls: Sequence[Ball],
    cells: Sequence[Cell],
    room: int,
    *,
    specialise: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay out what every ball needs as the three blocks of shaders/balls.frag (std140).

    Args:
        made: M sheets in the camera's frame.
        light: Their amplitudes.  [M, 3]
        balls: B balls.
        cells: B cells.
        room: MAX_SHEETS of the program: the sheets that a block has room for.
        specialise: Sort the sheets into runs.

    Returns:
        Arrays of structures: two [B, room] and one [B].
    """
    count = len(light)
    roughness = [_LAMBERTIAN if ball.roughness is None else ball.roughness for ball in balls]
    layer = ggx_layer.layer(torch.tensor(roughness, dtype=torch.float64)[:, None])  # [B, 1]
    tilt = ggx_layer.tilt(made, _VIEW, layer)
    share = ggx_layer.share(made, _VIEW, layer)  # [B, M]
    sorted_runs = Runs(
        torch.arange(count).expand(len(balls), -1),
        torch.full((len(balls),), count),
        torch.zeros(len(balls), dtype=torch.long),
    )
    if specialise:
        sorted_runs = runs(share)
    shape = (len(balls), room)
    sheet, ggx_sheet = np.zeros(shape, SHEET), np.zeros(shape, GGX_SHEET)
    _pack_sheets(made, light, tilt, sorted_runs.order, sheet[:, :count])
    kept = ggx_layer.kept(made, _VIEW, layer)
    _pack_ggx_sheets(made, tilt, share, kept, sorted_runs.order, ggx_sheet[:, :count])
    return sheet, ggx_sheet, _packed_balls(made, layer, balls, cells, sorted_runs)


def _pack_sheets(
    made: Sheets, light: Tensor, tilt: ggx_layer.Tilt, order: Tensor, sheet: np.ndarray
) -> None:
    spread = made.axes[:, :2] * made.variance[:, :2, None].sqrt()
    sheet["axis_z"] = made.axes[order, 2]
    sheet["mean"] = made.mean[order]
    sheet["spread_x"], sheet["spread_y"] = spread[order].unbind(2)
    sheet["variance_z"] = made.variance[order, 2]
    sheet["grazing"] = tilt.grazing.gather(1, order)
    sheet["light"][..., :3] = (light * made.integral[:, None] / math.pi)[order]


def _pack_ggx_sheets(
    made: Sheets,
    tilt: ggx_layer.Tilt,
    share: Tensor,
    kept: Tensor,
    order: Tensor,
    ggx_sheet: np.ndarray,
) -> None:
    """Pack what the layer needs; weights are relative to `light`, which holds integral over pi."""
    own = ggx_lobes.disc_mean(made.disc_variance, ggx_lobes.DISC_SCALES[made.window])
    broad = (1 - share) * kept * own.prod(-1).sqrt() * math.pi / made.integral
    each = order[..., None].expand(-1, -1, 3)
    ggx_sheet["axis_x"] = made.axes[order, 0]
    ggx_sheet["disc_variance_x"], ggx_sheet["disc_variance_y"] = made.disc_variance[order].unbind(2)
    ggx_sheet["half_vector"] = tilt.half[order]
    ggx_sheet["slope_x"] = tilt.slope_x.gather(1, each)
    ggx_sheet["slope_y"] = tilt.slope_y.gather(1, each)
    ggx_sheet["narrow"] = (math.pi * share).gather(1, order)
    ggx_sheet["broad"] = broad.gather(1, order)


def _packed_balls(
    made: Sheets,
    layer: ggx_layer.Layer,
    balls: Sequence[Ball],
    cells: Sequence[Cell],
    sorted_runs: Runs,
) -> np.ndarray:
    count = sorted_runs.order.shape[1]
    result = np.zeros(len(balls), BALL)
    stops, starts = sorted_runs.narrow_stop.tolist(), sorted_runs.broad_start.tolist()
    for header, ball, (x, y, size), stop, start in zip(
        result, balls, cells, stops, starts, strict=True
    ):
        layered = ball.roughness is not None
        base_stop = count if any(ball.albedo) else 0
        header["cell"] = x + size / 2, y + size / 2, size / 2, ball.roughness or 0.0
        header["f0"][:3], header["base"][:3] = ball.f0, ball.albedo
        header["runs"] = (stop, start, count, base_stop) if layered else (0, 0, 0, base_stop)
        header["kind"][:2] = enum_number(made.window), layered
    result["f0"][:, 3] = layer.alpha[:, 0]
    result["disc"] = ggx_lobes.DISC_SCALES[made.window]
    result["kernel"] = layer.kernel[:, 0]
    return result
