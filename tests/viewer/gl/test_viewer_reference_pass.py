# SPDX-License-Identifier: Apache-2.0
"""The reference pass against sums in float64 that share nothing with it (tests/support/ball_truth).

Tolerances of pictures are about twice the error measured on llvmpipe at the same samples, which is
noise: every pixel has its own scramble.
"""

import functools

import ball_truth
import moderngl
import numpy as np
import pytest

from asglight.viewer.gl.albedo_table import albedo_table
from asglight.viewer.gl.reference.reference_cache import ReferenceCache
from asglight.viewer.gl.reference.reference_pass import TARGET_SAMPLES, ReferencePass
from asglight.viewer.state.balls import Ball, Material, ball_row

EYE = np.eye(3)
FROM_BEHIND = np.diag([-1.0, 1.0, -1.0])
SIZE = 24
ROUGHNESS = (0.05, 0.1, 0.25, 0.5, 1.0)
ROW = ball_row()
CENTRE = (2 * np.arange(SIZE) + 1) / SIZE - 1
RADIUS = np.hypot(CENTRE[:, None], CENTRE)
INSIDE = RADIUS < 0.9
"""Pixels away from the edge, where albedos are steep and the coverage is another estimate."""


@pytest.fixture
def reference(opengl: moderngl.Context) -> ReferencePass:
    return ReferencePass(opengl, albedo_table(opengl))


def begin(
    reference: ReferencePass, balls: tuple[Ball, ...] = ROW, camera: np.ndarray = EYE
) -> None:
    cells = [(SIZE * i, 0, SIZE) for i in range(len(balls))]
    reference.restart(balls, camera, cells, (SIZE * len(balls), SIZE))


def read(reference: ReferencePass) -> np.ndarray:
    """Return what is in the target, apart by ball.  [balls, SIZE, SIZE, 4]."""
    target = reference.framebuffer
    values = np.frombuffer(target.read(components=4, dtype="f4"), np.float32)
    return values.reshape(target.height, -1, SIZE, 4).transpose(1, 0, 2, 3)


def picture(
    reference: ReferencePass,
    radiance: np.ndarray,
    balls: tuple[Ball, ...] = ROW,
    camera: np.ndarray = EYE,
    samples: int = TARGET_SAMPLES,
) -> np.ndarray:
    reference.set_map(radiance.astype(np.float32))
    begin(reference, balls, camera)
    reference.accumulate(samples)
    return read(reference)


def l1(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(found[..., :3] - truth).sum() / truth.sum())


def sky(value: float, height: int = 256) -> np.ndarray:
    return np.full((height, 2 * height, 3), value, np.float32)


def truth_row(texels: ball_truth.Texels, even: float) -> list[np.ndarray]:
    """Return the row under some texels and an even sky.  [6] x [SIZE, SIZE, 3]."""
    shown = [ball_truth.layer(texels, roughness, SIZE) for roughness in ROUGHNESS]
    shown.append(ball_truth.base(texels, SIZE))
    if even:
        shown = [one + even * white for one, white in zip(shown, furnace(), strict=True)]
    return shown


@functools.cache
def furnace() -> list[np.ndarray]:
    """Return the row under an even sky of 1.  [6] x [SIZE, SIZE, 3]."""
    albedos = [ball_truth.albedo(roughness, SIZE) for roughness in ROUGHNESS]
    return [*albedos, ball_truth.white(SIZE)]


def suns(where: str) -> tuple[np.ndarray, np.ndarray, ball_truth.Texels]:
    """Return a map with suns on a sky of 0.5, a camera, and what it sees of the suns."""
    radiance, camera = sky(0.5), EYE
    if where == "texel":
        rows, columns = np.array([70]), np.array([200])
    elif where == "seam":
        rows, columns, camera = np.array([100, 100]), np.array([0, 511]), FROM_BEHIND
    elif where == "pole":
        rows, columns = np.zeros(512, int), np.arange(512)
    else:  # a lamp of 1.4 degrees
        rows, columns = np.array([90, 90, 91, 91]), np.array([300, 301, 300, 301])
    colour = np.array([1.0, 0.8, 0.6]) * {"texel": 5e4, "pole": 1e4}.get(where, 2e3)
    radiance[rows, columns] = colour
    seen = columns if camera is EYE else (columns + 256) % 512
    excess = np.broadcast_to(colour - 0.5, (len(rows), 3))
    return radiance, camera, ball_truth.Texels(rows, seen, excess, (256, 512))


@pytest.mark.parametrize("where", ["texel", "seam", "pole", "lamp"])
def test_suns_are_as_a_sum_over_them_says(reference: ReferencePass, where: str) -> None:
    radiance, camera, texels = suns(where)
    found = picture(reference, radiance, camera=camera)
    errors = [l1(f, t) for f, t in zip(found, truth_row(texels, 0.5), strict=True)]
    assert max(errors) < 0.02


