# SPDX-License-Identifier: Apache-2.0
"""What balls show, by ways that share nothing with the reference pass of the viewer.

In float64, texels constant within: for sharp balls each sends samples to the pixels that mirror it
(`scattered`), for others every pixel looks at the centre of every texel (`gathered`).

Symbols: N texels, S samples. Balls are seen from +Z, +Y up; images hold radiance times coverage.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from asglight.shading import ggx
from asglight.sphere import latlong

Kernel = Callable[[np.ndarray], np.ndarray]

ALBEDO_NODES = 400
"""Values of n.v that albedos are interpolated between."""

SHARP_ALPHA = 0.1
"""Below it the highlight of a texel is narrower than the pixels of a small ball."""

DRAW = 2**18
"""Scattered samples: a highlight is within 0.3 % or so, on 32 pixels a map within 1.5 %."""

POINTS = 4
"""Points across a pixel where every pixel looks at every texel."""


@dataclass
class Texels:
    """Some texels of a map.

    Attributes:
        rows: Row of each.  [N]
        columns: Column of each.  [N]
        radiance: Of each, RGB.  [N, 3]
        shape: Rows and columns of the map.
    """

    rows: np.ndarray
    columns: np.ndarray
    radiance: np.ndarray
    shape: tuple[int, int]

    def solid_angles(self) -> np.ndarray:
        """Return the solid angle of each.  [N]."""
        return latlong.texel_solid_angles(*self.shape, dtype=torch.float64).numpy()[self.rows, 0]

    def directions(self, which: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return directions within texels, even over their solid angle.  [..., 3]."""
        height, width = self.shape
        edges = np.cos(np.pi * np.arange(height + 1) / height)
        rows = self.rows[which]
        y = edges[rows] + v * (edges[rows + 1] - edges[rows])
        longitude = np.pi - 2 * np.pi * (self.columns[which] + u) / width
        level = np.sqrt(1 - y * y)
        return np.stack([level * np.sin(longitude), y, level * np.cos(longitude)], axis=-1)


def layer(
    texels: Texels, roughness: float, size: int, f0: float = 1.0, draws: int = 1
) -> np.ndarray:
    """Return what a GGX ball shows of some texels.

    Args:
        texels: The texels.
        roughness: Perceptual.
        size: Pixels across.
        f0: Reflectance along the normal.
        draws: Times DRAW samples to scatter where the ball is sharp.

    Returns:
        Radiance times coverage.  [size, size, 3]
    """
    alpha = roughness**2
    if alpha >= SHARP_ALPHA:
        return gathered(texels, alpha, size, f0)
    engine = torch.quasirandom.SobolEngine(5, scramble=True, seed=0)
    images = [scattered(texels, alpha, size, f0, engine) for _ in range(draws)]
    return np.mean(images, axis=0)


