# SPDX-License-Identifier: Apache-2.0
"""The pass that shades balls by lobes in closed form: shaders/balls.frag.

Everything that does not depend on the point of a ball is computed here in float64: moments, half
vectors (the camera is far away, so the view is the same everywhere), weights. Each ball has its own
order of the sheets: first those that it shows by `ggx_lobes.narrow` alone, then those that it shows
by both, then those by `broad` alone, so that neither loop of the shader meets a sheet of no weight.

Symbols: N lobes, M sheets (asglight.shading.sheets), B balls.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import moderngl
import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.shader_files import enum_number
from asglight.shading import ggx_layer, ggx_lobes
from asglight.shading.sheets import Sheets, amplitudes, sheets
from asglight.viewer.gl.passes import DEFINES, pass_program
from asglight.viewer.state.balls import Ball

Cell = tuple[int, int, int]
"""x, y and size, in pixels of the target, of a ball's square; y counts from the image's top row."""

_MAX_SHEETS = int(DEFINES["MAX_SHEETS"])

_SHEET = np.dtype(
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
_GGX_SHEET = np.dtype(
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
_BALL = np.dtype(
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
_BLOCKS = ("SheetsBlock", "GgxSheetsBlock", "BallBlock")


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


class BallsPass:
    """Lobes -> balls: linear radiance (shaders/balls.frag)."""

    def __init__(
        self, context: moderngl.Context, albedo_table: moderngl.Texture, *, specialise: bool = True
    ) -> None:
        """Prepare the pass; a program is compiled when a scene first needs it.

        Args:
            context: Where to draw.
            albedo_table: From `albedo_table.albedo_table`.
            specialise: Leave out of programs and loops what a scene does not need. False gives the
                one program with every branch, for comparison.
        """
        self._context = context
        self._albedo_table = albedo_table
        self._specialise = specialise
        self._triangles: dict[tuple[tuple[str, int], ...], moderngl.VertexArray] = {}
        self._blocks: list[moderngl.Buffer] = []

    def draw(
        self,
        lobes: Lobes,
        balls: Sequence[Ball],
        camera_from_world: np.ndarray,
        cells: Sequence[Cell],
        target: moderngl.Framebuffer,
    ) -> None:
        """Draw balls over what a radiance target holds.

        A pixel that a ball covers in part keeps the other part of what was there: radiance and
        alpha are blended as premultiplied by coverage.

        Args:
            lobes: N lobes of the world; without light they cost nothing.  [N, .]
            balls: B balls.
            camera_from_world: Rows right, up and towards the camera.  [3, 3]
            cells: Where the B balls are drawn.
            target: RGBA32F.
        """
        lit = lobes.to(torch.float64)
        lit = lit.select((lit.amplitude > 0).any(-1))
        seen = asg.rotate(lit, torch.from_numpy(np.asarray(camera_from_world, dtype=np.float64)))
        made = sheets(seen)
        triangle = self._triangle(made)
        packed = _packed(made, amplitudes(seen), balls, cells, self._specialise)
        self._upload(packed)
        target.use()
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._albedo_table.use(location=0)
        whole = target.viewport
        for index, (x, y, size) in enumerate(cells):
            for binding, (buffer, values) in enumerate(zip(self._blocks, packed, strict=True)):
                each = values[0].nbytes
                buffer.bind_to_uniform_block(binding, offset=index * each, size=each)
            target.viewport = x, y, size, size
            triangle.render(moderngl.TRIANGLES, vertices=3)
        target.viewport = whole

    def _triangle(self, made: Sheets) -> moderngl.VertexArray:
        """Return the program of a scene, with what it draws; compile it if it is new."""
        special: dict[str, int] = {}
        if self._specialise:
            special["WINDOW"] = enum_number(made.window)
            if bool((made.disc_variance[:, 0] == made.disc_variance[:, 1]).all()):
                special["ISOTROPIC"] = 1
        key = tuple(special.items())
        if key not in self._triangles:
            program = pass_program(self._context, "balls.frag", special)
            for binding, block in enumerate(_BLOCKS):
                program[block].binding = binding
            program["u_albedo_table"] = 0
            self._triangles[key] = self._context.vertex_array(program, [])
        return self._triangles[key]

    def _upload(self, packed: Sequence[np.ndarray]) -> None:
        """Write the blocks, into larger buffers if there are more balls than ever before."""
        if not self._blocks or self._blocks[0].size < packed[0].nbytes:
            for buffer in self._blocks:
                buffer.release()
            self._blocks = [self._context.buffer(reserve=values.nbytes) for values in packed]
        for buffer, values in zip(self._blocks, packed, strict=True):
            buffer.write(values.tobytes())


def runs(share: Tensor) -> Runs:
    """Sort sheets by what they are shown by.

    Args:
        share: Of `narrow`, exactly 0 or 1 where there is one only.  [B, M]
    """
    group = (share < 1).long() + (share == 0).long()
    order = torch.argsort(group, dim=1, stable=True)
    return Runs(order, (group < 2).sum(1), (group == 0).sum(1))


def _packed(
    made: Sheets, light: Tensor, balls: Sequence[Ball], cells: Sequence[Cell], specialise: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay out what every ball needs as the three blocks of shaders/balls.frag (std140).

    Args:
        made: M sheets in the camera's frame.
        light: Their amplitudes.  [M, 3]
        balls: B balls.
        cells: B cells.
        specialise: Sort the sheets into runs.

    Returns:
        Arrays of structures: two [B, MAX_SHEETS] and one [B].
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
    shape = (len(balls), _MAX_SHEETS)
    sheet, ggx_sheet = np.zeros(shape, _SHEET), np.zeros(shape, _GGX_SHEET)
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
    result = np.zeros(len(balls), _BALL)
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
