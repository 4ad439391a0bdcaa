# SPDX-License-Identifier: Apache-2.0
"""Images of lobes on a grid: their values, their derivatives, and the slope of a loss along them.

A lobe moves in five local coordinates (coordinates.py). Its image and its five derivatives are the
six columns that the Gauss-Newton matrix is made of; that matrix needs them on coarse cells only.
The slope of a loss along a coordinate is the sum over texels of a derivative times the loss's
slope; it is taken over all texels, yet no derivative is evaluated for it: each derivative is the
lobe times a polynomial in direction, so the moments of lobe times slope hold all of them.

Lobes narrower than a few texels are averaged over each texel that they reach (lobes/texels.py).
"""

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting.coordinates import BROAD, is_round
from asglight.fitting.grid import POWERS, Grid, cell_of
from asglight.lobes import Form, Lobes, asg, texels

NARROW_TEXELS = 2.0
"""Lobes at least this wide are sampled at the texel centres: within 1 % an axis at the peak of the
narrowest, while sums over the texels are exact to exp(-2 pi^2 2^2)."""

NARROW_CELLS = 1.5
"""The same for the columns of the Gauss-Newton matrix, which are only ever summed."""

EXPONENT_MIN = -80.0
"""Of exp: 1.8e-35, beyond sight; the processor takes four times as long for denormal results."""

COLUMNS = 6
"""The lobe, two tilts, two widths, one turn."""


@dataclass(frozen=True)
class Images:
    """Lobes of amplitude 1 on a grid.

    Attributes:
        lobes: The lobes.  [N, .]
        values: Texel means of each lobe.  [N, P]
        gaussian: exp(-sx x^2 - sy y^2) on the lobe's side, for the tilts of the asg form; the
            values themselves for other forms. Undefined for narrow lobes.  [N, P]
    """

    lobes: Lobes
    values: Tensor
    gaussian: Tensor

    @property
    def radiance(self) -> Tensor:
        """What all lobes send together.  [3, P]."""
        return self.lobes.amplitude.mT @ self.values


def images(lobes: Lobes, grid: Grid) -> Images:
    """Evaluate lobes on a grid.  [N, .]."""
    narrow = texels.is_narrow(lobes, grid.height, NARROW_TEXELS)
    values, gaussian = _at_centres(lobes, grid)
    if bool(narrow.any()):
        if gaussian is values:
            gaussian = values.clone()
        values[narrow] = 0
        shape = (grid.height, 2 * grid.height)
        for group in texels.reached_pairs(lobes, narrow, shape):
            values[group.lobe, group.texel] = texels.means(asg.local_values, lobes, group, shape)
    return Images(lobes, values, gaussian)


def _at_centres(lobes: Lobes, grid: Grid) -> tuple[Tensor, Tensor]:
    """Return values and gaussians at the texel centres, by monomials of direction."""
    _, first, second, _ = grid.columns
    if lobes.form is Form.SG:
        sharpness = lobes.sharpness[:, :1]
        exponent = (sharpness * lobes.axis_z) @ first
        values = exponent.sub_(sharpness).clamp_(min=EXPONENT_MIN).exp_()
        return values, values
    gaussian = torch.mm(_quadratic(lobes), second).clamp_(min=EXPONENT_MIN).exp_()
    if lobes.form is Form.BINGHAM:
        return gaussian, gaussian
    z = lobes.axis_z @ first
    gaussian.mul_(z > 0)
    return z.mul_(gaussian), gaussian


def _quadratic(lobes: Lobes) -> Tensor:
    """Return -sx x^2 - sy y^2 as coefficients of the monomials of degree 2.  [N, 6]."""
    x, y = lobes.axis_x, lobes.axis_y
    sx, sy = lobes.sharpness[:, :1, None], lobes.sharpness[:, 1:, None]
    matrix = -sx * x[:, :, None] * x[:, None, :] - sy * y[:, :, None] * y[:, None, :]
    # order of POWERS: xx, xy, xz, yy, yz, zz
    rows, columns = torch.triu_indices(3, 3, device=matrix.device)
    twice = torch.where(rows == columns, 1.0, 2.0)
    return matrix[:, rows, columns] * twice


