# SPDX-License-Identifier: Apache-2.0
"""The pass that shades balls by lobes in closed form: shaders/balls.frag.

What it needs of lobes and balls is ball_blocks.py.
"""

from collections.abc import Sequence

import moderngl
import numpy as np
import torch

from asglight.lobes import Lobes, asg
from asglight.shader_files import enum_number
from asglight.shading.sheets import Sheets, amplitudes, sheets
from asglight.viewer.gl.passes import pass_program
from asglight.viewer.state.balls import Ball
from asglight.viewer.uniforms.ball_blocks import Cell, packed
from asglight.viewer.uniforms.shader_defines import DEFINES

_MAX_SHEETS = int(DEFINES["MAX_SHEETS"])

_BLOCKS = ("SheetsBlock", "GgxSheetsBlock", "BallBlock")


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
        light = amplitudes(seen)
        blocks = packed(made, light, balls, cells, _MAX_SHEETS, specialise=self._specialise)
        self._upload(blocks)
        target.use()
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._albedo_table.use(location=0)
        whole = target.viewport
        for index, (x, y, size) in enumerate(cells):
            for binding, (buffer, values) in enumerate(zip(self._blocks, blocks, strict=True)):
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

    def _upload(self, blocks: Sequence[np.ndarray]) -> None:
        """Write the blocks, into larger buffers if there are more balls than ever before."""
        if not self._blocks or self._blocks[0].size < blocks[0].nbytes:
            self._blocks = [self._context.buffer(reserve=values.nbytes) for values in blocks]
        for buffer, values in zip(self._blocks, blocks, strict=True):
            buffer.write(values.tobytes())
