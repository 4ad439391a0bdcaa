# SPDX-License-Identifier: Apache-2.0
"""The include alone, in a shader of another program, shows what the library does in float64.

Tolerance: 1e-4 of the brightest value, for the digits of float32 where a lobe or a highlight is
sharp. The albedo of the layer has an error of its own, ERROR_MAX: the layer is compared with the
library's under the albedo that the shader found.
"""

import re
from collections.abc import Callable

import moderngl
import numpy as np
import pytest
import torch
from lobe_cases import random_lobes
from torch import Tensor

from asglight.export.albedo import ERROR_MAX
from asglight.export.environment import environment
from asglight.lobes import Form, Lobes, asg
from asglight.shading import ggx, ggx_lobes, rectified
from asglight.shading.sheets import amplitudes, sheets

TOLERANCE = 1e-4
POINTS = 256
DESKTOP, EMBEDDED = "#version 330 core\n", "#version 300 es\n"
VERTEX = """
void main() {
    gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}
"""
# The includer may have a PI of its own.
MAIN = """
#define PI 3.0
uniform highp sampler2D u_points;
uniform float u_roughness;
uniform vec3 u_f0;
layout(location = 0) out vec4 o;
void main() {
    int x = int(gl_FragCoord.x);
    vec3 normal = texelFetch(u_points, ivec2(x, 0), 0).xyz;
    vec3 view = texelFetch(u_points, ivec2(x, 1), 0).xyz;
    o = RESULT;
}
"""


def with_shape(form: Form, *, is_round: bool) -> Lobes:
    """Return five lobes, the fourth without light."""
    lobes = random_lobes(form)
    lobes.amplitude[3] = 0
    if is_round:
        lobes.sharpness[:, 1] = lobes.sharpness[:, 0]
    return lobes


CASES = [
    pytest.param(with_shape(form, is_round=is_round), id=f"{form}{'-round' * is_round}")
    for form, is_round in (
        *((Form.ASG, False), (Form.ASG, True), (Form.BINGHAM, False), (Form.BINGHAM, True)),
        (Form.SG, True),
    )
]


def points() -> Tensor:
    """Return unit normals and views that see them, near grazing too, of float32.  [2, P, 3]."""
    generator = torch.Generator().manual_seed(1)
    normal, other = torch.nn.functional.normalize(
        torch.randn(2, POINTS, 3, generator=generator, dtype=torch.float64), dim=-1
    )
    across = torch.nn.functional.normalize(torch.linalg.cross(normal, other), dim=-1)
    cos_view = torch.linspace(0.02, 1, POINTS, dtype=torch.float64)[:, None]
    view = cos_view * normal + (1 - cos_view**2).sqrt() * across
    return torch.stack([normal, view]).float().double()


SHADE = """vec4(asg_shade(normal, view, u_roughness, u_f0),
                asg_albedo(dot(normal, view), u_roughness, u_f0).r)"""

Shown = Callable[..., Tensor]


def shown(opengl: moderngl.Context, include: str, result: str, version: str = DESKTOP) -> Shown:
    """Compile a shader that includes the text; return what runs it at the points.  [P, 4]."""
    fragment = version + include + "precision highp float;\n" + MAIN.replace("RESULT", result)
    program = opengl.program(vertex_shader=version + VERTEX, fragment_shader=fragment)
    triangle = opengl.vertex_array(program, [])
    texture = opengl.texture((POINTS, 2), 3, points().float().numpy().tobytes(), dtype="f4")
    target = opengl.framebuffer([opengl.texture((POINTS, 1), 4, dtype="f4")])

    def run(roughness: float = 1.0, f0: tuple[float, float, float] = (0, 0, 0)) -> Tensor:
        for name, value in {"u_roughness": roughness, "u_f0": f0, "u_points": 0}.items():
            if name in program:
                program[name] = value
        texture.use(0)
        target.use()
        opengl.enable_only(moderngl.NOTHING)
        triangle.render(moderngl.TRIANGLES, vertices=3)
        values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
        return torch.from_numpy(values.copy()).double().reshape(POINTS, 4)

    return run


def assert_near(found: Tensor, expected: Tensor) -> None:
    assert expected.max() > 0.01
    assert (found - expected).abs().max() <= TOLERANCE * expected.max()


@pytest.mark.parametrize("lobes", CASES)
def test_environment_is_the_radiance_of_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    found = shown(opengl, environment(lobes, 1), "vec4(asg_environment(normal), 1.0)")()
    assert_near(found[:, :3], asg.evaluate(lobes, points()[0]))


