# SPDX-License-Identifier: Apache-2.0
"""What a stage's lights send to the origin, as UsdLux defines them.

Written from the schema alone, without asglight's writer, so that it can tell an error of the
writer's formulas from one of a renderer. Rect, distant and dome lights; domes are interpolated as
Cycles does, which UsdLux leaves open (`images.py`). In a Z-up stage directions are turned back to
asglight's +Y up. From usdLux/schema.usda of usd-core 26.11.
"""

import math
from pathlib import Path

import torch
from pxr import Usd, UsdGeom, UsdLux
from torch import Tensor

from asglight.images import read_latlong
from asglight.sphere import latlong
from dcc import images
from dcc.images import FINE, fine_grid, texel_means
from dcc.lobe_light import gauss
from dcc.quadrature import ROWS, Light, broad

_NARROW = math.radians(12)
"""Lights narrower than that, sixteen texels, get nodes of their own."""

_NODE = math.radians(0.5)
"""Distance of those nodes along a long card."""

_TURNS = 48
"""Nodes around a small disc."""

_AROUND = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def light_of(path: Path, time: float = 0.0, *, blender_distant: bool = False) -> Light:
    """Return what a stage's lights send.

    Args:
        path: The stage.
        time: Time code.
        blender_distant: Take a distant light for twice as wide, as Blender's importer does, and
            normalise it as Cycles does.
    """
    stage = Usd.Stage.Open(str(path))
    found: list[Light] = []
    for prim in stage.Traverse():
        if prim.IsA(UsdLux.RectLight):
            found.append(_rect(UsdLux.RectLight(prim), time))
        elif prim.IsA(UsdLux.DistantLight):
            found.append(_distant(UsdLux.DistantLight(prim), time, blender_distant))
        elif prim.IsA(UsdLux.DomeLight):
            found.append(_dome(UsdLux.DomeLight(prim), time))
        elif prim.HasAPI(UsdLux.LightAPI):
            raise ValueError(f"{prim.GetPath()}: a {prim.GetTypeName()}, which is not known here")
    return Light(
        torch.stack([light.radiance for light in found]).sum(0),
        torch.cat([light.directions for light in found]),
        torch.cat([light.flux for light in found]),
    )


def _rect(light: UsdLux.RectLight, time: float) -> Light:
    """Return a rectangle; it is seen from the side that its -Z looks to."""
    if light.GetNormalizeAttr().Get(time):
        raise ValueError(f"{light.GetPath()}: a normalized card; expected plain radiance")
    axes, place = _frame(light, time)
    local = place @ axes.mT  # of the centre, in the light's own axes
    if local[2] <= 0:
        return broad(_nothing())
    half = torch.tensor([light.GetWidthAttr().Get(time), light.GetHeightAttr().Get(time)]) / 2
    half = half.double() * _unit(light)
    # angles from which to which it reaches, along either axis
    ends = torch.atan((local[:2, None] + half[:, None] * torch.tensor([-1.0, 1.0])) / local[2])
    if float((ends[:, 1] - ends[:, 0]).min()) < _NARROW:
        directions, solid_angle = _rect_nodes(ends)
        return _narrow(directions @ axes, solid_angle[:, None] * _emission(light, time))
    x, y, z = _fine_directions(axes)
    reach = local[2] / z.clamp(min=1e-9)  # rays that run along the card or away miss it
    inside = (z > 1e-9) & ((x * reach - local[0]).abs() <= half[0])
    inside &= (y * reach - local[1]).abs() <= half[1]
    corners = [local + torch.tensor([i * half[0], j * half[1], 0.0]) for i, j in _AROUND]
    return broad(_spread(inside, _solid_angle(corners)) * _emission(light, time))


def _rect_nodes(ends: Tensor) -> tuple[Tensor, Tensor]:
    """Place nodes on a rectangle by angle: x = tan a, y = tan b in the plane z = 1.

    Args:
        ends: From which to which angle, along x and y.  [2, 2]

    Returns:
        Directions in the light's axes [T, 3]; solid angles, dx dy / (1 + x^2 + y^2)^(3/2) [T].
    """
    (a, weight_a), (b, weight_b) = (gauss(low, high, _NODE) for low, high in ends.tolist())
    x, y = torch.meshgrid(a.tan(), b.tan(), indexing="ij")
    area = weight_a[:, None] * (1 + x * x) * weight_b * (1 + y * y)
    local = torch.stack([x, y, torch.ones_like(x)], dim=-1).view(-1, 3)
    length = local.norm(dim=-1)
    return local / length[:, None], area.view(-1) / length**3


