# SPDX-License-Identifier: Apache-2.0
"""What lights and rest of a keyed stage show at the origin, as UsdLux says it: pxr alone.

Symbols: H, W rows and columns of a map; M, N of a texture; P rays.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.images import read_latlong
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.strips import read_pixels
from asglight.sphere import latlong

RAYS = (12, 300)
"""Through a texel each way, at least and at most."""

RAYS_ACROSS = 150
"""Across the narrow side of a card: its flux is right to a few thousandths whatever its outline."""

ROUND = ((1, 1), (-1, 1), (-1, -1), (1, -1))
"""Corners of a rectangle, in order around it."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Light:
    """A light at a frame.

    Attributes:
        to_local: From the world to the light, for row vectors.  [4, 4]
        half: Half width and half height.
        radiance: Intensity times colour.  [3]
        image: Its texture, [M, N, 3]; None without.
    """

    to_local: Array
    half: tuple[float, float]
    radiance: Array
    image: NDArray[np.float32] | None


def seen(stage: Usd.Stage, frame: int, height: int, width: int) -> Array:
    """Return what lights and rest show at the origin, a mean a texel.  [H, W, 3]."""
    image = read_latlong(rest_image(stage, frame)).radiance.double()
    found = latlong.reduce(image, height, width).numpy().copy()
    for light in lights(stage, frame):
        add(found, light)
    return found


def rest_image(stage: Usd.Stage, frame: int) -> str:
    """Return the file of the rest at a frame."""
    dome = UsdLux.DomeLight(next(p for p in stage.Traverse() if p.GetName() == "Rest"))
    return dome.GetTextureFileAttr().Get(frame).resolvedPath


def lights(stage: Usd.Stage, frame: int) -> list[Light]:
    """Return the rectangles of a stage, as UsdLux says them."""
    found = []
    cache = UsdGeom.XformCache(frame)
    for prim in stage.Traverse():
        if not prim.IsA(UsdLux.RectLight):
            continue
        rect = UsdLux.RectLight(prim)
        api = UsdLux.LightAPI(prim)
        assert not api.GetNormalizeAttr().Get(frame)
        color = np.array(api.GetColorAttr().Get(frame), dtype=np.float64)
        asset = rect.GetTextureFileAttr().Get(frame)
        image = None
        if asset and asset.resolvedPath:
            image = read_pixels(read_header(Path(asset.resolvedPath)))
        half = rect.GetWidthAttr().Get(frame) / 2, rect.GetHeightAttr().Get(frame) / 2
        matrix = np.array(cache.GetLocalToWorldTransform(prim))
        radiance = api.GetIntensityAttr().Get(frame) * color
        found.append(Light(np.linalg.inv(matrix), half, radiance, image))
    return found


def add(image: Array, light: Light) -> None:
    """Add what a light shows to the texels of a map, along many rays through each."""
    height, width = image.shape[:2]
    corners = np.array([[x, y, 0, 1] for x in (-1, 1) for y in (-1, 1)]) * [*light.half, 1, 1]
    world = np.linalg.inv(light.to_local)
    points = (corners @ world)[:, :3]
    middle = world[3, :3] / np.linalg.norm(world[3, :3])
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    reach = np.arccos(np.clip((points @ middle).min(), -1, 1)) + 2 * np.pi / height
    centres = latlong.directions(height, width, dtype=torch.float64).numpy()
    row, column = np.nonzero(centres @ middle >= np.cos(min(reach, np.pi)))
    narrow = 2 * min(light.half) / np.linalg.norm(world[3, :3])
    rays = int(np.clip(RAYS_ACROSS * np.pi / height / narrow, *RAYS))
    inner = (np.arange(rays) + 0.5) / rays
    solid = np.zeros(len(row))
    total = np.zeros((len(row), 3))
    for down in inner:
        latitude = np.pi / 2 - np.pi * (row + down) / height
        for right in inner:
            longitude = np.pi - 2 * np.pi * (column + right) / width
            ray = np.stack(
                [
                    np.cos(latitude) * np.sin(longitude),
                    np.sin(latitude),
                    np.cos(latitude) * np.cos(longitude),
                ],
                axis=-1,
            )
            weight = np.cos(latitude)
            total += weight[:, None] * radiance_along(light, ray)
            solid += weight
    image[row, column] += total / solid[:, None]


