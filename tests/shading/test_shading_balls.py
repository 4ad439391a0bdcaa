# SPDX-License-Identifier: Apache-2.0
"""Balls against independent quadrature: directional albedo, a mirror, a small lamp in float64."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import scipy.integrate
import scipy.special
import torch

from asglight.errors import InputError
from asglight.shading import balls
from asglight.shading.balls import ROUGHNESS, coverage, covered, render_balls
from asglight.sphere import latlong

SIZE = 64


def _pixel(row: int, column: int) -> tuple[float, float]:
    return (2 * column + 1) / SIZE - 1, 1 - (2 * row + 1) / SIZE


def _brdf(n_h: np.ndarray, n_v: np.ndarray, n_l: np.ndarray, alpha: float) -> np.ndarray:
    """GGX with height-correlated Smith from the Lambda functions: not the form the code uses."""

    def lam(cosine: np.ndarray) -> np.ndarray:
        tan2 = 1 / cosine**2 - 1
        return (np.sqrt(1 + alpha**2 * tan2) - 1) / 2

    tan2_h = 1 / n_h**2 - 1
    d = 1 / (math.pi * alpha**2 * n_h**4 * (1 + tan2_h / alpha**2) ** 2)
    return d / (1 + lam(n_v) + lam(n_l)) / (4 * n_v * n_l)


def _albedo(n_v: float, alpha: float) -> float:
    """Integrate f n.l over half vectors by Gauss and Legendre, in float64: E(n.v, alpha)."""
    nodes, weights = scipy.special.roots_legendre(600)
    u, w_u = (nodes + 1) / 2, weights / 2  # share of the mass of D: spreads its peak
    phi, w_phi = math.pi * (nodes + 1) / 2, weights / 2  # the other half circle is the same
    sin2 = (alpha**2 * u / (1 - (1 - alpha**2) * u))[:, None]
    n_h = np.sqrt(1 - sin2)
    v_h = np.sqrt(sin2) * np.cos(phi) * math.sqrt(1 - n_v**2) + n_h * n_v
    n_l = 2 * v_h * n_h - n_v
    lit = (n_l > 0) & (v_h > 0)
    density = alpha**2 / (math.pi * (alpha**2 + (1 - alpha**2) * sin2) ** 2)
    f = _brdf(n_h, np.array(n_v), np.where(lit, n_l, 1.0), alpha)
    # dl = 4 v.h dh, and dh has density D n.h in (u, phi).
    integrand = np.where(lit, f * n_l * 4 * v_h / (density * n_h), 0.0)
    return float(w_u @ integrand @ w_phi)


HEIGHT = 256
WHITE, SMOOTH, LAMP = range(3)
ALBEDO_AT = ((31, 31), (31, 48), (10, 20))
MIRROR_AT = ((31, 31), (16, 40), (44, 10))


def _pixels(*places: tuple[int | slice, int | slice]) -> torch.Tensor:
    """Choose pixels by row and column.  [SIZE, SIZE]."""
    chosen = torch.zeros(SIZE, SIZE, dtype=torch.bool)
    for row, column in places:
        chosen[row, column] = True
    return chosen


def _rendered(maps: torch.Tensor, roughness: Sequence[float], pixels: torch.Tensor, **view):
    """Render some pixels; the others stay black, for each sums over all texels by itself."""
    share, normals = covered(SIZE)
    cover = coverage(SIZE)
    kept = pixels[cover > 0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(balls, "coverage", lambda _: cover * pixels)
        patch.setattr(balls, "covered", lambda _: (share[kept], normals[kept]))
        return render_balls(maps, roughness, size=SIZE, **view)


RENDERED = _pixels(
    *ALBEDO_AT,
    *MIRROR_AT,
    (slice(16, 25), slice(44, 53)),  # the highlight of the small lamp, and around it
    (31, slice(None)),  # from rim to rim
    (0, slice(None)),  # what only touches the ball
    (slice(None), 63),
)


@pytest.fixture(scope="module")
def rendered() -> torch.Tensor:
    """Render every roughness under three maps at once, for it is kernels that take the time.

    Returns:
        Radiance under WHITE, SMOOTH and LAMP, where `RENDERED`.  [3, 5, SIZE, SIZE, 3]
    """
    maps = torch.stack([torch.ones(HEIGHT, 2 * HEIGHT, 3), _smooth_map(HEIGHT), _small_lamp()])
    return _rendered(maps, ROUGHNESS, RENDERED)


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let grids be four times as coarse, for what does not depend on how fine they are."""
    monkeypatch.setattr(balls, "_ROWS", tuple(rows // 4 for rows in balls._ROWS))


@pytest.mark.slow
@pytest.mark.parametrize("roughness", ROUGHNESS)
def test_ball_in_a_white_furnace_shows_the_directional_albedo(
    rendered: torch.Tensor, roughness: float
) -> None:
    image = rendered[WHITE, ROUGHNESS.index(roughness)]
    for row, column in ALBEDO_AT:
        x, y = _pixel(row, column)
        expected = _albedo(math.sqrt(1 - x * x - y * y), roughness**2)
        # The sharp balls are scaled to it; the others feel the texels of the coarse grid.
        assert image[row, column].numpy() == pytest.approx([expected] * 3, rel=3e-3)


def _smooth_map(height: int) -> torch.Tensor:
    d = latlong.directions(height, 2 * height)
    return 2 + d * torch.tensor([1.0, -0.7, 0.5])


MIRROR_OFF = 0.01
"""One percent: noise of the points where the map has a slope."""


def _off_mirror(image: torch.Tensor, view: tuple[float, float, float]) -> float:
    """Return by how much a ball is off what a mirror shows, at three pixels, relative."""
    off = 0.0
    v = np.array(view) / np.linalg.norm(view)
    up = np.array([0.0, 0.0, -1.0]) if v[1] == 1 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, v) / np.linalg.norm(np.cross(up, v))
    up = np.cross(v, right)
    for row, column in MIRROR_AT:
        x, y = _pixel(row, column)
        n = x * right + y * up + math.sqrt(1 - x * x - y * y) * v
        mirrored = 2 * (n @ v) * n - v
        expected = 2 + mirrored * np.array([1.0, -0.7, 0.5])
        off = max(off, float(np.abs(image[row, column].numpy() / expected - 1).max()))
    return off


@pytest.mark.slow
def test_ball_of_no_roughness_is_a_mirror(rendered: torch.Tensor) -> None:
    assert _off_mirror(rendered[SMOOTH, 0], (0.0, 0.0, 1.0)) < MIRROR_OFF


@pytest.mark.slow
@pytest.mark.parametrize("view", [(0.3, -0.5, -2.0), (0.0, 1.0, 0.0)])
def test_ball_of_no_roughness_is_a_mirror_from_every_side(
    view: tuple[float, float, float],
) -> None:
    maps = _smooth_map(HEIGHT)[None]
    image = _rendered(maps, ROUGHNESS[:1], _pixels(*MIRROR_AT), view=view)[0, 0]
    assert _off_mirror(image, view) < MIRROR_OFF


def test_right_of_the_ball_reflects_the_right_of_the_camera() -> None:
    lamp = torch.zeros(1, 64, 128, 3)
    lamp[:, 32, 32] = 1.0  # u = 1/4: +X
    image = render_balls(lamp, [0.25], size=SIZE)[0, 0, ..., 0]
    row, column = divmod(int(image.argmax()), SIZE)
    x, y = _pixel(row, column)
    # The normal is half way between +Z and +X.
    assert (x, y) == pytest.approx((math.sqrt(0.5), 0.0), abs=2 / SIZE)


TEXELS = ((80, 150), (80, 151), (81, 150), (81, 151))
"""Of the small lamp: row and column."""


def _small_lamp() -> torch.Tensor:
    lamp = torch.zeros(HEIGHT, 2 * HEIGHT, 3)
    for row, column in TEXELS:
        lamp[row, column] = 1e5
    return lamp


def _lamp_points(sub: int) -> tuple[np.ndarray, float]:
    """Split its texels into points of equal solid angle: their directions, and the flux of each."""
    height = HEIGHT
    share = (np.arange(sub) + 0.5) / sub
    points = []
    for row, column in TEXELS:
        top, bottom = (math.cos(math.pi * r / height) for r in (row, row + 1))
        y = (top + (bottom - top) * share)[:, None]
        lon = math.pi - 2 * math.pi * (column + share)[None, :] / (2 * height)
        level = np.sqrt(1 - y * y)
        xyz = np.stack(np.broadcast_arrays(level * np.sin(lon), y, level * np.cos(lon)), -1)
        points.append(xyz.reshape(-1, 3))
    top, bottom = (math.cos(math.pi * r / height) for r in (TEXELS[0][0], TEXELS[0][0] + 1))
    solid_angle = (2 * math.pi / (2 * height)) * (top - bottom)
    return np.concatenate(points), 1e5 * solid_angle / sub**2


def _brute_pixel(
    row: int, column: int, roughness: float, lights: np.ndarray, flux: float, sub: int
) -> float:
    """Mean over a pixel of the light of point lamps reflected towards +Z, in float64."""
    offset = ((np.arange(sub) + 0.5) / sub * 2 - 1) / SIZE
    x0, y0 = _pixel(row, column)
    x, y = (a.reshape(-1, 1) for a in np.meshgrid(x0 + offset, y0 + offset))
    inside = x * x + y * y < 1
    z = np.sqrt(np.clip(1 - x * x - y * y, 1e-12, None))
    n = np.concatenate([x, y, z], -1)
    half = lights + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    n_l = n @ lights.T
    lit = inside & (n_l > 0)
    f = _brdf(np.clip(n @ half.T, 1e-6, 1), z, np.where(lit, n_l, 1.0), roughness**2)
    return float(np.where(lit, f * n_l * flux, 0.0).sum() / sub**2)


@pytest.mark.slow
@pytest.mark.parametrize("roughness", ROUGHNESS[:4])
def test_small_bright_lamp_agrees_with_brute_force_in_float64(
    rendered: torch.Tensor, roughness: float
) -> None:
    image = rendered[LAMP, ROUGHNESS.index(roughness), ..., 0].double()
    # The lobe of the sharpest ball is 0.005 rad wide, a texel 0.012 and a pixel 0.06.
    lights, flux = _lamp_points(sub=6)
    row, column = divmod(int(image.argmax()), SIZE)
    rows, columns = range(row - 2, row + 3), range(column - 2, column + 3)
    brute = np.array(
        [[_brute_pixel(r, c, roughness, lights, flux, sub=64) for c in columns] for r in rows]
    )
    ours = image[rows.start : rows.stop, columns.start : columns.stop].numpy()
    # As render_balls says: 128 points per pixel against 4096, and texels of the coarse grid.
    assert ours.sum() == pytest.approx(brute.sum(), rel=0.05 if roughness < 0.1 else 0.025)
    assert np.abs(ours - brute).sum() < 0.1 * brute.sum()


@pytest.mark.usefixtures("coarse")
def test_maps_are_rendered_independently_and_linearly() -> None:
    generator = torch.Generator().manual_seed(1)
    maps = torch.rand(2, 16, 32, 3, generator=generator)
    both = render_balls(maps, [0.5, 1.0], size=64)
    alone = render_balls(maps[1:] * 3, [0.5, 1.0], size=64)
    assert both.shape == (2, 2, 64, 64, 3)
    torch.testing.assert_close(alone[0], 3 * both[1], rtol=1e-4, atol=1e-5)


@pytest.mark.usefixtures("coarse")
def test_small_ball_is_the_mean_of_a_larger_one() -> None:
    maps = _smooth_map(16)[None]
    small, large = (render_balls(maps, [0.5], size=s)[0, 0] for s in (22, 66))
    expected = large.view(22, 3, 22, 3, 3).mean((1, 3))
    torch.testing.assert_close(small, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.slow
def test_coverage_is_the_area_of_the_disc_and_the_background_is_black(
    rendered: torch.Tensor,
) -> None:
    area = float(coverage(SIZE).sum()) * (2 / SIZE) ** 2
    assert area == pytest.approx(math.pi, rel=2e-3)  # 8 x 8 points per pixel
    image = rendered[WHITE]
    assert (image[:, coverage(SIZE) == 0] == 0).all()
    assert (image[:, (coverage(SIZE) > 0) & RENDERED] > 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"maps": torch.ones(8, 16, 3)}, r"maps: shape \(8, 16, 3\); expected \[K, H, W, 3\]"),
        ({"roughness": [0.5, 1.5]}, r"roughness: 1.5; expected 0.05 to 1"),
        ({"roughness": [0.0]}, r"roughness: 0; expected 0.05 to 1"),
        ({"size": 0}, r"size: 0; expected 1 pixel or more"),
        ({"view": (0.0, 0.0, 0.0)}, r"view: a vector of length 0; expected a direction"),
    ],
)
def test_input_that_cannot_be_rendered_is_refused(change: dict, message: str) -> None:
    arguments = {"maps": torch.ones(1, 8, 16, 3), "roughness": [0.5], "size": 8} | change
    maps, roughness = arguments.pop("maps"), arguments.pop("roughness")
    with pytest.raises(InputError, match=message):
        render_balls(maps, roughness, **arguments)
