# SPDX-License-Identifier: Apache-2.0
"""The lobe functions in GLSL equal the library's in float64.

Tolerances. A product with a unit axis is a sum of three terms: in float32 it is off by at most dx,
three roundings of 2^-24. In the exponent E = sx x^2 + sy y^2 that error is multiplied by the slope,
so the relative error of a lobe is about 2 (sx |x| + sy |y|) dx. exp itself may be off by 3 + 2 E
units in the last place, which is what the GLSL 4.60 specification allows. Results below 1e-37 may
be 0, because drivers flush denormals.

Measured on llvmpipe, largest relative error of unit lobes above 1e-3 of their peak: asg and bingham
1.8e-5 below a sharpness of 1e3, 3.1e-5 below 1e5, 1.2e-4 up to 1e6; sg 1.8e-6. The largest share of
the tolerance that any sample uses is 0.38.
"""

import math
from collections.abc import Callable

import moderngl
import numpy as np
import pytest
import torch
from torch import Tensor

from asglight.lobes import Form, Lobes, LobeTracks, asg, frames
from asglight.sphere import latlong
from asglight.viewer.gl import passes

ROUNDING = 2.0**-24
DENORMAL = 1e-37
Probe = Callable[[str], moderngl.Program]

UNIT_LOBE = """
#version 410 core
#include "lobes_block.glsl"
uniform sampler2D u_directions;
layout(location = 0) out vec4 o;
void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    vec3 direction = texelFetch(u_directions, texel, 0).xyz;
    o = vec4(asg_evaluate(u_lobes[texel.y], u_form, direction),
             asg_unit_lobe(u_lobes[texel.y], u_form, direction));
}
"""
LATLONG = """
#version 410 core
#include "lib/latlong.glsl"
uniform vec2 u_size;
layout(location = 0) out vec4 o;
void main() { o = vec4(latlong_direction(gl_FragCoord.xy / u_size), 1.0); }
"""
LATLONG_UV = """
#version 410 core
#include "lib/latlong.glsl"
uniform sampler2D u_directions;
layout(location = 0) out vec4 o;
void main() {
    o = vec4(latlong_uv(texelFetch(u_directions, ivec2(gl_FragCoord.xy), 0).xyz), 0.0, 0.0);
}
"""
BLOCK = """
#version 410 core
#include "lobes_block.glsl"
layout(location = 0) out vec4 o;
void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    Lobe lobe = u_lobes[texel.y];
    vec4 fields[5] = vec4[](lobe.axis_x, lobe.axis_y, lobe.axis_z, lobe.amplitude,
                            vec4(u_lobe_count, u_form, 0, 0));
    o = fields[texel.x];
}
"""


def drawn(
    opengl: moderngl.Context,
    program: moderngl.Program,
    size: tuple[int, int],
    *,
    lobes: Lobes | None = None,
    directions: Tensor | None = None,
) -> Tensor:
    """Run a probe over a float target and return what it wrote.  [H, W, 4]."""
    target = passes.radiance_target(opengl, size)
    if lobes is not None:
        block = opengl.buffer(passes.packed_lobes(lobes).ljust(16 + 64 * 128, b"\0"))
        program["LobesBlock"].binding = 0
        block.bind_to_uniform_block(0)
    if directions is not None:
        texture = opengl.texture(size, 3, directions.numpy().tobytes(), dtype="f4")
        texture.use(0)
        program["u_directions"] = 0
    target.use()
    opengl.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
    return as_tensor(target)


def as_tensor(target: moderngl.Framebuffer) -> Tensor:
    """Read a radiance target.  [H, W, 4]."""
    values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
    return torch.from_numpy(values.reshape(target.height, target.width, 4).copy())


def random_lobes(form: Form, count: int, generator: torch.Generator) -> Lobes:
    """Return lobes with larger sharpness 1e-3 to 1e6 and ratio 1 to 400, log-uniform.  [N, .]."""
    unit = torch.rand(count, 2, generator=generator, dtype=torch.float64)
    large = 10 ** (9 * unit[:, 0] - 3)
    small = (large / 400 ** unit[:, 1]).clamp(min=1e-3)
    if form is Form.SG:
        small = large
    quaternion = torch.randn(count, 4, generator=generator, dtype=torch.float64)
    return Lobes(
        axes=frames.axes_from_quaternion(quaternion),
        sharpness=torch.stack([large, small], dim=-1),
        amplitude=10 ** (6 * torch.rand(count, 3, generator=generator, dtype=torch.float64) - 3),
        form=form,
    ).to(torch.float32)


