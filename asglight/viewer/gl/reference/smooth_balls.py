# SPDX-License-Identifier: Apache-2.0
"""Balls under a map without samples: shaders/smooth_ball.frag.

Rough balls are exact enough to be the truth (shading/ball_tables.py). Sharper ones are a preview:
what is shown of the reference while something moves, when noise would hide what moves.
"""

import moderngl
import numpy as np

from asglight.shading import ball_tables
from asglight.viewer.gl.passes import Area, cover, pass_program
from asglight.viewer.state.balls import Ball

Cell = tuple[int, int, int]
"""A ball's square: left column, top row, size in pixels."""


EXACT_ROUGHNESS = 0.5
"""From which a table is the truth. Sharper balls have highlights that differ within a pixel, whose
mean samples find; tables have the value in its middle."""


def is_exact(ball: Ball) -> bool:
    """Tell whether a ball is so rough that a table is the truth."""
    return ball.roughness is None or ball.roughness >= EXACT_ROUGHNESS


def is_tabled(ball: Ball) -> bool:
    """Tell whether a ball is so rough that a table shows it, at least in motion."""
    return ball.roughness is None or ball.roughness >= ball_tables.ROUGHNESS_MIN


class SmoothBalls:
    """Draws balls from tables and from the levels of a map."""

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Prepare the pass; its programs are compiled when they are first needed."""
        self._context = context
        self._albedo_table = albedo_table
        self._triangles: dict[bool, moderngl.VertexArray] = {}

    def table(self, values: np.ndarray) -> moderngl.Texture:
        """Upload what a ball shows at the normals of its grid, float32 [N, C, 3]."""
        rows, columns, _ = values.shape
        texture = self._context.texture((columns, rows), 3, values.tobytes(), dtype="f4")
        texture.filter = moderngl.LINEAR, moderngl.LINEAR
        texture.repeat_x, texture.repeat_y = True, False
        return texture

    def draw_table(self, table: moderngl.Texture, cell: Cell, target: moderngl.Framebuffer) -> None:
        """Draw a ball from its table."""
        triangle = self._triangle(is_table=True)
        table.use(location=0)
        triangle.program["u_cell"] = cell
        cover(self._context, triangle, target, _square(cell))

    def draw_levels(
        self,
        ball: Ball,
        latlong: moderngl.Texture,
        irradiance: moderngl.Texture,
        camera_from_world: np.ndarray,
        cell: Cell,
        target: moderngl.Framebuffer,
    ) -> None:
        """Draw a ball with a layer from a map's levels.

        Args:
            ball: What it is made of.
            latlong: The map, filtered between its levels.
            irradiance: The table of irradiance over pi.
            camera_from_world: Rows right, up, view.  [3, 3]
            cell: Where it is drawn.
            target: A radiance target.
        """
        triangle = self._triangle(is_table=False)
        program = triangle.program
        irradiance.use(location=0)
        latlong.use(location=1)
        self._albedo_table.use(location=2)
        # OpenGL takes columns, and world_from_camera has those that are rows here.
        program["u_world_from_camera"].write(camera_from_world.astype(np.float32).tobytes())
        program["u_cell"] = cell
        program["u_roughness"] = ball.roughness
        program["u_f0"], program["u_albedo"] = ball.f0, ball.albedo
        cover(self._context, triangle, target, _square(cell))

    def _triangle(self, *, is_table: bool) -> moderngl.VertexArray:
        """Return a program with what it draws; compile it if it is new."""
        if is_table not in self._triangles:
            program = pass_program(
                self._context, "smooth_ball.frag", {"TABLE": 1} if is_table else {}
            )
            for unit, name in enumerate(("u_table", "u_map", "u_albedo_table")):
                if name in program:
                    program[name] = unit
            self._triangles[is_table] = self._context.vertex_array(program, [])
        return self._triangles[is_table]


def _square(cell: Cell) -> Area:
    column, row, size = cell
    return column, row, size, size