@dataclass(frozen=True)
class Near:
    """Columns of the lobes that are narrow for the cells, on the texels that they reach.

    Attributes:
        lobe: Indices of the n lobes.  [n]
        texel: Indices of the U texels that any of them reaches.  [U]
        columns: Each lobe and its derivatives as texel means.  [n, 6, U]
    """

    lobe: Tensor
    texel: Tensor
    columns: Tensor


def near_columns(lobes: Lobes, grid: Grid, cell_rows: int) -> Near:
    """Evaluate the columns of the lobes that are narrow for cells of so many rows."""
    narrow = texels.is_narrow(lobes, cell_rows, NARROW_CELLS)
    narrow |= texels.is_narrow(lobes, grid.height, NARROW_TEXELS)
    shape = (grid.height, 2 * grid.height)
    groups = texels.reached_pairs(lobes, narrow, shape)
    reached = torch.zeros(len(grid.directions), dtype=torch.bool, device=lobes.axes.device)
    for group in groups:
        reached[group.texel] = True
    place, rank = reached.cumsum(0) - 1, narrow.cumsum(0) - 1
    texel, lobe = torch.nonzero(reached).flatten(), torch.nonzero(narrow).flatten()
    columns = lobes.axes.new_zeros(len(lobe), COLUMNS, len(texel))
    for group in groups:
        means = texels.means(local_columns, lobes, group, shape)  # [T, 6]
        columns[rank[group.lobe], :, place[group.texel]] = means
    return Near(lobe, texel, columns)


def cell_columns(lobes: Lobes, near: Near, grid: Grid, cells: Grid) -> Tensor:
    """Return each lobe and its derivatives as means over cells.

    Args:
        lobes: N lobes.  [N, .]
        near: Those that are narrow for the cells.
        grid: The grid of `near`.
        cells: The grid of the cells.

    Returns:
        Row 6 i is lobe i, rows 6 i + 1 to 6 i + 5 its derivatives.  [6 N, P]
    """
    columns = local_columns(lobes, lobes.axes @ cells.directions.mT)
    if len(near.lobe):
        cell = cell_of(near.texel, grid.height, cells.height)
        share = grid.share[near.texel] / cells.share[cell]
        narrow = near.columns.new_zeros(len(near.lobe), COLUMNS, len(cells.directions))
        columns[near.lobe] = narrow.index_add_(2, cell, near.columns * share)
    return columns.flatten(0, 1)


def local_columns(lobes: Lobes, local: Tensor) -> Tensor:
    """Return each lobe and its five derivatives at directions in its frame.

    Args:
        lobes: N lobes.  [N, .]
        local: x, y, z of each direction.  [N, 3, P]

    Returns:
        The lobe, tilts, widths, turn.  [N, 6, P]
    """
    x, y, z = local.unbind(1)
    sx, sy = lobes.sharpness[..., None].unbind(1)  # [N, 1]
    value = asg.local_values(lobes, local)
    if lobes.form is Form.SG:
        none = torch.zeros_like(value)
        width = (sx + BROAD) * (z - 1) * value
        return torch.stack([value, sx * x * value, sx * y * value, width, none, none], dim=1)
    if lobes.form is Form.ASG:
        gaussian = torch.exp(-sx * x * x - sy * y * y) * (z > 0)
        tilt_x = gaussian * x * (1 + 2 * sx * z * z)
        tilt_y = gaussian * y * (1 + 2 * sy * z * z)
    else:
        tilt_x = value * x * (2 * sx * z)
        tilt_y = value * y * (2 * sy * z)
    widths = [-(sx + BROAD) * x * x * value, -(sy + BROAD) * y * y * value]
    turn = -2 * turn_speed(lobes)[:, None] * x * y * value
    return torch.stack([value, tilt_x, tilt_y, *widths, turn], dim=1)


def turn_speed(lobes: Lobes) -> Tensor:
    """Return sx - sy of a lobe that turns, and what stands for it in one that shears.  [N]."""
    shifted = lobes.sharpness + BROAD
    difference = lobes.sharpness[:, 0] - lobes.sharpness[:, 1]
    return torch.where(is_round(lobes), shifted.prod(-1).sqrt(), difference)


