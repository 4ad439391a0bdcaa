# SPDX-License-Identifier: Apache-2.0
"""A ball and a post on the ground: shaders/ground.frag, with balls.frag in between."""

from typing import Any

import moderngl
import numpy as np
import torch

from asglight.lobes import Lobes, asg
from asglight.shader_files import enum_number
from asglight.shading.sheets import amplitudes, sheets
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.passes import cover, pass_program
from asglight.viewer.state.balls import Ball
from asglight.viewer.state.camera import Camera
from asglight.viewer.uniforms import ground_blocks
from asglight.viewer.uniforms.ground_blocks import SHEET, ground_view, packed_ground
from asglight.viewer.uniforms.shader_defines import DEFINES

_UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)


class GroundPass:
    """Lobes -> a ball and a post on the ground, with their shadows: linear radiance."""

    def __init__(self, context: moderngl.Context, balls_pass: BallsPass) -> None:
        """Take the pass that draws the ball; programs are compiled when a scene needs them."""
        self._context = context
        self._balls_pass = balls_pass
        self._triangles: dict[tuple[tuple[str, int], ...], moderngl.VertexArray] = {}
        self._block = context.buffer(reserve=int(DEFINES["MAX_SHEETS"]) * SHEET.itemsize)

    def draw(self, lobes: Lobes, ball: Ball, camera: Camera, target: moderngl.Framebuffer) -> None:
        """Draw the scene over all of a radiance target.

        Args:
            lobes: N lobes of the environment.
            ball: What the ball is made of.
            camera: Its yaw, its pitch over the row of balls, and the environment's turn.
            target: RGBA32F.
        """
        view = ground_view(target.size, camera.yaw_deg, camera.pitch_deg)
        lit = lobes.to(torch.float64)
        lit = lit.select((lit.amplitude > 0).any(-1))
        level = Camera(camera.yaw_deg, 0.0, camera.environment_deg).from_environment()
        seen = asg.rotate(lit, torch.from_numpy(level))
        made, light = sheets(seen), amplitudes(seen)
        special = {"WINDOW": enum_number(made.window)}
        self._draw(packed_ground(made, light, _UP), special, view, target)
        tilted = np.degrees(view.pitch) - ground_blocks.PITCH_DEG
        rotation = Camera(
            camera.yaw_deg, float(tilted) + ground_blocks.PITCH_DEG, camera.environment_deg
        ).from_environment()
        self._balls_pass.draw(lobes, [ball], rotation, [view.ball_cell], target)
        self._context.enable_only(moderngl.BLEND)
        self._draw(packed_ground(made, light, None), {**special, "POST": 1}, view, target)

    def _draw(
        self,
        block: np.ndarray,
        special: dict[str, int],
        view: ground_blocks.GroundView,
        target: moderngl.Framebuffer,
    ) -> None:
        triangle = self._triangle(special)
        self._block.orphan()
        self._block.write(block.tobytes() or bytes(SHEET.itemsize))
        self._block.bind_to_uniform_block(0)
        values: dict[str, Any] = {
            "u_count": len(block),
            "u_base": ground_blocks.BASE,
            "u_middle": view.middle,
            "u_unit": view.unit,
            "u_focus": ground_blocks.FOCUS,
            "u_pitch_sine": np.sin(view.pitch),
            "u_pitch_cosine": np.cos(view.pitch),
            "u_ball": ground_blocks.BALL,
            "u_foot": view.foot,
            "u_post": ground_blocks.POST,
        }
        for name, value in values.items():
            triangle.program[name] = value
        if "POST" not in special:
            cover(self._context, triangle, target)
            return
        target.use()
        target.viewport = (0, 0, *target.size)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        triangle.render(moderngl.TRIANGLES, vertices=3)

    def _triangle(self, special: dict[str, int]) -> moderngl.VertexArray:
        """Return a program with what it draws; compile it if it is new."""
        key = tuple(special.items())
        if key not in self._triangles:
            program = pass_program(self._context, "ground.frag", special)
            program["GroundBlock"].binding = 0
            self._triangles[key] = self._context.vertex_array(program, [])
        return self._triangles[key]
