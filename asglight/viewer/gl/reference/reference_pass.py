# SPDX-License-Identifier: Apache-2.0
"""Balls lit by a latlong map, by the whole integral over the lights: the truth of the viewer.

Rough balls are there at once, from tables (smooth_balls.py). Of the others a few samples a GUI
frame go into a running mean (shaders/reference.frag). docs/method/reference-balls.md has the
methods and their errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
import torch

from asglight.shading import ball_tables
from asglight.shading.ball_tables import CameraMap
from asglight.viewer.gl.passes import pass_program, radiance_target, target_texture
from asglight.viewer.gl.reference.smooth_balls import SmoothBalls, is_exact
from asglight.viewer.reference.reference_map import prepared
from asglight.viewer.state.balls import Ball

TARGET_SAMPLES = 1024
"""Samples of a pixel at which a picture is finished: errors are about 1 %,
docs/method/reference-balls.md."""

Cell = tuple[int, int, int]
"""A ball's square: left column, top row, size in pixels."""


@dataclass
class Accumulation:
    """A picture that samples are added to.

    Attributes:
        balls: What it shows.
        camera_from_world: Rows right, up, view.  [3, 3]
        cells: The square of each ball.
        target: The mean, linear radiance premultiplied by the coverage.
        tables: What rough balls show; None for those that are sampled.
        samples: Samples of each pixel in the mean.
    """

    balls: tuple[Ball, ...]
    camera_from_world: np.ndarray
    cells: tuple[Cell, ...]
    target: moderngl.Framebuffer
    tables: tuple[moderngl.Texture | None, ...]
    samples: int = 0

    @property
    def byte_count(self) -> int:
        """Memory that the target takes: RGBA32F."""
        return 16 * self.target.width * self.target.height


