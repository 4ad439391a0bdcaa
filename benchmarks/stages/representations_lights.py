# SPDX-License-Identifier: Apache-2.0
"""What the lights of a stage send to its origin, as UsdLux says it, read from the file by pxr.

A light becomes K directions and the radiance times solid angle that arrives from each, float64.
Gauss and Legendre's rule over cards, in the angles of their plane, and over discs in the sky; domes
bilinear between their texels, as renderers show them.
"""

import functools
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from pxr import Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.images import read_latlong
from asglight.images.decoding.decode import read_header
from asglight.images.decoding.strips import read_pixels
from asglight.lobes import Form, Lobes, flat
from asglight.sphere import latlong

NODES_PER_RADIAN, NODES_MIN, NODES_MAX = 48, 10, 72
"""Along a side of a card, by its half angle, and across a disc. A reflection is 0.1
radians wide at roughness 0.25."""

FINE_ROWS = 128
"""At least, of the grid that a dome is interpolated on."""

LOBE_NODES = 40
"""At least, to either side of a lobe's middle together."""

LOBE_REACH = 5.0
"""Standard deviations of a lobe that are integrated: the rest is 6e-7 of it."""


class Arriving(NamedTuple):
    """Light at the origin.

    Attributes:
        directions: Unit, towards the light.  [K, 3]
        light: Radiance times solid angle, linear RGB.  [K, 3]
    """

    directions: Tensor
    light: Tensor


def of_stage(stage: Usd.Stage, frame: float, *, card_texture: bool = True) -> tuple[Arriving, int]:
    """Return the light of all lights that a stage shows, and their number.

    Args:
        stage: The stage.
        frame: Time code.
        card_texture: Whether the texture of cards is shown; programs leave it out.
    """
    rect = functools.partial(_rect, textured=card_texture)
    functions = {"RectLight": rect, "DistantLight": _distant, "DomeLight": _dome}
    lights = [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI)]
    return _joined([functions[str(one.GetTypeName())](one, frame) for one in lights]), len(lights)


def of_map(radiance: Tensor) -> Arriving:
    """Return the light of a latlong map, from the centres of its texels.

    Args:
        radiance: Linear RGB.  [H, W, 3]
    """
    height, width, _ = radiance.shape
    directions = latlong.directions(height, width, dtype=torch.float64)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)
    light = radiance.double() * solid_angle[..., None]
    return Arriving(directions.reshape(-1, 3), light.reshape(-1, 3))


def of_lobes(lobes: Lobes) -> Arriving:
    """Return the light of lobes, with x and the turn t about the x axis as variables: dw = dx dt.

    Args:
        lobes: N lobes.  [N, .]
    """
    lobes = lobes.to(torch.float64)
    return _joined([_lobe(lobes.select(torch.tensor([i]))) for i in range(lobes.count)])


def _lobe(lobe: Lobes) -> Arriving:
    sx, sy = lobe.sharpness[0].tolist()
    whole = lobe.form is Form.SG
    # The form sg falls as exp(-s (x^2 + y^2) / (1 + z)), at the most half as fast as the others.
    reach = [LOBE_REACH / math.sqrt(s if whole else 2 * s) for s in (sx, sy)]
    x_max = 1.0 if reach[0] >= 1 else reach[0]
    y_max = reach[1] / math.sqrt(max(1 - x_max**2, 1e-9))
    t_max = (math.pi if whole else math.pi / 2) if y_max >= 1 else math.asin(y_max)
    (x, wx), (t, wt) = (_rule(max(LOBE_NODES, _count(half))) for half in (math.asin(x_max), t_max))
    x, t = x_max * x[:, None], t_max * t
    ring = (1 - x * x).clamp(min=0).sqrt()
    y, z = ring * t.sin(), ring * t.cos()
    gaussian = torch.exp(-sx * x * x - sy * y * y)
    value = {
        Form.ASG: gaussian * z.clamp(min=0),
        Form.BINGHAM: gaussian,
        Form.SG: torch.exp(sx * (z - 1)),
        Form.FLAT: flat.values(gaussian) * z.clamp(min=0),
    }[lobe.form]
    weight = (value * x_max * wx[:, None] * t_max * wt).reshape(-1, 1)
    local = torch.stack([x.expand_as(y), y, z], dim=-1).reshape(-1, 3)
    arriving = Arriving(local @ lobe.axes[0], weight * lobe.amplitude)
    if lobe.form is not Form.BINGHAM:
        return arriving
    return _joined([arriving, Arriving(-arriving.directions, arriving.light)])