def test_a_map_of_many_contrasts_is_as_a_sum_over_its_texels_says(reference: ReferencePass) -> None:
    generator = np.random.default_rng(0)
    radiance = generator.exponential(1.0, (16, 32, 3))
    radiance *= 10 ** generator.uniform(-1, 1, (16, 32, 1))
    radiance[4, 5] = 3e3
    found = picture(reference, radiance)
    texels = ball_truth.whole(np.kron(radiance, np.ones((2, 2, 1))))
    for ball, truth in zip(found, truth_row(texels, 0.0), strict=True):
        assert l1(ball, truth) < 0.03


def test_the_blur_of_the_first_samples_goes_away(reference: ReferencePass) -> None:
    radiance = np.zeros((64, 128, 3))
    radiance[10:34, 40:100] = 1.0  # a sky light, too wide to be a sun
    texels = ball_truth.Texels(*np.nonzero(radiance[..., 0]), np.ones((24 * 60, 3)), (64, 128))
    truth = truth_row(texels, 0.0)
    errors = {}
    for samples in (16, TARGET_SAMPLES):
        found = picture(reference, radiance, samples=samples)
        errors[samples] = [l1(f, t) for f, t in zip(found, truth, strict=True)]
    assert max(errors[TARGET_SAMPLES]) < 0.03  # 2 % of it is the noise of the truth
    assert max(errors[16]) > 0.05  # so that the blur matters here


def test_a_white_furnace_gives_the_albedo(reference: ReferencePass) -> None:
    balls = (*ROW, *ball_row(Material.DIELECTRIC))
    found = picture(reference, sky(1.0, 64), balls)
    white = ball_truth.white(SIZE)
    for ball, shown in zip(balls, found, strict=True):
        truth = white
        if ball.roughness is not None:
            truth = ball_truth.albedo(ball.roughness, SIZE, ball.f0[0])
            truth = truth + ball.albedo[0] * (white - truth)
        error = np.abs(shown[..., :3] - truth)[INSIDE]
        # of 1; noise, the steps of the table of albedos and those between normals of the tables
        assert error.max() < 4e-3


def test_a_dielectric_is_a_fresnel_layer_over_a_base_that_it_dims(reference: ReferencePass) -> None:
    radiance, _, texels = suns("lamp")
    red = Ball(0.5, f0=(0.04, 0.04, 0.04), albedo=(0.8, 0.0, 0.0))
    gold = Ball(0.1, f0=(1.0, 0.6, 0.2))
    found = picture(reference, np.maximum(radiance - 0.5, 0), (red, gold))
    layer = ball_truth.layer(texels, 0.5, SIZE, f0=0.04)
    through = ball_truth.white(SIZE) - ball_truth.albedo(0.5, SIZE, f0=0.04)
    truth = layer + through * ball_truth.base(texels, SIZE) * [0.8, 0.0, 0.0]
    assert l1(found[0][INSIDE], truth[INSIDE]) < 0.01
    coloured = [ball_truth.layer(texels, 0.1, SIZE, f0=f0)[..., c] for c, f0 in enumerate(gold.f0)]
    assert l1(found[1], np.stack(coloured, axis=-1)) < 0.03  # no sky: tails alone


def test_the_alpha_is_the_coverage_and_row_0_the_top(reference: ReferencePass) -> None:
    radiance = sky(0.0, 64)
    radiance[:32] = 1.0
    found = picture(reference, radiance, samples=16)
    coverage = np.clip((1 - RADIUS) * SIZE / 2 + 0.5, 0, 1)
    rounded = SIZE * 2.0**-23  # radii in float32, and of centres that are no power of two
    wanted = np.broadcast_to(coverage, (6, SIZE, SIZE))
    np.testing.assert_allclose(found[..., 3], wanted, atol=rounded)
    assert (found[..., :3][:, coverage == 0] == 0).all()
    half = SIZE // 2
    upper, lower = found[:, :half, :, :3].sum((1, 2, 3)), found[:, half:, :, :3].sum((1, 2, 3))
    assert (upper > 2 * lower).all()


def test_balls_are_drawn_into_their_cells_alone(reference: ReferencePass) -> None:
    reference.set_map(sky(1.0, 64))
    reference.restart(ROW[:2], EYE, [(3, 5, 16), (25, 8, 20)], (64, 48))
    for _ in range(3):
        reference.accumulate(2)
    target = reference.framebuffer
    alpha = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(48, 64, 4)
    alpha = alpha[..., 3].copy()
    assert alpha[13, 11] == alpha[18, 35] == 1
    alpha[5:21, 3:19] = alpha[8:28, 25:45] = 0
    assert not alpha.any()
    reference.restart(ROW[:1], EYE, [(40, 30, 16)], (64, 48))
    for _ in range(2):
        reference.accumulate(1)
    values = np.frombuffer(reference.framebuffer.read(components=4, dtype="f4"), np.float32)
    assert not values.reshape(48, 64, 4)[:30].any()  # nothing of the picture before
    assert reference.texture.size == (64, 48)


