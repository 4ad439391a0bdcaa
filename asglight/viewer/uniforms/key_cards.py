# SPDX-License-Identifier: Apache-2.0
"""Keys as the rectangles that they are: what they add to a map, and their outlines on it.

A key is the lobe of its card's flux, second moments and slant (`asglight.keys.lobes`), so its card
is the one that a stage makes of that lobe.

Symbols: K keys; H, W rows and columns of a map; P points.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.lobes import Lobes, asg
from asglight.lobes.rectangles import Rectangles
from asglight.sphere import latlong
from asglight.viewer.uniforms.outlines import Outline, closed_curve

Array = NDArray[np.float64]

POINTS = 256
"""On a card, each way, that its light is gathered from: a card of 60 degrees has six across a texel
of a map of 512 rows, so that its edge is right to a sixth of a texel."""


def standing(keys: Lobes) -> Rectangles:
    """Return the rectangles of keys where they stand, in float64.

    Args:
        keys: Of one frame.  [K, .]
    """
    from asglight.usd.lights import cards  # pxr, which only keyed stages need

    return cards.rectangles_of(keys.to("cpu", torch.float64))


def outlines(keys: Lobes) -> list[Outline]:
    """Return the rectangle of each key, and its axes.

    Args:
        keys: Of one frame.  [K, .]
    """
    corners = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
    curves = [standing_points(keys, at) for at in (corners, [(-1, 0), (1, 0)], [(0, -1), (0, 1)])]
    return [Outline(*map(closed_curve, own)) for own in zip(*curves, strict=True)]


def standing_points(keys: Lobes, points: list[tuple[int, int]]) -> Array:
    """Return the directions to points of cards, (1, 1) a corner.  [K, P, 3]."""
    u, v = torch.tensor(points, dtype=torch.float64).unbind(-1)
    seen = standing(keys).points(u, v)
    return torch.nn.functional.normalize(seen, dim=-1).numpy()


def with_cards(radiance: NDArray[np.float32], keys: Lobes) -> NDArray[np.float32]:
    """Return a map with the light of cards added, a mean a texel.

    Args:
        radiance: [H, W, 3]
        keys: Of one frame.  [K, .]
    """
    height, width = radiance.shape[:2]
    found = np.zeros((height * width, 3))
    flux = asg.flux(keys.to("cpu", torch.float64)).numpy()
    step = 2 * (torch.arange(POINTS, dtype=torch.float64) + 0.5) / POINTS - 1
    y, x = (one.flatten() for one in torch.meshgrid(step, step, indexing="ij"))
    for index, light in enumerate(flux):
        if not light.any():
            continue
        seen = standing(keys.select(torch.tensor([index]))).points(x, y)[0]
        weight = (seen.norm(dim=-1) ** -3).numpy()
        u, v = (one.numpy() for one in latlong.uv_from_direction(seen))
        row = (v * height).astype(int).clip(0, height - 1)
        place = row * width + (u * width).astype(int) % width
        share = np.bincount(place, weight / weight.sum(), height * width)
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
    found = standing(keys)
    x, y, z = (found.axes @ direction.to(torch.float64)).unbind(-1)  # [K]
    foot = (found.axes @ found.middle[..., None])[..., 0]
    nearness = foot[:, 2] / z.clamp(min=1e-9)
    hit = (z > 0) & ((x * nearness - foot[:, 0]).abs() <= found.half[:, 0])
    hit &= (y * nearness - foot[:, 1]).abs() <= found.half[:, 1]
    light = asg.flux(keys.to("cpu", torch.float64)) / found.solid_angle()[:, None]
    return (light * hit[:, None]).sum(0).float()
