# SPDX-License-Identifier: Apache-2.0
"""The include alone, in a shader of another program, shows what the library does in float64.

Tolerance: 1e-4 of the brightest value, for the digits of float32 where a lobe or a highlight is
sharp. The albedo of the layer has an error of its own, ERROR_MAX: the layer is compared with the
library's under the albedo that the shader found.
"""

import os
import re
from pathlib import Path

import moderngl
import pytest
import torch
from include_shader import DESKTOP, EMBEDDED, Shown, points, shown
from lobe_cases import random_lobes
from torch import Tensor

from asglight.export.albedo import ERROR_MAX
from asglight.export.environment import Environment, environment, write_glsl
from asglight.lobes import Form, Lobes, LobeTracks, asg
from asglight.lobes.data import stack
from asglight.lobes.frames import axes_around
from asglight.shading import brute_force, ggx, ggx_layer, ggx_lobes, rectified
from asglight.shading.sheets import amplitudes, sheets

TOLERANCE = 1e-4
CALL = "vec4(asglight_reflection(normal, view, u_roughness, u_f0)"
REFLECTION = f"{CALL}, asglight_albedo(dot(normal, view), u_roughness, u_f0).r)"
ALL = (
    f"{REFLECTION} + vec4(asglight_evaluate(normal) + asglight_irradiance(normal) + "
    "asglight_shade(normal, view, u_roughness, u_f0, vec3(0.5)), 0.0)"
)


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
        (Form.FLAT, False),
        (Form.FLAT, True),
    )
]


def of_frames(*frames: Lobes) -> Environment:
    numbers = tuple(range(7, 7 + len(frames)))
    return environment(LobeTracks(numbers, 24.0, stack(list(frames))), "a.f32")


def constants(lobes: Lobes) -> str:
    """Return the include of one frame."""
    made = of_frames(lobes)
    assert made.blocks is None
    return made.text


def in_block(opengl: moderngl.Context, lobes: Lobes, result: str) -> Shown:
    """Return what runs the include of a shot that moves, with the lobes in its second frame."""
    made = of_frames(with_other_light(lobes), lobes)
    assert made.blocks is not None
    run = shown(opengl, made.text, result)
    opengl.buffer(made.blocks[1].tobytes()).bind_to_uniform_block(0)
    return run


def with_other_light(lobes: Lobes) -> Lobes:
    return Lobes(lobes.axes, lobes.sharpness, 3 * lobes.amplitude, lobes.form)


def assert_near(found: Tensor, expected: Tensor) -> None:
    assert expected.max() > 0.01
    assert (found - expected).abs().max() <= TOLERANCE * expected.max()


@pytest.mark.parametrize("lobes", CASES)
def test_evaluate_is_the_radiance_of_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    found = shown(opengl, constants(lobes), "vec4(asglight_evaluate(normal), 1.0)")()
    assert_near(found[:, :3], asg.evaluate(lobes, points()[0]))


@pytest.mark.parametrize("lobes", CASES)
def test_irradiance_is_that_of_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    found = shown(opengl, constants(lobes), "vec4(asglight_irradiance(normal), 1.0)")()
    each = torch.pi * rectified.irradiance_over_pi(sheets(lobes), points()[0])
    assert_near(found[:, :3], torch.einsum("mp,mc->pc", each, amplitudes(lobes)))


@pytest.mark.parametrize("lobes", CASES)
def test_reflection_is_the_layer_under_the_lobes(opengl: moderngl.Context, lobes: Lobes) -> None:
    run = shown(opengl, constants(lobes), REFLECTION)
    normals, views = points()
    cos_view = (normals * views).sum(-1).clamp(max=1)  # rounding
    for roughness, f0 in ((0.05, 1.0), (0.1, 0.04), (0.25, 1.0), (0.5, 0.04), (1.0, 1.0)):
        found = run(roughness, (f0,) * 3)
        albedo = found[:, 3]
        exact = ggx.albedo_parts(cos_view, roughness**2) @ torch.tensor([f0, 1.0]).double()
        assert (albedo / exact - 1).abs().max() <= ERROR_MAX
        layer = ggx_layer.layer(torch.tensor(roughness, dtype=torch.float64))
        parts = torch.stack([torch.zeros(len(albedo)), albedo], dim=-1)  # all of it in B
        expected = ggx_lobes.reflected(
            sheets(lobes), normals, views, layer, torch.full((3,), f0).double(), parts
        )
        assert_near(found[:, :3], torch.einsum("mpc,mc->pc", expected, amplitudes(lobes)))