class ReferencePass:
    """Adds samples to a picture of balls under a map.

    It owns one accumulation at a time; `detach` and `resume` move it to and from a ReferenceCache.
    """

    def __init__(self, context: moderngl.Context, albedo_table: moderngl.Texture) -> None:
        """Compile the pass; the table is that of `asglight.viewer.gl.albedo_table`."""
        self._context = context
        self._program = pass_program(context, "reference.frag")
        self._triangle = context.vertex_array(self._program, [])
        self._albedo_table = albedo_table
        self._accumulation: Accumulation | None = None
        self._spare = self._blank((1, 1))
        names = ("u_points", "u_mean", "u_map", "u_sun_texels", "u_rest_diffuse", "u_albedo_table")
        for unit, name in enumerate(names):
            self._program[name] = unit
        self._points = _points(context)
        self._smooth = SmoothBalls(context, albedo_table)
        self._map: tuple[moderngl.Texture, ...] = ()
        self._radiance = np.zeros((1, 2, 3), np.float32)
        self.set_map(self._radiance)

    @property
    def samples(self) -> int:
        """Samples of each pixel so far."""
        return self._current.samples

    @property
    def target_samples(self) -> int:
        """Samples at which the picture is finished."""
        return TARGET_SAMPLES

    @property
    def framebuffer(self) -> moderngl.Framebuffer:
        """The mean so far; another one after each `accumulate`."""
        return self._current.target

    @property
    def texture(self) -> moderngl.Texture:
        """The mean so far: linear radiance, premultiplied by the coverage in the fourth channel."""
        return target_texture(self._current.target)

    def set_map(self, radiance: np.ndarray) -> None:
        """Take a map; samples of another one must not follow in the same picture: `restart`.

        Args:
            radiance: Latlong, finite and not negative, float32, row 0 = +Y.  [H, W, 3]
        """
        ready = prepared(radiance)
        self._radiance = radiance
        rest = _texture(self._context, ready.levels[0])
        rest.build_mipmaps(0, len(ready.levels) - 1)
        for level, values in enumerate(ready.levels[1:], start=1):
            rest.write(values.tobytes(), level=level)
        rest.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.NEAREST
        rest.repeat_x, rest.repeat_y = True, False
        shares = _texture(self._context, ready.shares)
        diffuse = _texture(self._context, ready.diffuse)
        diffuse.filter = moderngl.LINEAR, moderngl.LINEAR
        diffuse.repeat_x, diffuse.repeat_y = True, False
        self._map = rest, shares, diffuse
        self._program["u_sun_density"] = ready.sun_density

    def restart(
        self,
        balls: Sequence[Ball],
        camera_from_world: np.ndarray,
        cells: Sequence[Cell],
        size: tuple[int, int],
    ) -> None:
        """Begin a picture without samples.

        Args:
            balls: One for each cell.
            camera_from_world: Rows right, up, view, orthonormal.  [3, 3]
            cells: Squares in the target, apart from each other; rows count from the top.
            size: Columns and rows of the target.
        """
        assert len(balls) == len(cells), (len(balls), len(cells))
        seen = CameraMap(self._radiance, camera_from_world)
        tables = tuple(
            self._smooth.table(ball_tables.ball(seen, ball.roughness, ball.f0, ball.albedo))
            if is_exact(ball)
            else None
            for ball in balls
        )
        target = self._blank(size)
        rotation = camera_from_world.copy()
        self.resume(Accumulation(tuple(balls), rotation, tuple(cells), target, tables))

    def detach(self) -> Accumulation | None:
        """Hand over the picture, if there is one."""
        detached, self._accumulation = self._accumulation, None
        return detached

    def resume(self, accumulation: Accumulation) -> None:
        """Go on with a picture, of the map that it was begun with; drop the one before."""
        self._accumulation = accumulation
        if self._spare.size != accumulation.target.size:
            self._spare = self._blank(accumulation.target.size)
        # The spare one keeps what it has outside the balls.
        self._spare.clear()

    def accumulate(self, samples: int) -> None:
        """Add samples to each pixel, as far as the picture is not finished."""
        picture = self._current
        samples = min(samples, TARGET_SAMPLES - picture.samples)
        if samples <= 0:
            return
        target = self._spare
        balls = list(zip(picture.balls, picture.cells, picture.tables, strict=True))
        for _, cell, table in balls:
            if table is not None:
                self._smooth.draw_table(table, cell, target)
        self._bind(picture)
        self._program["u_first"] = picture.samples
        self._program["u_samples"] = samples
        target.use()
        self._context.enable_only(moderngl.NOTHING)
        for ball, cell, table in balls:
            if table is None:
                self._draw(ball, cell, target)
        target.viewport = (0, 0, *target.size)
        self._spare, picture.target = picture.target, target
        picture.samples += samples

    @property
    def _current(self) -> Accumulation:
        assert self._accumulation is not None, "restart or resume comes first"
        return self._accumulation

    def _bind(self, picture: Accumulation) -> None:
        """Bind textures and set what all balls share."""
        textures = (self._points, target_texture(picture.target), *self._map, self._albedo_table)
        for unit, texture in enumerate(textures):
            texture.use(location=unit)
        # OpenGL takes columns, and world_from_camera has those that are rows here.
        world_from_camera = picture.camera_from_world.astype(np.float32).tobytes()
        self._program["u_world_from_camera"].write(world_from_camera)

    def _draw(self, ball: Ball, cell: Cell, target: moderngl.Framebuffer) -> None:
        column, row, size = cell
        target.viewport = (column, row, size, size)
        self._program["u_cell"] = cell
        self._program["u_layered"] = ball.roughness is not None
        self._program["u_roughness"] = 1.0 if ball.roughness is None else ball.roughness
        self._program["u_f0"] = ball.f0
        self._program["u_albedo"] = ball.albedo
        self._triangle.render(moderngl.TRIANGLES, vertices=3)

    def _blank(self, size: tuple[int, int]) -> moderngl.Framebuffer:
        target = radiance_target(self._context, size)
        target.clear()
        return target


def _texture(context: moderngl.Context, values: np.ndarray) -> moderngl.Texture:
    """Upload float32 values as they are.  [H, W, channels]."""
    height, width, channels = values.shape
    data = np.ascontiguousarray(values, np.float32)
    return context.texture((width, height), channels, data, dtype="f4")


def _points(context: moderngl.Context) -> moderngl.Texture:
    """Upload Sobol points, as the first 32 binary digits of each coordinate."""
    points = torch.quasirandom.SobolEngine(8).draw(TARGET_SAMPLES, dtype=torch.float64)
    digits = (points * 2.0**32).long().numpy().astype(np.uint32)  # [samples, 8]
    rows = np.stack([digits[:, :4], digits[:, 4:]])
    return context.texture((TARGET_SAMPLES, 2), 4, rows.tobytes(), dtype="u4")
