# SPDX-License-Identifier: Apache-2.0
"""The three spheres: mirrored lights, a white map, Lambert; the protocol's numbers."""

import math

import numpy as np
import pytest
import scipy.optimize
import torch

from asglight.judging.compare import spheres
from asglight.shading.balls import coverage
from asglight.shading.ggx import albedo_parts
from asglight.sphere import latlong

SIZE = 64


@pytest.fixture(scope="module")
def furnace() -> torch.Tensor:
    """The spheres under a white map, and under a lamp of one texel towards +X.  [2, 3, S, S, 3]."""
    lamp = torch.zeros(32, 64, 3)
    row, column = texel_of(1.0, 0.0, 0.0)
    lamp[row, column] = 1.0
    return spheres.render(torch.stack([torch.ones(32, 64, 3), lamp]), SIZE)


def texel_of(x: float, y: float, z: float) -> tuple[int, int]:
    d = latlong.directions(32, 64) @ torch.tensor([x, y, z])
    return divmod(int(d.argmax()), 64)


def test_a_white_map_shows_the_albedo_of_each_sphere(furnace: torch.Tensor) -> None:
    x = (2 * torch.arange(SIZE) + 1) / SIZE - 1
    cosine = (1 - x**2 - x[SIZE // 2] ** 2).clamp(min=0).sqrt()  # along the middle row
    inner = cosine > 0.3  # further out, pixels hold a range of cosines
    row = furnace[0, :, SIZE // 2, inner, 0].double()
    metal = {}
    for roughness in (spheres.SILVER_ROUGHNESS, spheres.LAYER_ROUGHNESS):
        low, high = albedo_parts(cosine[inner].double(), roughness**2).unbind(-1)
        metal[roughness] = (0.8 * low + high, 0.04 * low + high)
    expected_mirror = 0.8 + 0.2 * (1 - cosine[inner].double()) ** 5
    layer = metal[spheres.LAYER_ROUGHNESS][1]
    # the curvature of Fresnel's term over a pixel; the renderer is within 0.1 % of the albedo
    torch.testing.assert_close(row[0], expected_mirror, rtol=5e-3, atol=0)
    torch.testing.assert_close(row[1], metal[spheres.SILVER_ROUGHNESS][0], rtol=5e-3, atol=0)
    torch.testing.assert_close(row[2], layer + 0.8 * (1 - layer), rtol=5e-3, atol=0)


@pytest.mark.parametrize(
    "towards", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (0.6, 0.0, 0.8)]
)
def test_a_mirror_shows_a_light_half_way_to_it(towards: tuple[float, float, float]) -> None:
    """Seen from +Z, x to the right, y up: the normal is half way between light and view."""
    radiance = torch.zeros(32, 64, 3)
    row, column = texel_of(*towards)
    radiance[row, column] = 1.0
    image = spheres._mirror(radiance[None], SIZE)[0, ..., 0]
    centre = (2 * torch.arange(SIZE) + 1) / SIZE - 1
    x = float((image.sum(0) * centre).sum() / image.sum())
    y = float((image.sum(1) * -centre).sum() / image.sum())
    half = latlong.directions(32, 64)[row, column] + torch.tensor([0.0, 0.0, 1.0])
    # the texel's image, 0.1 wide, is a little larger on the side towards the view
    assert (x, y) == pytest.approx((half / half.norm())[:2].tolist(), abs=0.01)


def test_a_lamp_lights_the_matt_ball_by_the_cosine(furnace: torch.Tensor) -> None:
    row, column = texel_of(1.0, 0.0, 0.0)
    flux = float(latlong.texel_solid_angles(32, 64)[row, column])
    light = latlong.directions(32, 64)[row, column]
    i = round((0.2 + 1) * SIZE / 2)  # away from the highlight at 0.7
    x, y = (2 * i + 1) / SIZE - 1, -1 / SIZE
    normal = torch.tensor([x, y, math.sqrt(1 - x * x - y * y)])
    low, high = albedo_parts(normal[2:].double(), spheres.LAYER_ROUGHNESS**2)[0].tolist()
    expected = 0.8 * (1 - 0.04 * low - high) * flux * float(normal @ light) / math.pi
    # the layer's tail adds some percent
    assert float(furnace[1, 2, SIZE // 2, i, 0]) == pytest.approx(expected, rel=0.06)
    assert float(furnace[1, 2, SIZE // 2, 8, 0]) < 0.02 * expected, "turned away from the lamp"


def test_the_protocol_brings_the_median_to_a_half() -> None:
    radiance = torch.rand(256, 512, 3, generator=torch.Generator().manual_seed(0)) ** 4
    found = spheres.tone_mapped(radiance)
    assert found.shape == (128, 256, 3)
    assert float(found.median()) == pytest.approx(0.5, rel=1e-4)
    reduced = latlong.reduce(radiance, 128, 256).numpy() ** (1 / 2.4)
    np.testing.assert_allclose(found.numpy(), reduced * (0.5 / np.median(reduced)), rtol=1e-4)


def test_the_protocol_takes_the_median_of_what_is_lit() -> None:
    radiance = torch.zeros(8, 16, 3)
    radiance[0] = -1.0
    radiance[3, 2:5] = torch.tensor([1.0, 16.0, 81.0])[:, None]
    found = spheres.tone_mapped(radiance)
    assert float(found[0].abs().max()) == 0
    assert float(found[3, 3, 0]) == pytest.approx(0.5, rel=1e-5)
    assert float(spheres.tone_mapped(torch.zeros(8, 16, 3)).abs().max()) == 0


def random_balls() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    alpha = coverage(16)[..., None]
    ball, reference = (torch.rand(16, 16, 3, generator=generator) * alpha for _ in range(2))
    return ball, reference


def test_sphere_errors_are_their_definitions() -> None:
    ball, reference = random_balls()
    found = spheres.sphere_errors(ball, reference)
    inside = (coverage(16) > 0).numpy()
    p, g = ball.numpy()[inside].astype(float), reference.numpy()[inside].astype(float)

    def rmse(scale: float) -> float:
        return float(np.sqrt(((scale * p - g) ** 2).sum() / len(p)))

    assert found.rmse == pytest.approx(rmse(1.0), rel=1e-9)
    assert found.si_rmse == pytest.approx(
        scipy.optimize.minimize_scalar(rmse, bounds=(0, 10), method="bounded").fun, rel=1e-6
    )
    cosine = (p * g).sum(1) / (np.linalg.norm(p, axis=1) * np.linalg.norm(g, axis=1))
    angle = np.degrees(np.arccos(np.clip(cosine, 0, 1))).mean()
    assert found.angular == pytest.approx(angle, rel=1e-6)


def test_a_gain_is_an_error_but_no_scale_invariant_one() -> None:
    _, reference = random_balls()
    found = spheres.sphere_errors(2 * reference, reference)
    assert found.rmse > 0.5
    # the difference of two equal sums in float64, under a root
    assert found.si_rmse < 1e-6
    assert found.angular < 1e-3, "acos of a rounded 1"


def test_black_instead_of_light_is_wrong_by_a_right_angle() -> None:
    _, reference = random_balls()
    found = spheres.sphere_errors(torch.zeros_like(reference), reference)
    assert found.angular == pytest.approx(90)
    assert found.si_rmse == found.rmse > 0
    black = torch.zeros_like(reference)
    assert spheres.sphere_errors(black, black) == spheres.SphereErrors(0, 0, 0)
