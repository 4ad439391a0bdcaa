# SPDX-License-Identifier: Apache-2.0
"""Lobes on adaptive cells, and what adaptive cells see of them by other means than the fit."""

import math
from dataclasses import replace

import torch
from lobe_cases import DOUBLE

from asglight.fitting.loss import coordinates
from asglight.fitting.loss.adaptive_cells import AdaptiveCells, adaptive_cells
from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.loss.lobe_images import COLUMNS
from asglight.lobes import Form, Lobes
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong

PLACES = [(0.3, 0.2, 1.0), (-1.0, 0.6, 0.1), (0.02, -0.5, -1.0)]
"""Away from the poles; the last on the seam."""

POLES = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1e-3, 1.0, -2e-3)]

SUN = (90, 201)
"""Row and column of the texel that the refined maps of 256 rows have detail around."""


def lobes_at(form: Form, places: list[tuple[float, float, float]], sharpness: list[float]) -> Lobes:
    """Return one frame of lobes that share their sharpness, in float64.  [N, .]."""
    axis_z = torch.nn.functional.normalize(torch.tensor(places, dtype=DOUBLE), dim=-1)
    both = torch.tensor(sharpness[:1] * 2 if form is Form.SG else sharpness, dtype=DOUBLE)
    light = 0.5 + torch.arange(3.0 * len(places), dtype=DOUBLE).reshape(-1, 3)
    return Lobes(axes_around(axis_z), both.expand(len(places), 2), light, form)


def single(lobes: Lobes) -> Lobes:
    """Return one frame as the fit takes it: float32, F = 1."""
    return lobes.to(torch.float32)[None]


def plain_cells(rows: int, frames: int = 1) -> AdaptiveCells:
    """Return adaptive cells that are the cells of a grid."""
    return adaptive_cells(torch.zeros(frames, 3, 2 * rows * rows), rows)


def refined_cells() -> AdaptiveCells:
    """Return adaptive cells of 64 rows, the cell around SUN refined into texels of 256 rows."""
    reference = torch.zeros(1, 3, 2 * 256 * 256)
    reference[..., SUN[0] * 512 + SUN[1]] = 1.0
    return adaptive_cells(reference, 64, 1)


def at_texel(row: float, column: float, rows: int) -> tuple[float, float, float]:
    """Return the direction so many texels from the grid's corner."""
    v, u = torch.tensor(row / rows, dtype=DOUBLE), torch.tensor(column / (2 * rows), dtype=DOUBLE)
    x, y, z = latlong.direction_from_uv(u, v).tolist()
    return x, y, z


CENTRES = [
    at_texel(SUN[0] + 0.5, SUN[1] + 0.5, 256),  # a texel's centre, in the refined cell
    at_texel(SUN[0] + 0.5, SUN[1], 256),  # between two of its texels
    at_texel(20.5, 30.5, 64),  # a cell's centre
    at_texel(20.5, 30, 64),  # between two cells
    at_texel(50.3, 90.8, 64),
    at_texel(0.0, 0.0, 64),  # a pole
]


def texel_moment(lobes: Lobes, rows: int) -> torch.Tensor:
    """Return a texel's second moment about the centre of each lobe, in its frame.  [N, 2, 2].

    A twelfth of its height squared northwards, cos(latitude)^2 of that eastwards, which goes to a
    square's within half a texel of a pole; for the sg form the mean of both.
    """
    height = math.pi / rows
    x, y, z = lobes.axis_z.unbind(-1)
    cosine = (x * x + z * z).sqrt()
    east = torch.stack([z, torch.zeros_like(y), -x], dim=-1) / cosine[:, None]
    ways = torch.stack([torch.linalg.cross(lobes.axis_z, east), east], dim=1)
    parts = lobes.axes[:, :2] @ ways.mT  # columns are north and east
    width2 = 1 - (y * (cosine / (height / 2)).clamp(max=1)).square()
    moment = (
        height**2 / 12 * parts @ torch.diag_embed(torch.stack([y * 0 + 1, width2], -1)) @ parts.mT
    )
    if lobes.form is Form.SG:
        trace = torch.diagonal(moment, dim1=-2, dim2=-1).sum(-1)
        return trace[:, None, None] / 2 * torch.eye(2, dtype=DOUBLE)
    return moment


def seen_by_texels(
    lobes: Lobes, before: Lobes, rows: int, directions: torch.Tensor
) -> torch.Tensor:
    """Return lobes as texels see them that have the moments of lobes of before.  [N, P].

    A Gaussian of covariance (2 S)^-1 + T whose integral in the plane is the lobe's own.
    """
    if lobes.form is Form.FLAT:  # z (3 E - 3 E^2 + E^3)
        terms = [
            replace(lobes, sharpness=k * lobes.sharpness, form=Form.ASG) for k in (1.0, 2.0, 3.0)
        ]
        held = replace(before, form=Form.ASG)
        one, two, three = (seen_by_texels(term, held, rows, directions) for term in terms)
        return 3 * one - 3 * two + three
    moment = texel_moment(before, rows)
    turn = before.axes[:, :2] @ lobes.axes[:, :2].mT  # of the new x and y, in the frame before
    across = turn @ lobes.axes[:, :2] @ directions.mT  # [N, 2, P]
    z = lobes.axis_z @ directions.mT
    if lobes.form is Form.SG:
        wider = 1 + lobes.sharpness[:, :1] * moment[:, 0, :1]
        return torch.exp(lobes.sharpness[:, :1] / wider * (z - 1)) / wider
    covariance = turn @ torch.diag_embed(0.5 / lobes.sharpness) @ turn.mT
    seen = torch.linalg.inv(covariance + moment)
    peak = (torch.linalg.det(covariance) * torch.linalg.det(seen)).sqrt()
    power = -0.5 * (across * (seen @ across)).sum(1)
    gaussian = peak[:, None] * torch.exp(power)
    return gaussian * z.clamp(min=0) if lobes.form is Form.ASG else gaussian


def differences(lobes: Lobes, rows: int, directions: torch.Tensor) -> torch.Tensor:
    """Return each lobe and its change along each coordinate, T held.  [N, 6, P]."""
    narrowest = float((2 * lobes.sharpness.max()).rsqrt())
    found = [seen_by_texels(lobes, lobes, rows, directions)]
    for unknown in range(COLUMNS - 1):
        step = 1e-4 * (narrowest if unknown < 2 else 1)
        move = torch.zeros(lobes.count, UNKNOWNS, dtype=DOUBLE)
        move[:, unknown] = step
        ways = [coordinates.advance(lobes, way) for way in (move, -move)]
        ahead, behind = (
            # the amplitude comes with a lobe's shape
            moved.amplitude[:, :1]
            / lobes.amplitude[:, :1]
            * seen_by_texels(moved, lobes, rows, directions)
            for moved in ways
        )
        found.append((ahead - behind) / (2 * step))
    return torch.stack(found, dim=1)