def scattered(
    texels: Texels, alpha: float, size: int, f0: float, engine: torch.quasirandom.SobolEngine
) -> np.ndarray:
    """Send DRAW samples from texels to pixels: normals spread as D around each half vector.

    A pixel shows the mean over its area of L D V n.l, and dx dy = n.v dn; D n.h is a density.
    """
    points = engine.draw(DRAW, dtype=torch.float64).numpy()
    flux = texels.radiance * texels.solid_angles()[:, None]
    share = np.cumsum(flux.sum(1)) / flux.sum()
    which = np.minimum(np.searchsorted(share, points[:, 0], side="right"), len(share) - 1)
    light = texels.directions(which, points[:, 1], points[:, 2])
    half = light + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    sin2 = alpha**2 * points[:, 3] / (1 - (1 - alpha**2) * points[:, 3])
    turn = 2 * np.pi * points[:, 4]
    across = np.stack([half[:, 2], 0 * turn, -half[:, 0]], axis=-1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    along = np.cross(half, across)
    side = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * along
    normal = np.sqrt(1 - sin2)[:, None] * half + np.sqrt(sin2)[:, None] * side
    n_v, n_l = normal[:, 2], (normal * light).sum(1)
    seen = (n_v > 0) & (n_l > 0)
    fresnel = f0 + (1 - f0) * (1 - half[:, 2]) ** 5
    weight = np.zeros_like(n_v)
    weight[seen] = n_v[seen] * n_l[seen] * _visibility(n_v[seen], n_l[seen], alpha)
    weight *= fresnel / np.sqrt(1 - sin2) / DRAW * (size / 2) ** 2
    colour = flux[which] / np.diff(share, prepend=0)[which, None] * weight[:, None]
    column = np.clip((0.5 * (1 + normal[:, 0]) * size).astype(int), 0, size - 1)
    row = np.clip((0.5 * (1 - normal[:, 1]) * size).astype(int), 0, size - 1)
    image = [np.bincount(row * size + column, colour[:, c], size * size) for c in range(3)]
    return np.stack(image, axis=-1).reshape(size, size, 3)


def gathered(texels: Texels, alpha: float, size: int, f0: float) -> np.ndarray:
    """Sum over texel centres at a grid of points in each pixel."""
    light, flux = _centres(texels)
    v_l = light[:, 2]
    half_length = np.sqrt(np.maximum(2 + 2 * v_l, 1e-12))
    fresnel = f0 + (1 - f0) * (1 - 0.5 * half_length) ** 5

    def kernel(normal: np.ndarray) -> np.ndarray:
        n_l = np.maximum(normal @ light.T, 0)
        n_v = normal[:, 2:]
        n_h = (n_l + n_v) / half_length
        distribution = alpha**2 / np.pi / (1 - (1 - alpha**2) * n_h**2) ** 2
        return distribution * _visibility(n_v, n_l, alpha) * n_l * fresnel

    return _summed(kernel, flux, size)


def base(texels: Texels, size: int) -> np.ndarray:
    """Return what a white Lambertian ball shows of some texels.  [size, size, 3]."""
    light, flux = _centres(texels)
    return _summed(lambda normal: np.maximum(normal @ light.T, 0) / np.pi, flux, size)


def whole(radiance: np.ndarray) -> Texels:
    """Return all texels of a map."""
    rows, columns = np.indices(radiance.shape[:2]).reshape(2, -1)
    return Texels(rows, columns, radiance[rows, columns], radiance.shape[:2])


def white(size: int) -> np.ndarray:
    """Return what a ball that reflects everything shows in a white furnace.  [size, size, 3]."""
    return _averaged(np.ones_like, size)


def albedo(roughness: float, size: int, f0: float = 1.0) -> np.ndarray:
    """Return what a GGX ball shows in a white furnace.  [size, size, 3]."""
    cosines = np.linspace(1 / ALBEDO_NODES, 1, ALBEDO_NODES)
    parts = ggx.albedo_parts(torch.from_numpy(cosines), roughness**2).numpy()
    values = f0 * parts[:, 0] + parts[:, 1]
    return _averaged(lambda n: np.interp(n[:, 2:], cosines, values).repeat(3, 1), size)


def _centres(texels: Texels) -> tuple[np.ndarray, np.ndarray]:
    """Return direction and flux of each texel.  [N, 3], [N, 3]."""
    middle = np.full(len(texels.rows), 0.5)
    light = texels.directions(np.arange(len(texels.rows)), middle, middle)
    return light, texels.radiance * texels.solid_angles()[:, None]


def _summed(kernel: Kernel, flux: np.ndarray, size: int) -> np.ndarray:
    """Average a kernel times flux over the pixels of a ball, some points at a time."""
    step = max(1, 2**19 // len(flux))

    def shown(normals: np.ndarray) -> np.ndarray:
        parts = range(0, len(normals), step)
        return np.concatenate([kernel(normals[k : k + step]) @ flux for k in parts])

    return _averaged(shown, size)


def _averaged(shown: Kernel, size: int) -> np.ndarray:
    """Average over the points of each pixel that lie on the ball; elsewhere is nothing."""
    fine = size * POINTS
    centre = (2 * np.arange(fine) + 1) / fine - 1
    y, x = np.meshgrid(-centre, centre, indexing="ij")
    inside = x**2 + y**2 < 1
    x, y = x[inside], y[inside]
    image = np.zeros((fine, fine, 3))
    image[inside] = shown(np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=-1))
    return image.reshape(size, POINTS, size, POINTS, 3).mean((1, 3))


def _visibility(n_v: np.ndarray, n_l: np.ndarray, alpha: float) -> np.ndarray:
    """Return G2 / (4 n.v n.l), height-correlated [Heitz 2014], by Smith's Lambda."""
    both = [np.sqrt(1 + alpha**2 * (1 / np.maximum(c, 1e-9) ** 2 - 1)) for c in (n_v, n_l)]
    masking = 2 / (both[0] + both[1])
    return masking / (4 * n_v * np.maximum(n_l, 1e-9))