def test_reflection_is_near_the_integral_over_the_lobes(opengl: moderngl.Context) -> None:
    # Twice what docs/method/shading.md has as the worst of fifteen lobes, for there are only five;
    # a wrong factor or frame is off by far more.
    lobes = random_lobes(Form.ASG)
    run = shown(opengl, constants(lobes), REFLECTION)
    normals, views = points()
    chosen = (normals * views).sum(-1) > 0.3
    for roughness in (0.25, 0.5, 1.0):
        exact = torch.stack(
            [
                brute_force.reflected(lobes, n[None], v, roughness, points=1024)[:, 0].sum(-1)
                for n, v in zip(normals[chosen][::8], views[chosen][::8], strict=True)
            ]
        )
        expected = torch.einsum("pm,mc->pc", exact, lobes.amplitude)
        found = run(roughness, (1.0,) * 3)[chosen][::8, :3]
        assert (found - expected).abs().mean() < 0.1 * expected.mean()


def test_lights_straight_behind_and_before_are_shown(opengl: moderngl.Context) -> None:
    # There is no half vector of opposite directions, and no plane of view and normal of equal ones.
    view = points()[1, 100]
    axes = axes_around(torch.stack([-view, view]))
    lobes = Lobes(axes, torch.full((2, 2), 3.0).double(), torch.ones(2, 3).double())
    call = REFLECTION.replace("(normal, view, u", "(view, view, u").replace(
        "normal, view", "view, view"
    )
    for roughness in (0.05, 0.3, 1.0):
        found = shown(opengl, constants(lobes), call)(roughness, (1.0,) * 3)[100]
        made, layer = sheets(lobes), ggx_layer.layer(torch.tensor(roughness).double())
        parts = torch.stack([torch.zeros(1).double(), found[3:]], dim=-1)
        f0 = torch.ones(3).double()
        expected = ggx_lobes.reflected(made, view[None], view, layer, f0, parts)
        assert_near(found[:3], expected.sum(0)[0])


def test_colour_of_the_layer_is_taken_by_channel(opengl: moderngl.Context) -> None:
    run = shown(opengl, constants(random_lobes(Form.ASG)), REFLECTION)
    colours = run(0.4, (0.9, 0.5, 0.04))
    for channel, f0 in enumerate((0.9, 0.5, 0.04)):
        assert_near(colours[:, channel], run(0.4, (f0,) * 3)[:, channel])


def test_shade_is_the_layer_over_what_it_lets_through(opengl: moderngl.Context) -> None:
    include = constants(random_lobes(Form.ASG))
    base = (0.8, 0.3, 0.0)
    whole = shown(
        opengl,
        include,
        f"vec4(asglight_shade(normal, view, u_roughness, u_f0, vec3{base}), 1.0)",
    )(0.3, (0.04,) * 3)
    layer = shown(opengl, include, REFLECTION)(0.3, (0.04,) * 3)
    matte = shown(opengl, include, "vec4(asglight_irradiance(normal) / 3.14159265, 1.0)")()
    expected = layer[:, :3] + (1 - layer[:, 3:]) * torch.tensor(base) * matte[:, :3]
    assert_near(whole[:, :3], expected)


@pytest.mark.parametrize("lobes", CASES)
def test_include_serves_opengl_es(opengl: moderngl.Context, lobes: Lobes) -> None:
    if "GL_ARB_ES3_compatibility" not in opengl.extensions:
        pytest.skip("this OpenGL does not compile GLSL ES 3.00")
    include = constants(lobes)
    desktop, embedded = (
        shown(opengl, include, ALL, version)(0.3, (0.5,) * 3) for version in (DESKTOP, EMBEDDED)
    )
    assert_near(embedded, desktop)


