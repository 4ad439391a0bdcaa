# SPDX-License-Identifier: Apache-2.0
"""The balls that the GPU shades equal the library's in float64.

Tolerance: 1e-4 of a ball's brightest pixel. Measured on llvmpipe: 5.1e-5 at most, in the sum over
the ball 1.7e-5; what is left are the digits of float32 where a highlight is a few pixels wide.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import moderngl
import numpy as np
import pytest
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, asg, frames
from asglight.shading import ggx_layer, ggx_lobes, rectified
from asglight.shading.balls import coverage
from asglight.shading.sheets import amplitudes, sheets
from asglight.viewer.gl import passes
from asglight.viewer.gl.albedo_table import SIZE, albedo_table
from asglight.viewer.gl.balls_pass import BallsPass
from asglight.viewer.state.balls import Ball, Material, ball_row
from asglight.viewer.state.viewer_state import MAX_LOBES, lobes_max

TOLERANCE = 1e-4
BALLS = (
    *ball_row(Material.METAL, (0.9, 0.6, 0.2)),
    *ball_row(Material.DIELECTRIC, (0.8, 0.5, 0.2)),
)
VIEW = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
PIXELS = 32


def random_lobes(form: Form, count: int, seed: int = 0) -> Lobes:
    """Return lobes of like flux, larger sharpness 1e-3 to 1e6 and ratio 1 to 400.  [N, .]."""
    generator = torch.Generator().manual_seed(seed)
    unit = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    large = 10 ** (9 * unit[:, 0] - 3)
    small = large if form is Form.SG else (large / 400 ** unit[:, 1]).clamp(min=1e-3)
    axes = frames.axes_from_quaternion(
        torch.randn(count, 4, generator=generator, dtype=torch.float64)
    )
    colour = 0.1 + torch.rand(count, 3, generator=generator, dtype=torch.float64)
    lobes = Lobes(axes, torch.stack([large, small], dim=-1), colour, form)
    return replace(lobes, amplitude=colour / asg.integral(lobes)[:, None])


def one_lobe(direction: Sequence[float], sharpness: float, form: Form = Form.ASG) -> Lobes:
    axis_z = torch.nn.functional.normalize(torch.tensor([direction]).double(), dim=-1)
    axes = frames.axes_around(axis_z)
    return Lobes(axes, torch.full((1, 2), sharpness).double(), torch.ones(1, 3).double(), form)


def drawn(
    opengl: moderngl.Context,
    lobes: Lobes,
    balls: Sequence[Ball] = BALLS,
    size: int = PIXELS,
    *,
    camera: np.ndarray | None = None,
    specialise: bool = True,
) -> Tensor:
    """Draw balls side by side and take them apart again.  [B, size, size, 4]."""
    target = passes.radiance_target(opengl, (size * len(balls), size))
    target.clear()
    cells = [(index * size, 0, size) for index in range(len(balls))]
    balls_pass = BallsPass(opengl, albedo_table(opengl), specialise=specialise)
    balls_pass.draw(lobes, balls, np.eye(3) if camera is None else camera, cells, target)
    values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
    return (
        torch.from_numpy(values.reshape(size, len(balls), size, 4).copy()).double().transpose(0, 1)
    )


def ball_points(size: int) -> tuple[Tensor, Tensor]:
    """Return normals in the middle of what is covered of each pixel, and how much that is."""
    centre = (2 * torch.arange(size).double() + 1) / size - 1
    y, x = torch.meshgrid(-centre, centre, indexing="ij")
    distance, pixel = torch.hypot(x, y), 2 / size
    covered = ((1 - distance) / pixel + 0.5).clamp(0, 1)
    inner = torch.minimum(distance, 0.5 * (distance + 1 - 0.5 * pixel))
    z = (1 - inner * inner).clamp(min=0).sqrt()
    scale = torch.where(distance > 0, inner / distance.clamp(min=1e-9), 1.0)
    return torch.stack([x * scale, y * scale, z], dim=-1), covered


def looked_up(opengl: moderngl.Context, cos_view: Tensor, roughness: float) -> Tensor:
    """Read the albedo from the shaders' table, linear between its samples' roots.  [P, 2]."""
    table = np.frombuffer(albedo_table(opengl).read(), np.float32).reshape(SIZE, SIZE, 2)
    values = torch.from_numpy(table.copy()).double()
    x, y = cos_view.sqrt() * (SIZE - 1), roughness**0.5 * (SIZE - 1)
    column, row = x.long().clamp(max=SIZE - 2), min(int(y), SIZE - 2)
    lower = torch.lerp(values[row], values[row + 1], y - row)  # [SIZE, 2]
    return torch.lerp(lower[column], lower[column + 1], (x - column)[:, None])


def expected(opengl: moderngl.Context, lobes: Lobes, ball: Ball, size: int = PIXELS) -> Tensor:
    """Shade a ball with the library.  [size, size, 4]."""
    normals, covered = ball_points(size)
    inside = covered > 0
    n = normals[inside]
    made, light = sheets(lobes), amplitudes(lobes)
    base = torch.einsum("mp,mc->pc", rectified.irradiance_over_pi(made, n), light)
    radiance = base * torch.tensor(ball.albedo).double()
    if ball.roughness is not None:
        albedo = looked_up(opengl, n[:, 2].clamp(min=ggx_lobes.COS_VIEW_MIN), ball.roughness)
        f0 = torch.tensor(ball.f0).double()
        layer = ggx_layer.layer(torch.tensor(ball.roughness).double())
        shown = ggx_lobes.reflected(made, n, VIEW, layer, f0, albedo)
        radiance = radiance * (1 - (albedo[:, :1] * f0 + albedo[:, 1:]))
        radiance = radiance + torch.einsum("mpc,mc->pc", shown, light)
    result = torch.zeros(size, size, 4, dtype=torch.float64)
    result[inside] = torch.cat([radiance, torch.ones(len(n), 1)], dim=-1) * covered[inside, None]
    return result


def assert_close(actual: Tensor, reference: Tensor) -> None:
    """Compare balls [B, size, size, 4], each relative to its brightest pixel."""
    assert actual.isfinite().all()
    brightest = reference.amax((1, 2, 3), keepdim=True)
    error = ((actual - reference).abs() / brightest).amax((1, 2, 3))
    assert (error <= TOLERANCE).all(), error


@pytest.mark.parametrize("count", [1, 15, MAX_LOBES])
@pytest.mark.parametrize("form", Form)
def test_balls_equal_the_library(opengl: moderngl.Context, form: Form, count: int) -> None:
    count = min(count, lobes_max(form))
    size = PIXELS if count < lobes_max(form) else PIXELS // 2  # the library takes the most of it
    lobes = random_lobes(form, count, seed=count)
    reference = torch.stack([expected(opengl, lobes, ball, size) for ball in BALLS])
    assert_close(drawn(opengl, lobes, size=size), reference)


@pytest.mark.parametrize("form", Form)
@pytest.mark.parametrize("round_lobes", [True, False])
def test_specialised_programs_draw_what_the_general_one_draws(
    opengl: moderngl.Context, form: Form, round_lobes: bool
) -> None:
    lobes = random_lobes(form, 15)
    if round_lobes:
        lobes = replace(lobes, sharpness=lobes.sharpness[:, :1].expand(-1, 2).contiguous())
    general = drawn(opengl, lobes, specialise=False)
    assert_close(drawn(opengl, lobes), general)
    assert general.amax() > 0


@pytest.mark.parametrize("sharpness", [1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("form", Form)
def test_no_light_makes_a_pixel_infinite(
    opengl: moderngl.Context, form: Form, sharpness: float
) -> None:
    # Straight behind, at the camera, along a reflection, on the horizon; an odd size has n || v.
    for direction in ((0, 0, -1), (0, 0, 1), (0.6, 0, 0.8), (1, 0, 0), (1e-7, 0, -1)):
        image = drawn(opengl, one_lobe(direction, sharpness, form), size=33)
        assert image.isfinite().all()
        assert (image >= 0).all()


def test_no_lobes_make_black_balls(opengl: moderngl.Context) -> None:
    image = drawn(opengl, random_lobes(Form.ASG, 0), size=64)
    assert (image[..., :3] == 0).all()
    # 8 x 8 points of a pixel against the distance of its centre: 0.07 where the edge is diagonal
    # and reaches the pixel's corners, and one point of 64.
    assert (image[0, ..., 3] - coverage(64)).abs().max() < 0.09


def test_lobes_without_light_change_nothing(opengl: moderngl.Context) -> None:
    lobes = random_lobes(Form.ASG, 6)
    lit = torch.tensor([True, False, True, True, False, True])
    muted = replace(lobes, amplitude=lobes.amplitude * lit[:, None])
    assert torch.equal(drawn(opengl, muted), drawn(opengl, lobes.select(lit)))


def test_the_camera_turns_the_lights(opengl: moderngl.Context) -> None:
    lobes = random_lobes(Form.ASG, 15)
    turn = frames.axes_from_quaternion(torch.tensor([0.5, -0.3, 0.7, 0.2]).double())
    seen = drawn(opengl, lobes, camera=turn.numpy())
    assert_close(seen, drawn(opengl, asg.rotate(lobes, turn)))
    assert (seen - drawn(opengl, lobes)).abs().max() > 0.1


@pytest.mark.parametrize(
    ("direction", "place"),
    [((0, 1, 1), "top"), ((0, -1, 1), "bottom"), ((1, 0, 1), "right"), ((-1, 0, 1), "left")],
)
def test_a_light_shows_on_its_own_side(
    opengl: moderngl.Context, direction: tuple[float, float, float], place: str
) -> None:
    image = drawn(opengl, one_lobe(direction, 100.0), [Ball(0.25)], 64)[0, ..., 0]
    row, column = divmod(int(image.argmax()), 64)
    # The normal lies half way between view and light: 22.5 degrees off.
    offset = round(32 * math.sin(math.pi / 8))
    centre = {
        "top": (32 - offset, 32),
        "bottom": (32 + offset, 32),
        "right": (32, 32 + offset),
        "left": (32, 32 - offset),
    }[place]
    assert (row, column) == pytest.approx(centre, abs=1.5)


def test_balls_fill_their_cells_over_a_background(opengl: moderngl.Context) -> None:
    target = passes.radiance_target(opengl, (80, 60))
    target.clear(0.25, 0.5, 0.75, 1.0)
    lobes = one_lobe((0, 0, 1), 0.01, Form.SG)
    cells = [(5, 7, 20), (40, 10, 32)]
    balls_pass = BallsPass(opengl, albedo_table(opengl))
    balls_pass.draw(lobes, [Ball(None, albedo=(1, 1, 1))] * 2, np.eye(3), cells, target)
    image = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(60, 80, 4)
    background = np.array([0.25, 0.5, 0.75, 1.0], np.float32)
    outside = np.ones((60, 80), bool)
    for x, y, size in cells:
        outside[y : y + size, x : x + size] = False
        # An even light of radiance 1 on a white Lambertian ball, to the 2 % of the closed form.
        middle = image[y + size // 2, x + size // 2]
        assert middle == pytest.approx([1, 1, 1, 1], abs=0.02)
        edge = image[y : y + size, x : x + size, 0].min()
        assert edge == pytest.approx(0.25, abs=1e-6)  # the corner
    assert (image[outside] == background).all()
    assert (image[..., 3] == 1).all()
    assert target.viewport == (0, 0, 80, 60)
