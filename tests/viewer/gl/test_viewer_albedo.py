# SPDX-License-Identifier: Apache-2.0
"""The directional albedo: by a sum over the lights in float64, and as the shaders look it up."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest
import torch

from asglight.shading import ggx
from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.passes import radiance_target

LOOKUP = """
#version 410 core
#include "lib/ggx.glsl"
uniform sampler2D u_table;
uniform float u_roughness;
layout(location = 0) out vec4 o;
void main() {
    float cos_view = pow((gl_FragCoord.x - 0.5) / 99.0, 3.0);  // denser at grazing angles
    o = vec4(ggx_albedo_parts(u_table, cos_view, u_roughness),
             ggx_fresnel(vec3(0.04), cos_view).r, 0.0);
}
"""


@pytest.mark.parametrize("cos_view", [1e-3, 0.01, 0.03, 0.2, 0.7, 1.0])
@pytest.mark.parametrize("alpha", [0.0625, 0.25, 1.0])
def test_albedo_is_the_integral_over_the_lights(cos_view: float, alpha: float) -> None:
    # Denser where lights are mirrored: near the horizon and the normal, straight ahead.
    level, aside = np.meshgrid(
        (np.arange(2000) + 0.5) / 2000, (np.arange(500) + 0.5) / 500, indexing="ij"
    )
    cos_light, turn = level**2 * (3 - 2 * level), np.pi * (1 - aside**2)
    density = 6 * level * (1 - level) * 2 * aside
    sin_light, sin_view = np.sqrt(1 - cos_light**2), np.sqrt(1 - cos_view**2)
    v_l = sin_light * sin_view * np.cos(turn) + cos_light * cos_view
    n_h = (cos_light + cos_view) / np.sqrt(2 + 2 * v_l)
    v_h = np.sqrt((1 + v_l) / 2)
    distribution = alpha**2 / np.pi / (n_h**2 * (alpha**2 - 1) + 1) ** 2
    # Smith's masking of one direction, and both together height-correlated [Heitz 2014]
    smith = [(-1 + np.sqrt(1 + alpha**2 * (1 / c**2 - 1))) / 2 for c in (cos_view, cos_light)]
    kernel = distribution / (1 + smith[0] + smith[1]) / (4 * cos_view)  # f n.l
    fresnel = (1 - v_h) ** 5
    expected = [(kernel * w * density).mean() * 2 * np.pi for w in (1 - fresnel, fresnel)]
    parts = ggx.albedo_parts(torch.tensor([cos_view], dtype=torch.float64), alpha)
    # 48 Gauss nodes across the kink where a light passes the horizon
    np.testing.assert_allclose(parts[0].numpy(), expected, atol=1e-3)


@pytest.mark.parametrize("cos_view", [1e-6, 1e-4, 1e-3, 3e-3, 0.01, 0.03, 0.06, 0.2, 0.7, 1.0])
@pytest.mark.parametrize("alpha", [0.0025, 0.01, 0.0625, 0.1, 0.25, 1.0])
def test_albedo_is_the_mean_over_visible_normals(cos_view: float, alpha: float) -> None:
    # Of normals in proportion to how much of them the view sees, each reflects F G2 / G1
    # [Heitz 2018, "Sampling the GGX Distribution of Visible Normals"]: no peak is left.
    share, turn = np.meshgrid(*[(np.arange(500) + 0.5) / 500] * 2, indexing="ij")
    radius = np.sqrt(share * share * (3 - 2 * share))  # denser at both ends of the shares
    density = 6 * share * (1 - share)
    sin_view = np.sqrt(1 - cos_view**2)
    across, up = alpha * sin_view, cos_view
    length = np.hypot(across, up)
    across, up = across / length, up / length
    aside = radius * np.cos(2 * np.pi * turn)
    high = radius * np.sin(2 * np.pi * turn)
    part = 0.5 * (1 + up)
    high = (1 - part) * np.sqrt(1 - aside**2) + part * high
    ahead = np.sqrt(np.maximum(1 - aside**2 - high**2, 0))
    # The frame: the stretched view, a level vector across it, and their product, (-up, 0, across).
    half = np.stack([ahead * across - high * up, aside, ahead * up + high * across])
    half *= np.array([alpha, alpha, 1.0])[:, None, None]
    half /= np.linalg.norm(half, axis=0)
    v_h = half[0] * sin_view + half[2] * cos_view
    n_l = 2 * v_h * half[2] - cos_view
    of_view, of_light = (
        (-1 + np.sqrt(1 + alpha**2 * (1 / c**2 - 1))) / 2 for c in (cos_view, np.maximum(n_l, 1e-9))
    )
    kept = np.where(n_l > 0, (1 + of_view) / (1 + of_view + of_light), 0) * density
    fresnel = (1 - v_h) ** 5
    expected = [(kept * w).mean() for w in (1 - fresnel, fresnel)]
    parts = ggx.albedo_parts(torch.tensor([cos_view], dtype=torch.float64), alpha)
    np.testing.assert_allclose(parts[0].numpy(), expected, atol=1e-3)
    assert parts.sum() <= 1 + 1e-12  # rounding of float64


@pytest.mark.parametrize("roughness", [0.05, 0.06, 0.1, 0.25, 0.5, 0.82, 1.0])
def test_shaders_look_the_albedo_up(
    opengl: moderngl.Context,
    probe_program: Callable[[str], moderngl.Program],
    roughness: float,
) -> None:
    program = probe_program(LOOKUP)
    program["u_table"] = 0
    program["u_roughness"] = roughness
    albedo_table(opengl).use(location=0)
    target = radiance_target(opengl, (100, 1))
    target.use()
    opengl.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
    found = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(100, 4)
    cos_view = torch.linspace(0, 1, 100, dtype=torch.float64) ** 3
    expected = ggx.albedo_parts(cos_view.clamp(min=1e-9), roughness**2).numpy()
    bound = np.where(cos_view > 0.02, 3e-3, 0.01)[:, None]  # as the table promises
    assert (np.abs(found[:, :2] - expected) < bound).all()
    schlick = 0.04 + 0.96 * (1 - cos_view.numpy()) ** 5
    np.testing.assert_allclose(found[:, 2], schlick, atol=1e-6)  # rounding of float32
