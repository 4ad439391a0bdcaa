# SPDX-License-Identifier: Apache-2.0
"""What the shaders make of lobes, as numbers: for those who hold them against the library."""

import math

import moderngl
import numpy as np
import torch
from torch import Tensor

from asglight.lobes import Lobes
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.gl.context import describe
from asglight.viewer.gl.passes import cover, packed_lobes, pass_program, radiance_target
from asglight.viewer.state.balls import WHITE, Ball
from asglight.viewer.state.viewer_state import MAX_LOBES

COLUMNS = 256
"""Of the target that takes values at directions: every OpenGL has wider ones."""


class LobeProbe:
    """Evaluates and shades lobes with the viewer's shaders, off screen.

    Attributes:
        name: The OpenGL that computes.
        lobes_max: As many lobes are taken at a time.
    """

    lobes_max = MAX_LOBES

    def __init__(self, context: moderngl.Context) -> None:
        """Compile the passes."""
        self.name = describe(context)
        self._context = context
        self._program = pass_program(context, "lobes_at.frag")
        self._program["LobesBlock"].binding = 0
        self._program["u_directions"] = 0
        self._triangle = context.vertex_array(self._program, [])
        self._balls = BallsPass(context, albedo_table(context))

    def radiance(self, lobes: Lobes, directions: Tensor) -> Tensor:
        """Return the radiance from unit directions.

        Args:
            lobes: At most `lobes_max`.  [N, .]
            directions: Rounded to float32 first.  [P, 3]

        Returns:
            Linear RGB, float32.  [P, 3]
        """
        count = len(directions)
        rows = math.ceil(count / COLUMNS)
        padded = np.zeros((rows * COLUMNS, 3), np.float32)
        padded[:count] = directions.numpy()
        texture = self._context.texture((COLUMNS, rows), 3, padded.tobytes(), dtype="f4")
        block = self._context.buffer(packed_lobes(lobes))
        block.bind_to_uniform_block(0)
        texture.use(location=0)
        target = radiance_target(self._context, (COLUMNS, rows))
        cover(self._context, self._triangle, target)
        values = self._read(target)
        return values.reshape(-1, 4)[:count, :3]

    def ball(self, lobes: Lobes, roughness: float | None, size: int) -> Tensor:
        """Return the pixels of a white ball seen from +Z.

        Args:
            lobes: At most `lobes_max`.  [N, .]
            roughness: Of a metal; None for a Lambertian ball.
            size: Pixels across.

        Returns:
            Linear radiance, row 0 at the top, 0 outside the ball.  [size, size, 3]
        """
        albedo = WHITE if roughness is None else (0.0, 0.0, 0.0)
        target = radiance_target(self._context, (size, size))
        target.clear()
        ball = Ball(roughness, albedo=albedo)
        self._balls.draw(lobes, [ball], np.eye(3), [(0, 0, size)], target)
        return self._read(target)[..., :3]

    def _read(self, target: moderngl.Framebuffer) -> Tensor:
        """Read a radiance target, and free what was made for earlier ones.  [H, W, 4]."""
        columns, rows = target.size
        values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
        self._context.gc()
        return torch.from_numpy(values.reshape(rows, columns, 4).copy())