@pytest.mark.parametrize("lobes", CASES)
def test_block_of_a_frame_gives_what_constants_give(opengl: moderngl.Context, lobes: Lobes) -> None:
    expected = shown(opengl, constants(lobes), ALL)(0.3, (0.5,) * 3)
    assert_near(in_block(opengl, lobes, ALL)(0.3, (0.5,) * 3), expected)


def test_without_light_all_is_black(opengl: moderngl.Context) -> None:
    lobes = random_lobes(Form.ASG)
    include = constants(Lobes(lobes.axes, lobes.sharpness, 0 * lobes.amplitude, lobes.form))
    assert bool((shown(opengl, include, ALL)(0.3, (0.5,) * 3)[:, :3] == 0).all())


@pytest.mark.parametrize("lobes", CASES)
def test_every_name_is_its_own(lobes: Lobes) -> None:
    for text in (constants(lobes), of_frames(lobes, with_other_light(lobes)).text):
        names = re.findall(r"^(?:const |struct )?\w+ (\w+)(?=[ (\[])", text, re.MULTILINE)
        assert {"asglight_shade", "ASG_PI", "AsgLayer"} <= set(names)
        others = {name for name in names if not name.startswith(("asg_", "ASG_", "Asg", "asgl"))}
        assert others <= {"highp"}  # of `precision highp float`


def test_only_what_the_scene_needs_is_there() -> None:
    stretched, is_round = (constants(with_shape(Form.ASG, is_round=flag)) for flag in (False, True))
    assert "axis_x, transported" in stretched
    assert "axis_x, transported" not in is_round
    for include in (stretched, is_round):
        assert "4 lobes of form asg, frame 7." in include
        assert "const int ASG_LOBES = 4;" in include
        assert "const int ASG_SHEETS = 4;" in include
        assert "chord" not in include  # of sg
        assert re.findall(r"^ *#.*", include, re.MULTILINE) == ["#ifdef GL_ES", "#endif"]
        assert not re.search(r"\b(uniform|sampler2D|texture)\b", include)
    assert "chord" in constants(with_shape(Form.SG, is_round=True))


def test_bingham_lobes_shine_from_both_sides() -> None:
    include = constants(with_shape(Form.BINGHAM, is_round=False))
    assert "const int ASG_LOBES = 4;" in include
    assert "const int ASG_SHEETS = 8;" in include


def test_a_shot_that_rests_has_constants() -> None:
    lobes = random_lobes(Form.ASG)
    made = of_frames(lobes, lobes)
    assert made.blocks is None
    assert "frames 7-8 at 24 fps" in made.text


@pytest.mark.parametrize("name", [b"one\nvec3 two", b"odd \xff"])
def test_an_odd_name_of_the_blocks_stays_within_its_comment(name: bytes, tmp_path: Path) -> None:
    lobes = random_lobes(Form.ASG)
    tracks = LobeTracks((7, 8), 24.0, stack([lobes, with_other_light(lobes)]))
    target = tmp_path / os.fsdecode(name + b".glsl")
    assert write_glsl(target, tracks) == [target, target.with_suffix(".f32")]
    head = target.read_text(encoding="utf-8").split("#ifdef GL_ES")[0].splitlines()
    outside = [line for line in head if line and not line.startswith("//")]
    assert outside == []


def test_a_lobe_stays_if_it_shines_in_any_frame() -> None:
    lobes = random_lobes(Form.ASG)
    dark = lobes.clone()
    dark.amplitude[1:3] = 0
    lobes.amplitude[2:4] = 0
    made = of_frames(dark, lobes)
    assert "4 lobes of form asg, frames 7-8 at 24 fps" in made.text
    assert made.blocks is not None
    assert made.blocks.shape == (2, 5 * 4, 4)