@pytest.mark.parametrize("lobes", CASES)
def test_irradiance_is_that_of_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    found = shown(opengl, environment(lobes, 1), "vec4(asg_irradiance_over_pi(normal), 1.0)")()
    each = rectified.irradiance_over_pi(sheets(lobes), points()[0])
    assert_near(found[:, :3], torch.einsum("mp,mc->pc", each, amplitudes(lobes)))


@pytest.mark.parametrize("lobes", CASES)
def test_shade_is_the_layer_under_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    run = shown(opengl, environment(lobes, 1), SHADE)
    normals, views = points()
    cos_view = (normals * views).sum(-1).clamp(max=1)  # rounding
    for roughness in (0.05, 0.1, 0.25, 0.5, 1.0):
        for f0 in (0.04, 1.0):
            found = run(roughness, (f0,) * 3)
            albedo = found[:, 3]
            exact = ggx.albedo_parts(cos_view, roughness**2) @ torch.tensor([f0, 1.0]).double()
            assert (albedo - exact).abs().max() <= ERROR_MAX
            layer = ggx_lobes.layer(torch.tensor(roughness, dtype=torch.float64))
            parts = torch.stack([torch.zeros(POINTS), albedo], dim=-1)  # all of it in B
            expected = ggx_lobes.reflected(
                sheets(lobes), normals, views, layer, torch.full((3,), f0).double(), parts
            )
            assert_near(found[:, :3], torch.einsum("mpc,mc->pc", expected, amplitudes(lobes)))


def test_colour_of_the_layer_is_taken_by_channel(opengl: moderngl.Context) -> None:
    run = shown(opengl, environment(random_lobes(Form.ASG), 1), SHADE)
    colours = run(0.4, (0.9, 0.5, 0.04))
    for channel, f0 in enumerate((0.9, 0.5, 0.04)):
        assert_near(colours[:, channel], run(0.4, (f0,) * 3)[:, channel])


@pytest.mark.parametrize("lobes", CASES)
def test_include_serves_opengl_es(opengl: moderngl.Context, lobes: Lobes) -> None:
    if "GL_ARB_ES3_compatibility" not in opengl.extensions:
        pytest.skip("this OpenGL does not compile GLSL ES 3.00")
    include = environment(lobes, 1)
    call = f"{SHADE} + vec4(asg_environment(normal) + asg_irradiance_over_pi(normal), 0.0)"
    desktop, embedded = (
        shown(opengl, include, call, version)(0.3, (0.5,) * 3) for version in (DESKTOP, EMBEDDED)
    )
    assert_near(embedded, desktop)


def test_without_light_all_is_black(opengl: moderngl.Context) -> None:
    lobes = random_lobes(Form.ASG)
    include = environment(Lobes(lobes.axes, lobes.sharpness, 0 * lobes.amplitude, lobes.form), 1)
    call = f"{SHADE} + vec4(asg_environment(normal) + asg_irradiance_over_pi(normal), 0.0)"
    assert bool((shown(opengl, include, call)(0.3, (0.5,) * 3)[:, :3] == 0).all())


@pytest.mark.parametrize("lobes", CASES)
def test_every_name_is_its_own(lobes: Lobes) -> None:
    include = environment(lobes, 1)
    names = re.findall(r"^(?:const |struct )?\w+ (\w+)(?=[ (\[])", include, re.MULTILINE)
    assert {"asg_environment", "ASG_PI", "AsgLobe"} <= set(names)
    others = {name for name in names if not name.startswith(("asg_", "ASG_", "Asg"))}
    assert others == {"highp"}  # of `precision highp float`


def test_only_what_the_scene_needs_is_there() -> None:
    stretched, is_round = (
        environment(with_shape(Form.ASG, is_round=flag), 7) for flag in (False, True)
    )
    assert "axis_x, transported" in stretched
    assert "axis_x, transported" not in is_round
    for include in (stretched, is_round):
        assert "4 lobes of form asg, frame 7." in include
        assert "const int ASG_LOBES = 4;" in include
        assert "const int ASG_SHEETS = 4;" in include
        assert re.findall(r"^ *#.*", include, re.MULTILINE) == ["#ifdef GL_ES", "#endif"]
        assert not re.search(r"\b(uniform|sampler2D|texture)\b", include)


def test_bingham_lobes_shine_from_both_sides() -> None:
    include = environment(with_shape(Form.BINGHAM, is_round=False), 1)
    assert "const int ASG_LOBES = 4;" in include
    assert "const int ASG_SHEETS = 8;" in include