def _rect(prim: Usd.Prim, frame: float, *, textured: bool) -> Arriving:
    rect = UsdLux.RectLight(prim)
    asset = rect.GetTextureFileAttr().Get(frame) if textured else None
    half = [attr.Get(frame) / 2 for attr in (rect.GetWidthAttr(), rect.GetHeightAttr())]
    matrix = _world(prim, frame)
    distance = float(matrix[3, :3].norm())
    # Tangents of evenly weighted angles: the sides of a wide card are far away.
    columns = []
    for length in half:
        angle = math.atan(length / distance)
        # a texture has a slope that changes at every texel
        nodes, weights = _rule(NODES_MAX if asset else _count(angle))
        at = (angle * nodes).tan()
        columns.append((distance * at, distance * angle * weights * (1 + at * at)))
    (x, wx), (y, wy) = columns
    x, y = (part.reshape(-1) for part in torch.meshgrid(x, y, indexing="ij"))
    points = torch.stack([x, y, 0 * x, 1 + 0 * x], dim=-1) @ matrix
    length = points[:, :3].norm(dim=-1)
    towards = points[:, :3] / length[:, None]
    shines_along = torch.tensor([0.0, 0, -1, 0], dtype=torch.float64) @ matrix
    cosine = -(towards @ shines_along[:3]).clamp(max=0)  # dark from behind
    angle = (wx[:, None] * wy).reshape(-1) * cosine / length**2
    scale = 1.0
    if UsdLux.LightAPI(prim).GetNormalizeAttr().Get(frame):
        scale = 1 / (4 * half[0] * half[1])
    light = _emitted(prim, frame) * scale * angle[:, None]
    if asset:
        u, v = 0.5 + x / (2 * half[0]), 0.5 - y / (2 * half[1])
        image = torch.from_numpy(read_pixels(read_header(Path(asset.resolvedPath)))).double()
        light = light * _sampled(image, u, v, wrap=False)
    return Arriving(towards, light)


def _distant(prim: Usd.Prim, frame: float) -> Arriving:
    radius = math.radians(UsdLux.DistantLight(prim).GetAngleAttr().Get(frame)) / 2
    assert 0 < radius <= math.pi / 2
    count = _count(radius)
    nodes, weights = _rule(count)
    depth = 2 * math.sin(radius / 2) ** 2  # 1 - cos of the rim
    below = depth * (nodes + 1) / 2
    turn = 2 * math.pi * torch.arange(2 * count, dtype=torch.float64) / (2 * count)
    ring = (below * (2 - below)).sqrt()[:, None]
    local = torch.stack(
        [ring * turn.cos(), ring * turn.sin(), (1 - below)[:, None].expand(-1, len(turn))], dim=-1
    ).reshape(-1, 3)
    angle = (depth / 2 * weights[:, None] * math.pi / count).expand(-1, len(turn)).reshape(-1, 1)
    scale = 1.0
    if UsdLux.LightAPI(prim).GetNormalizeAttr().Get(frame):
        scale = 1 / (math.pi * math.sin(radius) ** 2)
    rotation = _world(prim, frame)[:3, :3]
    return Arriving(local @ rotation, _emitted(prim, frame) * scale * angle)


def _dome(prim: Usd.Prim, frame: float) -> Arriving:
    image = _image(UsdLux.DomeLight(prim).GetTextureFileAttr().Get(frame))
    rows = max(FINE_ROWS, image.shape[0])
    v, u = torch.meshgrid(
        (torch.arange(rows, dtype=torch.float64) + 0.5) / rows,
        (torch.arange(2 * rows, dtype=torch.float64) + 0.5) / (2 * rows),
        indexing="ij",
    )
    seen = _sampled(image, u.reshape(-1), v.reshape(-1), wrap=True)
    arriving = of_map(seen.reshape(rows, 2 * rows, 3))
    rotation = _world(prim, frame)[:3, :3]
    return Arriving(arriving.directions @ rotation, arriving.light * _emitted(prim, frame))


def _sampled(image: Tensor, u: Tensor, v: Tensor, *, wrap: bool) -> Tensor:
    """Interpolate an image; beyond its edges it goes on (`wrap`, in u) or stays.  [K, 3]."""
    height, width, _ = image.shape
    x = u * width - 0.5
    y = (v * height - 0.5).clamp(0, height - 1)
    left, top = x.floor(), y.floor().clamp(max=max(height - 2, 0))
    fx, fy = (x - left)[:, None], (y - top)[:, None]

    def column(offset: int) -> Tensor:
        at = left.long() + offset
        return at % width if wrap else at.clamp(0, width - 1)

    def row(offset: int) -> Tensor:
        return (top.long() + offset).clamp(max=height - 1)

    above = image[row(0), column(0)] * (1 - fx) + image[row(0), column(1)] * fx
    below = image[row(1), column(0)] * (1 - fx) + image[row(1), column(1)] * fx
    return above * (1 - fy) + below * fy


def _image(asset: Any) -> Tensor:
    return read_latlong(asset.resolvedPath).radiance.double()


def _emitted(prim: Usd.Prim, frame: float) -> Tensor:
    """Return what intensity, exposure and colour say.  [3]."""
    api = UsdLux.LightAPI(prim)
    color = torch.tensor(list(api.GetColorAttr().Get(frame)), dtype=torch.float64)
    return api.GetIntensityAttr().Get(frame) * 2.0 ** api.GetExposureAttr().Get(frame) * color


def _world(prim: Usd.Prim, frame: float) -> Tensor:
    """Return the matrix that multiplies row vectors (x, y, z, 1)."""
    matrix = UsdGeom.XformCache(frame).GetLocalToWorldTransform(prim)
    return torch.tensor([list(matrix.GetRow(i)) for i in range(4)], dtype=torch.float64)


def _joined(parts: list[Arriving]) -> Arriving:
    return Arriving(torch.cat([p.directions for p in parts]), torch.cat([p.light for p in parts]))


def _count(half_angle: float) -> int:
    return min(NODES_MAX, NODES_MIN + math.ceil(NODES_PER_RADIAN * half_angle))


def _rule(count: int) -> tuple[Tensor, Tensor]:
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return torch.from_numpy(nodes), torch.from_numpy(weights)
