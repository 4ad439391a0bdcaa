# SPDX-License-Identifier: Apache-2.0
"""The numbers that the shaders hand out are those of the library."""

import math

import moderngl
import pytest
import torch

from asglight.lobes import Form, Lobes
from asglight.lobes.frames import axes_around
from asglight.viewer.gl.lobe_probe import COLUMNS, LobeProbe


def lamp(form: Form = Form.ASG, sharpness: float = 30.0) -> Lobes:
    """Return one lobe at +X of sharpness s and red 2, green 1, blue 0."""
    axes = axes_around(torch.tensor([[1.0, 0.0, 0.0]]))
    return Lobes(axes, torch.full((1, 2), sharpness), torch.tensor([[2.0, 1.0, 0.0]]), form)


@pytest.mark.parametrize("count", [1, COLUMNS, COLUMNS + 3])
@pytest.mark.parametrize("form", list(Form))
def test_radiance_at_directions_is_the_lobe_function(
    opengl: moderngl.Context, form: Form, count: int
) -> None:
    angle = torch.linspace(0, 0.5, count, dtype=torch.float64)
    directions = torch.stack([angle.cos(), angle.sin(), torch.zeros(count)], dim=-1)
    found = LobeProbe(opengl).radiance(lamp(form), directions)
    cos, sin = angle.cos(), angle.sin()
    unit = torch.exp(-30.0 * sin * sin)
    if form is Form.SG:
        unit = torch.exp(30.0 * (cos - 1))
    elif form is Form.FLAT:
        unit = (1 - (1 - unit) ** 3) * cos
    elif form is Form.ASG:
        unit = unit * cos
    expected = unit[:, None] * torch.tensor([2.0, 1.0, 0.0], dtype=torch.float64)
    assert found.shape == (count, 3)
    # float32: 30 times twice the rounding of a cosine, and exp's own
    torch.testing.assert_close(found.double(), expected, rtol=0, atol=1e-5)


def test_a_matte_ball_shows_the_cosine_of_a_far_narrow_lamp(opengl: moderngl.Context) -> None:
    size, sharpness = 32, 1e5
    ball = LobeProbe(opengl).ball(lamp(sharpness=sharpness), None, size).double()
    x = (2 * torch.arange(size, dtype=torch.float64) + 1) / size - 1
    row = size // 2
    # the flux of a narrow lobe is pi / s; a white ball shows flux times cosine over pi
    expected = 2 * math.pi / sharpness * x.clamp(min=0) / math.pi
    inside = x.abs() < 0.9
    # the lamp is 0.1 degrees wide: beside its shadow's edge it is seen in part
    assert float((ball[row, :, 0] - expected)[inside].abs().max()) < 1e-3 * float(expected.max())
    assert not ball[0, 0].any()
    torch.testing.assert_close(ball[..., 1], ball[..., 0] / 2, rtol=1e-6, atol=0)


def test_the_probe_says_what_computes(opengl: moderngl.Context) -> None:
    assert LobeProbe(opengl).name.startswith("OpenGL ")
