# SPDX-License-Identifier: Apache-2.0
"""Soft shadows in GLSL against their twin in Python, in float64."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, frames
from asglight.shading import occlusion
from asglight.shading.sheets import Sheets, sheets
from asglight.viewer.gl.passes import radiance_target
from asglight.viewer.uniforms.ground_blocks import packed_ground

UP = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
FOOT = torch.tensor([1.7, 0.0, -0.6], dtype=torch.float64)
POST = (0.1, 2.4)
SIDE = 24

PROBE = """#version 410 core
#include "lib/occlusion.glsl"
uniform vec4 u_rows[4];
layout(location = 0) out vec4 o_radiance;
void main() {
    OcclusionSheet sheet = OcclusionSheet(u_rows[0], u_rows[1], u_rows[2], u_rows[3]);
    vec2 place = (gl_FragCoord.xy - 0.5) / 23.0 * 6.0 - 3.0;
    vec3 point = vec3(place.x + 0.01, 0.0, place.y - 0.03);
    vec3 up = vec3(0.0, 1.0, 0.0);
    OcclusionPatch ball = occlusion_ball_patch(point, up, 1.0);
    OcclusionPatch post = occlusion_post_patch(point, vec3(1.7, 0.0, -0.6), 0.1, 2.4);
    o_radiance = vec4(occlusion_visible(sheet, ball, up, PROBE_WINDOW),
                      occlusion_visible(sheet, post, up, PROBE_WINDOW), 0.0, 1.0);
}
"""


def points() -> Tensor:
    """Return the points of the probe.  [P, 3]."""
    place = torch.arange(SIDE, dtype=torch.float64) / (SIDE - 1) * 6 - 3
    z, x = torch.meshgrid(place - 0.03, place + 0.01, indexing="ij")
    return torch.stack([x, torch.zeros_like(x), z], dim=-1).flatten(0, 1)


def some_lobes(form: Form) -> Lobes:
    """Return lobes of every width and many ratios, above the horizon.  [24, .]."""
    generator = torch.Generator().manual_seed(2)

    def draw(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    count = 24
    mean = 10 ** (5.5 * draw(count, 1) - 1)
    ratio = 10 ** (3 * draw(count, 1) * (draw(count, 1) < 0.6))
    sharpness = mean.expand(-1, 2) if form is Form.SG else mean * ratio ** torch.tensor([0.5, -0.5])
    axes = frames.axes_from_quaternion(torch.randn(count, 4, generator=generator).double())
    below = axes[:, 2, 1] < 0
    axes[below, 2] *= -1
    axes[below, 0] *= -1
    even = torch.ones(count, 3, dtype=torch.float64)
    return Lobes(axes, sharpness, even, form)


def one(made: Sheets, index: int) -> Sheets:
    """Return one of the sheets."""
    return Sheets(*(part[[index]] if isinstance(part, Tensor) else part for part in made))


@pytest.mark.parametrize("form", [Form.ASG, Form.BINGHAM, Form.SG])
def test_shadows_are_those_of_the_twin(
    opengl: moderngl.Context, probe_program: Callable[[str], moderngl.Program], form: Form
) -> None:
    made = sheets(some_lobes(form))
    text = PROBE.replace("PROBE_WINDOW", f"WINDOW_{made.window.upper()}")
    triangle = opengl.vertex_array(probe_program(text), [])
    target = radiance_target(opengl, (SIDE, SIDE))
    place = points()
    patches = [
        occlusion.ball_patch(place, UP, 1.0),
        occlusion.post_patch(place, FOOT, *POST),
    ]
    worst = 0.0
    for index in range(len(made.integral)):
        sheet = one(made, index)
        block = packed_ground(sheet, torch.ones(1, 3, dtype=torch.float64), UP)
        facing = sheet.integral.item() / np.pi
        if not len(block) or block["light"].max() < 0.02 * facing:
            continue  # it lies below the horizon, and what is left of it is no shadow
        triangle.program["u_rows"].write(block.tobytes())
        target.use()
        triangle.render(moderngl.TRIANGLES, vertices=3)
        found = np.frombuffer(target.read(components=2, dtype="f4"), np.float32).reshape(-1, 2)
        wanted = [occlusion.visible(sheet, UP, [patch])[0].numpy() for patch in patches]
        error = np.abs(found - np.stack(wanted, axis=-1))
        worst = max(worst, float(error.max()))
    # single floats: a step of a hard shadow may fall on the other side of a point
    assert worst < 0.02