def slopes(shown: Images, near: Near, slope: Tensor, grid: Grid) -> Tensor:
    """Contract the derivatives of each lobe with the slope of a loss.

    Args:
        shown: The lobes on the grid.
        near: The columns of the narrow ones.
        slope: dJ / d radiance.  [3, P]
        grid: The grid.

    Returns:
        dJ along the five coordinates and the three amplitudes of each lobe.  [N, 8]
    """
    lobes = shown.lobes
    light = shown.values @ slope.mT  # [N, 3]
    shape = _shape_slopes(shown, lobes.amplitude @ slope, grid)
    if len(near.lobe):
        averaged = texels.is_narrow(lobes, grid.height, NARROW_TEXELS)[near.lobe]
        pulled = near.columns @ slope[:, near.texel].mT  # [n, 6, 3]
        pulled = (pulled[:, 1:] * lobes.amplitude[near.lobe][:, None]).sum(-1)
        # where the values are samples, so must the slopes be
        shape[near.lobe] = torch.where(averaged[:, None], pulled, shape[near.lobe])
    return torch.cat([shape, light], dim=-1)


def _shape_slopes(shown: Images, along: Tensor, grid: Grid) -> Tensor:
    """Return dJ along the five coordinates, from moments of lobe times slope.  [N, 5].

    Args:
        shown: The lobes on the grid.
        along: dJ / d value of each lobe in each texel.  [N, P]
        grid: The grid.
    """
    lobes = shown.lobes
    sx, sy = lobes.sharpness.unbind(-1)
    ones = shown.gaussian * along
    _, first, second, third = grid.columns
    x, y, z = lobes.axes.unbind(1)
    if lobes.form is Form.SG:
        vector, total = ones @ first.mT, ones.sum(-1)
        tilts = [sx * (vector * x).sum(-1), sx * (vector * y).sum(-1)]
        width = (sx + BROAD) * ((vector * z).sum(-1) - total)
        return torch.stack([*tilts, width, torch.zeros_like(sx), torch.zeros_like(sx)], dim=-1)
    speed = turn_speed(lobes)
    if lobes.form is Form.BINGHAM:
        moments = _in_frame(_symmetric(ones @ second.mT, 2), lobes)
        tilts = [2 * sx * moments[:, 0, 2], 2 * sy * moments[:, 1, 2]]
        xx, yy, xy = moments[:, 0, 0], moments[:, 1, 1], moments[:, 0, 1]
    else:
        moments = _in_frame(_symmetric(ones @ third.mT, 3), lobes)
        mean = torch.einsum("nijj->ni", moments)  # |d| = 1
        tilts = [
            mean[:, 0] + 2 * sx * moments[:, 0, 2, 2],
            mean[:, 1] + 2 * sy * moments[:, 1, 2, 2],
        ]
        xx, yy, xy = moments[:, 0, 0, 2], moments[:, 1, 1, 2], moments[:, 0, 1, 2]
    return torch.stack([*tilts, -(sx + BROAD) * xx, -(sy + BROAD) * yy, -2 * speed * xy], dim=-1)


def _places(degree: int) -> Tensor:
    """Return the monomial that holds each entry of a symmetric tensor.  [3, ..., 3]."""
    monomials = [powers for powers in POWERS if sum(powers) == degree]
    entries = itertools.product(range(3), repeat=degree)
    found = [monomials.index((e.count(0), e.count(1), e.count(2))) for e in entries]
    return torch.tensor(found).reshape([3] * degree)


_PLACES = {degree: _places(degree) for degree in (2, 3)}


def _symmetric(moments: Tensor, degree: int) -> Tensor:
    """Return moments of the monomials of one degree as a symmetric tensor.  [N, 3, ..., 3]."""
    return moments[:, _PLACES[degree].to(moments.device)]


def _in_frame(moments: Tensor, lobes: Lobes) -> Tensor:
    """Express a tensor of world directions in each lobe's frame."""
    if moments.ndim == 3:
        return torch.einsum("nia,njb,nab->nij", lobes.axes, lobes.axes, moments)
    return torch.einsum("nia,njb,nkc,nabc->nijk", lobes.axes, lobes.axes, lobes.axes, moments)