def _distant(light: UsdLux.DistantLight, time: float, as_blender: bool) -> Light:
    """Return a disc of even radiance around +Z with the irradiance that `intensity` says.

    Blender's disc is twice as wide. One of more than a hemisphere still gets the radiance
    `intensity / (pi sin^2 radius)`, so it gives more irradiance than that.
    """
    axes, _ = _frame(light, time)
    radius = math.radians(light.GetAngleAttr().Get(time)) / 2
    seen = 2 * radius if as_blender else radius
    scale = 1 / (math.pi * math.sin(seen) ** 2)
    if not light.GetNormalizeAttr().Get(time):
        scale *= math.pi * math.sin(radius) ** 2
    radiance = _emission(light, time) * scale
    if 2 * seen < _NARROW:
        z, weight = gauss(math.cos(seen), 1.0, math.inf)
        turn = 2 * math.pi * torch.arange(_TURNS, dtype=torch.float64) / _TURNS
        level = (1 - z * z).sqrt()[:, None]
        local = [level * turn.cos(), level * turn.sin(), z[:, None].expand(-1, _TURNS)]
        solid_angle = (weight * 2 * math.pi / _TURNS).repeat_interleave(_TURNS)
        directions = torch.stack(local, dim=-1).view(-1, 3) @ axes
        return _narrow(directions, solid_angle[:, None] * radiance)
    _, _, z = _fine_directions(axes)
    return broad(_spread(z >= math.cos(seen), 2 * math.pi * (1 - math.cos(seen))) * radiance)


def _dome(light: UsdLux.DomeLight, time: float) -> Light:
    """Return the dome's image, turned as its light is."""
    axes, _ = _frame(light, time)
    image = read_latlong(light.GetTextureFileAttr().Get(time).resolvedPath).radiance
    fine = images.read(image, _fine_directions(axes))
    return images.light_of(fine * _emission(light, time).float())


def _emission(light: UsdLux.BoundableLightBase, time: float) -> Tensor:
    """Return intensity times 2^exposure times colour.  [3]."""
    scale = light.GetIntensityAttr().Get(time) * 2.0 ** light.GetExposureAttr().Get(time)
    return scale * torch.tensor(tuple(light.GetColorAttr().Get(time)), dtype=torch.float64)


def _unit(light: UsdGeom.Xformable) -> float:
    return UsdGeom.GetStageMetersPerUnit(light.GetPrim().GetStage())


def _frame(light: UsdGeom.Xformable, time: float) -> tuple[Tensor, Tensor]:
    """Return a light's axes as rows [3, 3] and its place in metres [3], +Y up."""
    matrix = torch.tensor(light.ComputeLocalToWorldTransform(time), dtype=torch.float64)
    rows = matrix[:, :3]  # USD's vectors are rows: images of x, y, z, and of the origin
    if UsdGeom.GetStageUpAxis(light.GetPrim().GetStage()) == "Z":
        rows = torch.stack([rows[:, 0], rows[:, 2], -rows[:, 1]], dim=-1)
    return torch.nn.functional.normalize(rows[:3], dim=-1), rows[3] * _unit(light)


def _fine_directions(axes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return directions of the fine grid in a light's axes.  [4H, 4W] each.

    Edges of lights are right to a quarter of a texel; fluxes are made exact.
    """
    x, y, z = axes.float() @ fine_grid()
    shape = (FINE * ROWS, 2 * FINE * ROWS)
    return x.view(shape), y.view(shape), z.view(shape)


def _narrow(directions: Tensor, flux: Tensor) -> Light:
    return Light(_nothing(), directions, flux)


def _nothing() -> Tensor:
    return torch.zeros(ROWS, 2 * ROWS, 3, dtype=torch.float64)


def _spread(inside: Tensor, solid_angle: float) -> Tensor:
    """Return the covered share of texels, scaled to the exact solid angle.  [H, W, 1]."""
    share = texel_means(inside.float()[..., None])
    weights = latlong.texel_solid_angles(ROWS, 2 * ROWS, dtype=torch.float64)[..., None]
    return share * solid_angle / (share * weights).sum()


def _solid_angle(corners: list[Tensor]) -> float:
    """Return the solid angle of a quadrilateral as two triangles (van Oosterom, Strackee 1983)."""
    a, b, c, d = (corner / corner.norm() for corner in corners)
    total = 0.0
    for p, q, r in ((a, b, c), (a, c, d)):
        volume = torch.dot(p, torch.linalg.cross(q, r)).abs()
        total += 2 * float(torch.atan2(volume, 1 + p @ q + q @ r + r @ p))
    return total