def radiance_along(light: Light, ray: Array) -> Array:
    """Return what a light shows along rays from the origin.  [P, 3]."""
    origin = np.array([0, 0, 0, 1.0]) @ light.to_local
    local = np.concatenate([ray, np.zeros((len(ray), 1))], axis=-1) @ light.to_local
    faces = local[:, 2] > 0  # it shines along -z
    far = -origin[2] / np.where(faces, local[:, 2], 1)
    x, y = (origin[k] + far * local[:, k] for k in (0, 1))
    hit = faces & (np.abs(x) <= light.half[0]) & (np.abs(y) <= light.half[1])
    if light.image is None:
        return hit[:, None] * light.radiance
    rows, columns = light.image.shape[:2]
    # the first texel of the first row is at (+x, +y)
    u = ((1 - x / light.half[0]) / 2 * columns).clip(0, columns - 1).astype(int)
    v = ((1 - y / light.half[1]) / 2 * rows).clip(0, rows - 1).astype(int)
    return hit[:, None] * light.radiance * light.image[v, u]


def flux_error(stage: Usd.Stage, frame: int, reference: Tensor) -> float:
    """Return the largest relative error of a channel's flux, of cards in closed form."""
    image = read_latlong(rest_image(stage, frame)).radiance
    found = _flux(image)
    for light in lights(stage, frame):
        found += light.radiance * solid_angle(light) * texture_mean(light)
    truth = _flux(reference)
    return float(np.abs(found / truth - 1)[truth > 0].max())


def _flux(image: Tensor) -> Array:
    solid = latlong.texel_solid_angles(*image.shape[:2], dtype=torch.float64)[..., None]
    return (image.double() * solid).sum((0, 1)).numpy()


def corners(light: Light) -> Array:
    """Return the directions of a rectangle's corners, in order around it.  [4, 3]."""
    world = np.linalg.inv(light.to_local)
    local = [[i * light.half[0], j * light.half[1], 0, 1] for i, j in ROUND]
    found = (np.array(local) @ world)[:, :3]
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def solid_angle(light: Light) -> float:
    """Return the solid angle of a rectangle, wherever it stands, as four with a corner each.

    With the foot of the origin's perpendicular on its plane at h, and a corner at (u, v) from
    there, each is atan(u v / (h sqrt(h^2 + u^2 + v^2))).
    """
    x, y, h = (np.array([0, 0, 0, 1.0]) @ light.to_local)[:3]
    h, total = abs(h), 0.0
    for i, j in ROUND:
        u, v = i * light.half[0] - x, j * light.half[1] - y
        total += i * j * np.arctan2(u * v, h * np.sqrt(h * h + u * u + v * v))
    return float(total)


def texture_mean(light: Light) -> Array:
    """Return the mean of a texture by the solid angles of its texels.  [3]."""
    if light.image is None:
        return np.ones(3)
    rows, columns = light.image.shape[:2]
    x, y, h = (np.array([0, 0, 0, 1.0]) @ light.to_local)[:3]
    # the first texel of the first row is at (+x, +y)
    u = light.half[0] * (1 - 2 * (np.arange(columns) + 0.5) / columns)
    v = light.half[1] * (1 - 2 * (np.arange(rows) + 0.5) / rows)
    weight = ((u - x) ** 2 + (v[:, None] - y) ** 2 + h * h) ** -1.5
    return (light.image * weight[..., None]).sum((0, 1)) / weight.sum()
