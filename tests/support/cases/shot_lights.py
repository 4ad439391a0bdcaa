# SPDX-License-Identifier: Apache-2.0
"""The irradiance that the lights of a shot give at a point, by pxr and quadrature alone.

What UsdLux says of a light, and its transform by UsdGeom.XformCache; nothing of asglight but the
lobes that are held against it.
"""

import math
from pathlib import Path

import numpy as np
import OpenEXR
import torch
from numpy.typing import NDArray
from pxr import Usd, UsdGeom, UsdLux

from asglight.lobes import Lobes, asg
from asglight.sphere.quadrature import fibonacci_directions

NODES = 60
"""Of Gauss and Legendre, an axis of a card."""

DIRECTIONS = fibonacci_directions(60_000, dtype=torch.float64).numpy()
NORMALS = fibonacci_directions(40, dtype=torch.float64).numpy()
COSINE = np.maximum(NORMALS @ DIRECTIONS.T, 0) * (4 * math.pi / len(DIRECTIONS))
GAUSS = np.polynomial.legendre.leggauss(NODES)
GAUSS_DISC = np.polynomial.legendre.leggauss(40)

Array = NDArray[np.float64]


def irradiance(stage: Usd.Stage, frame: float, rig: str) -> Array:
    """Return the irradiance on patches at the rig's origin that face the normals.  [P, 3]."""
    cache = UsdGeom.XformCache(frame)
    origin = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(rig)))[3, :3]
    normals = NORMALS
    if UsdGeom.GetStageUpAxis(stage) == "Z":  # what points up does so in the stage
        normals = np.stack([NORMALS[:, 0], -NORMALS[:, 2], NORMALS[:, 1]], -1)
    total = np.zeros((len(normals), 3))
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        hidden = UsdGeom.Imageable(prim).ComputeVisibility(frame) == UsdGeom.Tokens.invisible
        if prim.HasAPI(UsdLux.LightAPI) and not hidden:
            matrix = np.array(cache.GetLocalToWorldTransform(prim))
            total += _of_light(prim, matrix, origin, frame, normals)
    return total


def irradiance_of_lobes(lobes: Lobes) -> Array:
    """Return the irradiance that lobes give on patches that face the normals.  [P, 3]."""
    radiance = asg.evaluate(lobes.to(torch.float64), torch.from_numpy(DIRECTIONS))
    return COSINE @ radiance.numpy()


def relative_rms(found: Array, wanted: Array) -> float:
    """Return the root mean square of a difference over that of what is wanted."""
    return float(np.sqrt(((found - wanted) ** 2).mean() / (wanted**2).mean()))


def _emission(prim: Usd.Prim, frame: float) -> Array:
    light = UsdLux.LightAPI(prim)
    color = np.array(light.GetColorAttr().Get(frame), dtype=float)
    if light.GetEnableColorTemperatureAttr().Get(frame):
        kelvin = light.GetColorTemperatureAttr().Get(frame)
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin))
    scale = light.GetIntensityAttr().Get(frame) * 2.0 ** light.GetExposureAttr().Get(frame)
    return scale * color


def _of_light(prim: Usd.Prim, matrix: Array, origin: Array, frame: float, normals: Array) -> Array:
    normalized = UsdLux.LightAPI(prim).GetNormalizeAttr().Get(frame)
    emitted = _emission(prim, frame)
    if prim.IsA(UsdLux.RectLight):
        directions, angles, area = _card(UsdLux.RectLight(prim), matrix, origin, frame)
        return (
            _received(normals, directions, angles)[:, None] * emitted / (area if normalized else 1)
        )
    if prim.IsA(UsdLux.DistantLight):
        half = math.radians(UsdLux.DistantLight(prim).GetAngleAttr().Get(frame)) / 2
        directions, angles = _disc(matrix[2, :3], half)
        size = (
            math.pi * math.sin(half) ** 2
            if half <= math.pi / 2
            else math.pi * (2 - math.sin(half) ** 2)
        )
        return (
            _received(normals, directions, angles)[:, None] * emitted / (size if normalized else 1)
        )
    assert prim.IsA(UsdLux.DomeLight)
    return _dome(UsdLux.DomeLight(prim), matrix, frame, normals) * emitted


def _received(normals: Array, directions: Array, angles: Array) -> Array:
    return np.maximum(normals @ directions.T, 0) @ angles


def _card(
    light: UsdLux.RectLight, matrix: Array, origin: Array, frame: float
) -> tuple[Array, Array, float]:
    """Return directions to a card, solid angles of its pieces, and its area in the stage."""
    nodes, weights = GAUSS
    sides = np.array([light.GetWidthAttr().Get(frame), light.GetHeightAttr().Get(frame)])
    along = matrix[:2, :3] * sides[:, None]
    u, v = (one.ravel() / 2 for one in np.meshgrid(nodes, nodes, indexing="ij"))
    points = matrix[3, :3] - origin + u[:, None] * along[0] + v[:, None] * along[1]
    distance = np.linalg.norm(points, axis=-1)
    area = np.cross(along[0], along[1])
    shines = -np.sign(area @ matrix[2, :3]) * area  # to the side that its -Z is on
    cosine = np.maximum(-(points @ shines) / distance, 0)
    pieces = np.outer(weights, weights).ravel() / 4
    return points / distance[:, None], pieces * cosine / distance**2, float(np.linalg.norm(area))


def _disc(axis: Array, half: float) -> tuple[Array, Array]:
    """Return directions over a disc in the sky, and their solid angles."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, [1.0, 0, 0] if abs(z[0]) < 0.7 else [0, 1.0, 0])
    x /= np.linalg.norm(x)
    nodes, weights = GAUSS_DISC
    low = math.cos(half)
    cosine = low + (1 - low) * (nodes + 1) / 2
    turns = 2 * math.pi * (np.arange(64) + 0.5) / 64
    sine = np.sqrt(1 - cosine**2)[:, None]
    around = np.cos(turns)[:, None] * x + np.sin(turns)[:, None] * np.cross(z, x)
    directions = cosine[:, None, None] * z + sine[..., None] * around
    angles = np.repeat(weights * (1 - low) / 2 * 2 * math.pi / 64, 64)
    return directions.reshape(-1, 3), angles


def _dome(light: UsdLux.DomeLight, matrix: Array, frame: float, normals: Array) -> Array:
    """Return what the image of a dome gives; its middle is +Z and its top +Y (UsdLux)."""
    path = light.GetTextureFileAttr().Get(frame).resolvedPath
    with OpenEXR.File(str(Path(path))) as file:
        image = file.channels()["RGB"].pixels.astype(float)
    rows, columns = image.shape[:2]
    polar = math.pi * (np.arange(rows) + 0.5) / rows
    turn = 2 * math.pi * (np.arange(columns) + 0.5) / columns  # u runs from +Z over -X
    polar, turn = np.meshgrid(polar, turn, indexing="ij")
    local = np.stack(
        [
            -np.sin(polar) * np.sin(turn - math.pi),
            np.cos(polar),
            np.sin(polar) * np.cos(turn - math.pi),
        ],
        -1,
    ).reshape(-1, 3)
    linear = matrix[:3, :3]
    directions = local @ (linear / np.linalg.norm(linear, axis=-1, keepdims=True))
    angles = np.sin(polar).ravel() * (math.pi / rows) * (2 * math.pi / columns)
    return np.maximum(normals @ directions.T, 0) @ (angles[:, None] * image.reshape(-1, 3))
