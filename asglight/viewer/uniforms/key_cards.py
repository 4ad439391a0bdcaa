# SPDX-License-Identifier: Apache-2.0
"""Keys as the rectangles that they are: what they add to a map, and their outlines on it.

A key is the lobe of its card's flux and second moments (`asglight.keys.lobes`), so its card is the
one that a stage makes of that lobe.

Symbols: K keys; H, W rows and columns of a map; P points.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.sphere import latlong
from asglight.viewer.uniforms.outlines import Outline, closed_curve

Array = NDArray[np.float64]

POINTS = 256
"""On a card, each way, that its light is gathered from: a card of 60 degrees has six across a texel
of a map of 512 rows, so that its edge is right to a sixth of a texel."""


def half_extents(keys: Lobes) -> Tensor:
    """Return the tangents of the half angles of cards.  [K, 2]."""
    from asglight.usd.lights import cards  # pxr, which only keyed stages need

    return cards.half_extent(cards.mean_squares(asg.moments(keys.to(torch.float64))))


def outlines(keys: Lobes) -> list[Outline]:
    """Return the rectangle of each key, and its axes.

    Args:
        keys: Of one frame.  [K, .]
    """
    found = []
    axes = keys.axes.to("cpu", torch.float64).numpy()
    for frame, (p, q) in zip(axes, half_extents(keys).numpy(), strict=True):
        corners = [(p, q), (-p, q), (-p, -q), (p, -q), (p, q)]
        arms = [(-p, 0.0), (p, 0.0)], [(0.0, -q), (0.0, q)]
        curve, *lines = (closed_curve(_directions(frame, points)) for points in (corners, *arms))
        found.append(Outline(curve, lines[0], lines[1]))
    return found


def _directions(frame: Array, points: list[tuple[float, float]]) -> Array:
    """Return the directions to points of the plane z = 1 of a frame.  [P, 3]."""
    local = np.array([(x, y, 1.0) for x, y in points])
    seen = local @ frame
    return seen / np.linalg.norm(seen, axis=-1, keepdims=True)


def with_cards(radiance: NDArray[np.float32], keys: Lobes) -> NDArray[np.float32]:
    """Return a map with the light of cards added, a mean a texel.

    Args:
        radiance: [H, W, 3]
        keys: Of one frame.  [K, .]
    """
    height, width = radiance.shape[:2]
    found = np.zeros((height * width, 3))
    flux = asg.flux(keys.to("cpu", torch.float64)).numpy()
    axes = keys.axes.to("cpu", torch.float64).numpy()
    step = (2 * (np.arange(POINTS) + 0.5) / POINTS - 1)[None]
    for frame, extent, light in zip(axes, half_extents(keys).numpy(), flux, strict=True):
        if not light.any():
            continue
        x, y = extent[0] * step, extent[1] * step.T
        weight = (1 + x * x + y * y) ** -1.5
        seen = x[..., None] * frame[0] + y[..., None] * frame[1] + frame[2]
        u, v = (one.numpy() for one in latlong.uv_from_direction(torch.from_numpy(seen)))
        row = (v * height).astype(int).clip(0, height - 1)
        place = row * width + (u * width).astype(int) % width
        share = np.bincount(place.ravel(), weight.ravel() / weight.sum(), height * width)
        lit = np.flatnonzero(share)
        found[lit] += share[lit, None] * light
    solid = latlong.texel_solid_angles(height, width, dtype=torch.float64).numpy()
    return (radiance + found.reshape(height, width, 3) / solid[..., None]).astype(np.float32)


def radiance(keys: Lobes, direction: Tensor) -> Tensor:
    """Return what cards show in a direction, seen from their middle.

    Args:
        keys: Of one frame.  [K, .]
        direction: Unit.  [3]

    Returns:
        [3]
    """
    from asglight.usd.lights import cards

    extent = half_extents(keys)
    local = keys.axes.to(torch.float64) @ direction.to(torch.float64)  # [K, 3]
    x, y, z = local.unbind(-1)
    hit = (z > 0) & (x.abs() <= extent[:, 0] * z) & (y.abs() <= extent[:, 1] * z)
    light = asg.flux(keys.to(torch.float64)) / cards.solid_angle(extent)[:, None]
    return (light * hit[:, None]).sum(0).float()
