# SPDX-License-Identifier: Apache-2.0
"""How the reference pass splits a map, and that nothing of its light is lost on the way."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest
import torch

from asglight.sphere import latlong
from asglight.viewer.gl.passes import radiance_target
from asglight.viewer.reference import reference_map

TEXEL_POINTS = """
#version 410 core
#include "lib/latlong.glsl"
#include "lib/sampling.glsl"
uniform vec2 u_size;
uniform vec2 u_texel;
layout(location = 0) out vec4 o;
void main() {
    vec3 direction = sampling_texel_direction(u_texel, u_size, gl_FragCoord.xy / 64.0);
    vec2 place = latlong_uv(direction) * u_size - u_texel;
    o = vec4(place, length(direction.xz), direction.y);
}
"""


def map_with_suns(height: int = 64, width: int = 128) -> np.ndarray:
    generator = np.random.default_rng(1)
    radiance = generator.exponential(1.0, (height, width, 3))
    radiance[0, 3] = [1e4, 0.0, 0.0]  # at a pole
    radiance[height // 3, 0] = radiance[height // 3, -1] = 2e5  # on the seam
    radiance[height // 2 :, :4] = 40.0
    return radiance.astype(np.float32)


def solid_angles(radiance: np.ndarray) -> np.ndarray:
    return latlong.texel_solid_angles(*radiance.shape[:2], dtype=torch.float64).numpy()[..., None]


def flux(radiance: np.ndarray) -> np.ndarray:
    return (radiance * solid_angles(radiance)).sum((0, 1), dtype=np.float64)


def test_rest_and_suns_are_the_map() -> None:
    radiance = map_with_suns()
    level = reference_map.prepared(radiance).levels[0].astype(np.float64)
    rest, suns = level[..., :3], level[..., :3] * level[..., 3:]
    np.testing.assert_allclose(rest + suns, radiance, rtol=3e-7)  # three roundings of float32
    limit = reference_map.SUN_RATIO * (flux(radiance.max(-1, keepdims=True)) / (4 * np.pi))
    assert rest.max() <= limit * (1 + 1e-6)
    assert (suns[radiance.max(-1) < limit] == 0).all()
    assert suns[0, 3, 0] > 0


def test_the_shares_hold_the_flux_of_the_suns() -> None:
    ready = reference_map.prepared(map_with_suns())
    column, row, weight = ready.shares.reshape(-1, 3).T
    level = ready.levels[0].astype(np.float64)
    suns = level[..., :3] * level[..., 3:]
    drawn = suns[row.astype(int), column.astype(int)] * weight[:, None].astype(np.float64)
    np.testing.assert_allclose(drawn.mean(0), flux(suns), rtol=1e-6)
    # One share for each at least, and the density that weights them is a density.
    assert len(np.unique(row * 128 + column)) == (level[..., 3] > 0).sum()
    density = level[..., 3:] * ready.sun_density
    assert (density * solid_angles(level)).sum() == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("shape", [(64, 128), (37, 74), (1, 2)])
def test_each_level_keeps_the_flux_of_the_rest(shape: tuple[int, int]) -> None:
    levels = reference_map.prepared(map_with_suns(*shape) if shape[0] > 2 else np.ones((1, 2, 3)))
    rest = [level[..., :3].astype(np.float64) for level in levels.levels]
    assert [r.shape[:2] for r in rest[-2:]][-1] == (1, 1)
    for level in rest:
        np.testing.assert_allclose(flux(level), flux(rest[0]), rtol=1e-6)


def test_diffuse_light_of_the_rest_is_the_sum_over_its_texels() -> None:
    # Suns of 2e5 would leave texels of 500 in the rest, which count little in the whole alone.
    ready = reference_map.prepared(map_with_suns().clip(max=100))
    assert ready.sun_density > 0
    rest = ready.levels[0][..., :3].astype(np.float64)
    lights = latlong.directions(64, 128, dtype=torch.float64).numpy().reshape(-1, 3)
    normals = latlong.directions(reference_map.DIFFUSE_ROWS, 2 * reference_map.DIFFUSE_ROWS)
    normals = normals.double().numpy()[::5, ::7]
    cosines = np.maximum(normals @ lights.T, 0) / np.pi
    expected = cosines @ (rest * solid_angles(rest)).reshape(-1, 3)
    found = ready.diffuse[::5, ::7]
    np.testing.assert_allclose(found, expected, rtol=0.01)  # texels of 6 degrees instead of 3


def test_a_black_map_and_an_even_one_have_no_suns() -> None:
    for value in (0.0, 1e9):
        ready = reference_map.prepared(np.full((8, 16, 3), value, np.float32))
        assert ready.sun_density == 0
        np.testing.assert_array_equal(ready.levels[0][..., :3], value)
        np.testing.assert_allclose(ready.diffuse, value, rtol=1e-5)  # a float32 sum of 2048


@pytest.mark.parametrize("rows", [1, 256, 4096])
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, 0.37), (1.0, 1.0)])
def test_points_of_a_texel_are_even_over_its_solid_angle(
    opengl: moderngl.Context,
    probe_program: Callable[[str], moderngl.Program],
    rows: int,
    place: tuple[float, float],
) -> None:
    column, row = (min(int(p * n), n - 1) for p, n in zip(place, (2 * rows, rows), strict=True))
    program = probe_program(TEXEL_POINTS)
    program["u_size"] = (2.0 * rows, float(rows))
    program["u_texel"] = (float(column), float(row))
    target = radiance_target(opengl, (64, 64))
    target.use()
    opengl.vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)
    u, v, level, y = (
        np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
        .reshape(64, 64, 4)
        .transpose(2, 0, 1)
        .astype(np.float64)
    )
    # latlong_uv and sin in float32: 1e-7 of the map
    slack = 1e-6 * rows + 1e-3
    share = (np.arange(64) + 0.5) / 64
    np.testing.assert_allclose(u, np.broadcast_to(share, (64, 64)), atol=2 * slack)
    # The height above the row's edge goes with the area: Archimedes.
    edges = np.pi * np.array([row, row + 1]) / rows
    upper = 2 * row < rows
    colatitude = np.arctan2(level, y)
    half_turn = 0 if upper else 0.5 * np.pi  # sin^2 of half the angle to the nearer pole
    low, high = np.sin(edges / 2 - half_turn) ** 2
    area = (np.sin(colatitude / 2 - half_turn) ** 2 - low) / (high - low)
    if not upper:
        area = 1 - area  # points count from the pole
    np.testing.assert_allclose(area, np.broadcast_to(share[:, None], (64, 64)), atol=slack)
    assert (np.abs(v - 0.5) <= 0.5 + slack).all()