def test_samples_add_up_however_they_are_dealt_and_end_at_the_target(
    reference: ReferencePass,
) -> None:
    at_once = picture(reference, suns("texel")[0], samples=64)
    begin(reference)
    for samples in (1, 7, 24, 32):
        reference.accumulate(samples)
    assert reference.samples == 64
    # a mean is rounded once for each call
    np.testing.assert_allclose(read(reference), at_once, rtol=1e-5, atol=1e-5)
    begin(reference, ROW[-1:])
    reference.accumulate(10**6)
    assert reference.samples == reference.target_samples
    finished = read(reference)
    reference.accumulate(16)
    assert reference.samples == reference.target_samples
    np.testing.assert_array_equal(read(reference), finished)


@pytest.mark.parametrize("shape", [(1, 2), (2, 4), (5, 10), (64, 128)])
def test_no_radiance_gives_anything_but_numbers(
    reference: ReferencePass, shape: tuple[int, int]
) -> None:
    balls = (*ROW, *ball_row(Material.DIELECTRIC))
    black = np.zeros((*shape, 3))
    assert not picture(reference, black, balls, samples=16)[..., :3].any()
    wide = black + 10 ** np.linspace(-30, 9, black.size).reshape(black.shape)
    bright = black.copy()
    bright[0, 0] = 1e9
    for radiance in (wide, bright):
        found = picture(reference, radiance, balls, samples=16)
        assert np.isfinite(found).all()
        assert (found >= 0).all()
    even = picture(reference, black + 1e9, balls, samples=16)
    np.testing.assert_allclose(even[5, 16, 16, :3], 1e9, rtol=1e-3)  # as the white furnace


def test_a_picture_that_comes_back_from_the_cache_goes_on(reference: ReferencePass) -> None:
    whole = picture(reference, suns("lamp")[0], samples=48)
    cache = ReferenceCache(2**20)
    begin(reference)
    reference.accumulate(16)
    first = reference.detach()
    assert first is not None
    cache.put("lamp", first)
    reference.restart(ROW[:1], EYE, [(0, 0, 64)], (64, 64))
    reference.accumulate(16)
    found = cache.take("lamp")
    assert found is not None
    assert "lamp" not in cache
    reference.resume(found)
    assert reference.samples == 16
    reference.accumulate(32)
    np.testing.assert_allclose(read(reference), whole, rtol=1e-5, atol=1e-5)


def test_the_cache_releases_what_was_not_used_for_longest(
    opengl: moderngl.Context, reference: ReferencePass
) -> None:
    cache = ReferenceCache(2 * 16 * 32 * 32)
    for key in "abc":
        reference.restart(ROW[:1], EYE, [(0, 0, 32)], (32, 32))
        reference.accumulate(1)
        picture = reference.detach()
        assert picture is not None
        cache.put(key, picture)
    assert [key in cache for key in "abc"] == [False, True, True]
    assert cache.byte_count == 2 * 16 * 32 * 32
    assert all(cache.take(key) is not None for key in "bc")
    assert cache.byte_count == 0
    begin(reference)  # a released target that is still bound would be an error here
    assert opengl.error == "GL_NO_ERROR"
    assert cache.take("b") is None


def test_a_picture_larger_than_the_budget_is_not_kept(reference: ReferencePass) -> None:
    cache = ReferenceCache(1000)
    begin(reference)
    picture = reference.detach()
    assert picture is not None
    cache.put("large", picture)
    assert "large" not in cache
    begin(reference)


@pytest.mark.parametrize("pole", [1.0, -1.0])
def test_light_of_one_pole_does_not_reach_the_other(reference: ReferencePass, pole: float) -> None:
    # Seen from a pole of a map whose half about that pole is white, the middle of a ball is lit by
    # white alone; a table that repeats in rows would filter it with the dark pole.
    radiance = sky(0.0, 64)
    radiance[:32] = 1.0
    half = radiance if pole > 0 else radiance[::-1].copy()
    camera = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -pole], [0.0, pole, 0.0]])
    matte = Ball(0.1, f0=(0.0, 0.0, 0.0), albedo=(1.0, 1.0, 1.0))
    middle = slice(SIZE // 2 - 2, SIZE // 2 + 2)
    shown = picture(reference, half, (matte,), camera, samples=64)[0, middle, middle, :3]
    # 1 - f0 A - B at f0 = 0; the cosine's tail over the horizon is below 1e-2 so near the pole
    np.testing.assert_allclose(shown, 1.0, atol=0.01)
