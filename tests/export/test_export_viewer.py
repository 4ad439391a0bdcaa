# SPDX-License-Identifier: Apache-2.0
"""A program that knows the include alone draws the balls of the viewer.

Tolerance: of each pixel the relative error of the include's albedo, ERROR_MAX (measured: 0.6 of
it), and 1e-4 of the ball's brightest pixel, as of the viewer itself; of all together half of
ERROR_MAX, for the albedo errs to both sides (measured: 0.3 of it where one highlight has most of
the light).
"""

from collections.abc import Callable
from dataclasses import replace

import moderngl
import numpy as np
import pytest
import torch
from include_shader import VERTEX
from lobe_cases import random_lobes
from scipy.spatial.transform import Rotation
from torch import Tensor

from asglight.export.albedo import ERROR_MAX
from asglight.export.environment import BLOCK, environment
from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.lobes.data import stack
from asglight.viewer.gl import passes
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.state.balls import F0_DIELECTRIC, Ball

PIXELS = 64
CAMERA = Rotation.from_euler("yx", [130, 20], degrees=True).as_matrix()
"""Rows right, up and towards the camera."""

BALLS = [
    Ball(roughness, f0, albedo)
    for roughness in (0.05, 0.2, 0.5, 0.7, 1.0)
    for f0, albedo in (((0.9, 0.6, 0.2), (0.0, 0.0, 0.0)), (F0_DIELECTRIC, (0.8, 0.5, 0.2)))
]
FRAGMENT = """
uniform mat3 u_world_from_camera;
uniform float u_roughness;
uniform vec3 u_f0;
uniform vec3 u_base;
layout(location = 0) out vec4 o;
void main() {
    vec2 xy = gl_FragCoord.xy / PIXELS * 2.0 - 1.0;
    xy.y = -xy.y;  // row 0 is the top
    vec3 normal = vec3(xy, sqrt(max(1.0 - dot(xy, xy), 0.0)));
    o = vec4(asglight_shade(u_world_from_camera * normal, u_world_from_camera[2], u_roughness,
                            u_f0, u_base), 1.0);
}
"""


def extreme_lobes(form: Form) -> Lobes:
    """Return lobes of like flux, larger sharpness 1e-3 to 1e6 and ratio 1 to 400.  [N, .]."""
    lobes = random_lobes(form, 15)
    generator = torch.Generator().manual_seed(1)
    unit = torch.rand(2, 15, generator=generator, dtype=torch.float64)
    large = 10 ** (9 * unit[0] - 3)
    small = large if form is Form.SG else (large / 400 ** unit[1]).clamp(min=1e-3)
    shaped = replace(lobes, sharpness=torch.stack([large, small], dim=-1))
    return replace(shaped, amplitude=lobes.amplitude / asg.integral(shaped)[:, None])


def by_viewer(opengl: moderngl.Context) -> Callable[[Lobes, Ball], Tensor]:
    target = passes.radiance_target(opengl, (PIXELS, PIXELS))
    balls_pass = BallsPass(opengl, albedo_table(opengl))

    def draw(lobes: Lobes, ball: Ball) -> Tensor:
        target.clear()
        balls_pass.draw(lobes, [ball], CAMERA, [(0, 0, PIXELS)], target)
        return pixels(target)

    return draw


def by_include(opengl: moderngl.Context, include: str) -> Callable[[Ball], Tensor]:
    fragment = f"#version 330 core\n{include}\n{FRAGMENT.replace('PIXELS', f'{PIXELS}.0')}"
    program = opengl.program(vertex_shader=f"#version 330 core\n{VERTEX}", fragment_shader=fragment)
    if BLOCK in program:
        program[BLOCK].binding = 0
    triangle = opengl.vertex_array(program, [])
    target = passes.radiance_target(opengl, (PIXELS, PIXELS))
    # OpenGL stores columns, and those of world from camera are the rows of the camera.
    program["u_world_from_camera"].write(CAMERA.astype("f4").tobytes())

    def draw(ball: Ball) -> Tensor:
        assert ball.roughness is not None
        program["u_roughness"] = ball.roughness
        program["u_f0"], program["u_base"] = ball.f0, ball.albedo
        target.use()
        opengl.enable_only(moderngl.NOTHING)
        triangle.render(moderngl.TRIANGLES, vertices=3)
        return pixels(target)

    return draw


def pixels(target: moderngl.Framebuffer) -> Tensor:
    values = np.frombuffer(target.read(components=3, dtype="f4"), np.float32)
    return torch.from_numpy(values.copy()).double().reshape(PIXELS, PIXELS, 3)


def inside() -> Tensor:
    """Tell which pixels the ball covers whole: its edge is antialiased, from n.v = 0.18 down."""
    centre = (2 * torch.arange(PIXELS).double() + 1) / PIXELS - 1
    y, x = torch.meshgrid(centre, centre, indexing="ij")
    return torch.hypot(x, y) < 1 - 1 / PIXELS


def assert_same_ball(found: Tensor, expected: Tensor) -> None:
    found, expected = found[inside()], expected[inside()]
    brightest = expected.max()
    assert brightest > 0.01
    assert ((found - expected).abs() <= ERROR_MAX * expected + 1e-4 * brightest).all()
    assert abs(found.sum() / expected.sum() - 1) < 0.5 * ERROR_MAX


@pytest.mark.parametrize("form", Form)
def test_balls_of_the_include_are_those_of_the_viewer(opengl: moderngl.Context, form: Form) -> None:
    lobes = extreme_lobes(form)
    made = environment(LobeTracks((1,), 24.0, stack([lobes])), "a.f32")
    draw, viewer = by_include(opengl, made.text), by_viewer(opengl)
    for ball in BALLS:
        assert_same_ball(draw(ball), viewer(lobes, ball))


def test_balls_of_each_frame_are_those_of_the_viewer(opengl: moderngl.Context) -> None:
    frames = [random_lobes(Form.ASG, 15, seed=seed) for seed in range(3)]
    made = environment(LobeTracks((1, 2, 4), 24.0, stack(frames)), "a.f32")
    assert made.blocks is not None
    draw, viewer = by_include(opengl, made.text), by_viewer(opengl)
    buffer = opengl.buffer(reserve=made.blocks[0].nbytes)
    for lobes, block in zip(frames, made.blocks, strict=True):
        buffer.write(block.tobytes())
        buffer.bind_to_uniform_block(0)  # where the viewer has blocks of its own
        assert_same_ball(draw(BALLS[4]), viewer(lobes, BALLS[4]))