def directions_for(lobes: Lobes, count: int, generator: torch.Generator) -> Tensor:
    """Return directions, half of them spread as each lobe is, half anywhere.  [N, P, 3]."""
    anywhere = torch.randn(lobes.count, count // 2, 3, generator=generator, dtype=torch.float64)
    local = torch.randn(lobes.count, count // 2, 3, generator=generator, dtype=torch.float64)
    local[..., :2] /= (2 * lobes.sharpness[:, None].double()).sqrt()
    local[..., 2] = 1.0
    near = local @ lobes.axes.double()
    return torch.nn.functional.normalize(torch.cat([near, anywhere], dim=1), dim=-1).float()


def relative_tolerance(lobes: Lobes, directions: Tensor, step: float) -> Tensor:
    """Return the largest relative error of unit lobes whose inputs are off by `step`.  [N, P]."""
    if lobes.form is Form.SG:
        # The exponent s/2 |d - axis_z|^2: the difference is exact to rounding near the axis.
        chord = (directions - lobes.axis_z[..., None, :]).norm(dim=-1)
        exponent = 0.5 * lobes.sharpness[..., :1] * chord**2
        slope = lobes.sharpness[..., :1] * chord * (step if step > 3 * ROUNDING else 0.0)
        window = torch.zeros_like(chord)
    else:
        local = lobes.axes @ directions.mT
        x, y, z = local.abs().unbind(-2)
        sx, sy = lobes.sharpness[..., None].unbind(-2)
        exponent = sx * x**2 + sy * y**2
        slope = 2 * (sx * x + sy * y) * step + (sx + sy) * step**2
        window = step / z.clamp(min=1e-30)
        if lobes.form is Form.BINGHAM:
            window = torch.zeros_like(z)
    exponential = (3 + 2 * exponent) * 2 * ROUNDING + 6 * exponent * ROUNDING
    if (
        lobes.form is Form.FLAT
    ):  # E (3 - E (3 - E)): its log has a slope of 1 or less, five roundings
        exponential = exponential + 10 * ROUNDING  # of numbers up to three times the factor
    return torch.expm1(slope + exponential) + window + 4 * ROUNDING


@pytest.mark.parametrize("form", Form)
def test_lobes_equal_the_library(
    opengl: moderngl.Context,
    probe_program: Probe,
    form: Form,
) -> None:
    generator = torch.Generator().manual_seed(1)
    lobes = random_lobes(form, 128, generator)
    directions = directions_for(lobes, 2048, generator)
    values = drawn(
        opengl, probe_program(UNIT_LOBE), (2048, 128), lobes=lobes, directions=directions
    )
    exact, exact_directions = lobes.to(torch.float64), directions.double()
    reference = asg.unit_lobes(exact, exact_directions)  # [N, P]
    tolerance = relative_tolerance(exact, exact_directions, 3 * ROUNDING)
    error = (values[..., 3] - reference).abs()
    assert (error <= tolerance * reference + DENORMAL).all()
    radiance = reference[..., None] * exact.amplitude[:, None]  # [N, P, 3]
    bound = (tolerance[..., None] + 2 * ROUNDING) * radiance + DENORMAL * 1e4
    assert ((values[..., :3] - radiance).abs() <= bound).all()


def test_lobe_at_its_axis_is_exactly_its_amplitude_however_sharp(
    opengl: moderngl.Context, probe_program: Probe
) -> None:
    lobes = Lobes(torch.eye(3)[None], torch.full((1, 2), 1e7), torch.tensor([[3.0, 2.0, 1.0]]))
    for form in Form:
        of_form = Lobes(lobes.axes, lobes.sharpness, lobes.amplitude, form)
        values = drawn(
            opengl,
            probe_program(UNIT_LOBE),
            (1, 1),
            lobes=of_form,
            directions=torch.tensor([[[0.0, 0.0, 1.0]]]),
        )
        assert values.flatten().tolist() == [3.0, 2.0, 1.0, 1.0]


def test_uniform_block_holds_each_field_where_the_shader_reads_it(
    opengl: moderngl.Context, probe_program: Probe
) -> None:
    lobes = Lobes(
        axes=torch.arange(18.0).reshape(2, 3, 3),
        sharpness=torch.tensor([[101.0, 102.0], [103.0, 104.0]]),
        amplitude=torch.tensor([[201.0, 202.0, 203.0], [204.0, 205.0, 206.0]]),
        form=Form.SG,
    )
    fields = drawn(opengl, probe_program(BLOCK), (5, 2), lobes=lobes)
    assert fields.tolist() == [
        [
            [0, 1, 2, 101],
            [3, 4, 5, 102],
            [6, 7, 8, 0],
            [201, 202, 203, 0],
            [2, 2, 0, 0],
        ],
        [
            [9, 10, 11, 103],
            [12, 13, 14, 104],
            [15, 16, 17, 0],
            [204, 205, 206, 0],
            [2, 2, 0, 0],
        ],
    ]


# GLSL sets no precision for sin, cos and atan; GPUs reach 2^-21 of a half turn, llvmpipe 1e-7.
TRIGONOMETRY = math.pi * 2.0**-20


def test_latlong_directions_equal_the_library(
    opengl: moderngl.Context, probe_program: Probe
) -> None:
    program = probe_program(LATLONG)
    program["u_size"] = (512, 256)
    values = drawn(opengl, program, (512, 256))[..., :3]
    expected = latlong.directions(256, 512, dtype=torch.float64)
    torch.testing.assert_close(values.double(), expected, rtol=0, atol=TRIGONOMETRY)


def test_latlong_coordinates_equal_the_library(
    opengl: moderngl.Context, probe_program: Probe
) -> None:
    generator = torch.Generator().manual_seed(2)
    directions = torch.randn(1, 4096, 3, generator=generator)
    directions[0, :6] = torch.cat([torch.eye(3), -torch.eye(3)]) + 0.0  # no negative zeros
    values = drawn(opengl, probe_program(LATLONG_UV), (4096, 1), directions=directions)[0]
    u, v = latlong.uv_from_direction(directions[0].double())
    seam = torch.remainder(values[:, 0].double() - u + 0.5, 1.0) - 0.5  # u = 0 is u = 1
    assert seam.abs().max() <= TRIGONOMETRY
    assert (values[:, 1].double() - v).abs().max() <= TRIGONOMETRY
    poles = values[[1, 4]]  # +Y and -Y
    torch.testing.assert_close(poles[:, :2], torch.tensor([[0.5, 0.0], [0.5, 1.0]]))


@pytest.mark.parametrize("form", Form)
def test_lobes_pass_draws_the_library_s_latlong(opengl: moderngl.Context, form: Form) -> None:
    generator = torch.Generator().manual_seed(3)
    lobes = random_lobes(form, 15, generator)
    lobes = Lobes(lobes.axes, lobes.sharpness.clamp(max=1e3), lobes.amplitude, form)
    target = passes.radiance_target(opengl, (64, 32))
    passes.LobesPass(opengl).draw(lobes, target)
    directions = latlong.directions(32, 64, dtype=torch.float64).flatten(0, 1)
    exact = lobes.to(torch.float64)
    reference = asg.evaluate(exact, directions)  # [P, 3]
    tolerance = relative_tolerance(exact, directions, TRIGONOMETRY)  # [N, P]
    scaled = tolerance * asg.unit_lobes(exact, directions) + TRIGONOMETRY
    bound = torch.einsum("np,nc->pc", scaled, exact.amplitude) + 16 * ROUNDING * reference
    error = (as_tensor(target)[..., :3].flatten(0, 1) - reference).abs()
    assert (error <= bound).all()


def test_lobes_pass_draws_every_lobe_of_a_full_block(opengl: moderngl.Context) -> None:
    lobes = random_lobes(Form.BINGHAM, 128, torch.Generator().manual_seed(4))
    lobes = Lobes(lobes.axes, torch.full((128, 2), 1e-3), torch.ones(128, 3), Form.BINGHAM)
    target = passes.radiance_target(opengl, (4, 2))
    passes.LobesPass(opengl).draw(lobes, target)
    # Each lobe lies between exp(-1e-3) and 1 everywhere.
    assert as_tensor(target)[..., :3].min() > 128 * math.exp(-1.1e-3)
    assert as_tensor(target)[..., :3].max() < 128.01


def test_lobes_pass_forgets_the_lobes_of_the_frame_before(
    opengl: moderngl.Context, two_lamps: LobeTracks
) -> None:
    target = passes.radiance_target(opengl, (64, 32))
    lobes_pass = passes.LobesPass(opengl)
    lobes_pass.draw(two_lamps.at(1001), target)
    assert as_tensor(target)[..., 0].max() > 0.4
    lobes_pass.draw(two_lamps.at(1001).select(torch.tensor([0])), target)
    assert as_tensor(target)[..., 0].max() == 0
    lobes_pass.draw(two_lamps.at(1001).select(torch.tensor([], dtype=torch.long)), target)
    assert as_tensor(target)[..., :3].max() == 0
