# SPDX-License-Identifier: Apache-2.0
"""Images of lobes on adaptive cells: values, slopes of a loss, columns of the Gauss-Newton matrix.

What an adaptive cell sees of a lobe is the lobe's mean over it (footprints.py).

Sums over adaptive cells are exact to 2 exp(-2 pi^2 sigma'^2) an axis, sigma' in adaptive cells: 39
% for a lobe far narrower than its adaptive cell, sigma'^2 = 1/12. Narrow lobes are therefore scaled
to their exact integral, and the scale's own change is part of every derivative: without it a narrow
lobe that only moves would seem to change its flux from adaptive cell to adaptive cell, which
outweighs what its motion does.

The exponent and each derivative over the value are polynomials in direction of degree 1 and 2, so
an image is one product with the monomials of direction, and the slopes of a loss along all
coordinates come from the moments of lobe times slope.

A flat lobe is drawn as its three asg terms; what they give goes back to its own coordinates
(flat_terms.py).
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Self

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.loss import flat_terms
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.coordinates import BROAD
from asglight.fitting.loss.footprints import Footprint, as_seen, exponents
from asglight.fitting.loss.grid import Grid
from asglight.lobes import Form, Lobes, flat
from asglight.lobes import data as lobe_data

EXPONENT_MIN = -30.0
"""Of exp: 1e-13 of the peak, beyond sight; its square times an adaptive cell's share is no denormal
number, for which a processor takes many times as long."""

COLUMNS = 6
"""The lobe, two tilts, two widths, one turn."""

NARROW_SHARPNESS, LONG_SHARPNESS = 50.0, 8.0
"""Of the sharper and of the other axis, from which the integral is taken as that of a plane
Gaussian, below a percent off for each form; others are sampled well by any grid of 16 rows."""

SCALE_MIN, SCALE_MAX = 0.5, 3.0
"""Of a narrow lobe's correction: a cell's centre asks for 0.52, the corner of four for 2.63; only
near a pole, where rows of cells are unlike, more is lacking."""


@dataclass(frozen=True)
class Images:
    """Lobes of amplitude 1 on adaptive cells.

    Attributes:
        lobes: The lobes.  [F, N, .]
        values: Means over each adaptive cell, but for `scale`.  [F, N, P]
        gaussian: The values over z where z > 0 for the asg form; else the values.  [F, N, P]
        scale: What makes the integrals of narrow lobes exact; 1 for flat lobes, whose `values` have
            it.  [F, N]
        terms: Of flat lobes, the images of their terms.  3 N lobes
    """

    lobes: Lobes
    values: Tensor
    gaussian: Tensor
    scale: Tensor
    terms: "Images | None" = None

    def __getitem__(self, index: Any) -> Self:
        """Index the frames, as one would index each tensor."""
        parts = {name: value[index] for name, value in vars(self).items() if value is not None}
        return replace(self, **parts)

    @property
    def light(self) -> Tensor:
        """Amplitudes of `values`.  [F, N, 3]."""
        return self.lobes.amplitude * self.scale[..., None]

    @property
    def radiance(self) -> Tensor:
        """What all lobes send together.  [F, 3, P]."""
        return self.light.mT @ self.values


def chosen(first: Tensor, one: Images, other: Images) -> Images:
    """Return the one's images in some frames and the other's elsewhere.

    Args:
        first: Which frames are the one's.  [F]
        one: Images of every frame.
        other: As many.
    """

    def of(these: Tensor, those: Tensor) -> Tensor:
        return torch.where(first.reshape(-1, *[1] * (these.ndim - 1)), these, those)

    values = of(one.values, other.values)
    terms = None
    if one.terms is not None and other.terms is not None:
        terms = chosen(first, one.terms, other.terms)
    return Images(
        lobe_data.chosen(first, one.lobes, other.lobes),
        values,
        values if one.gaussian is one.values else of(one.gaussian, other.gaussian),
        of(one.scale, other.scale),
        terms,
    )


def joined(one: Images, other: Images) -> Images:
    """Return the frames of two, the other's last."""
    terms = None
    if one.terms is not None and other.terms is not None:
        terms = joined(one.terms, other.terms)
    values = torch.cat([one.values, other.values])
    same = one.gaussian is one.values
    gaussian = values if same else torch.cat([one.gaussian, other.gaussian])
    lobes = lobe_data.joined(one.lobes, other.lobes)
    return Images(lobes, values, gaussian, torch.cat([one.scale, other.scale]), terms)


def empty_like(shown: Images) -> Images:
    """Return room for as many images of as many lobes, without terms."""
    lobes = shown.lobes
    axes, sharpness, amplitude, values, gaussian, scale = (
        torch.empty_like(each, memory_format=torch.contiguous_format)
        for each in (
            *(lobes.axes, lobes.sharpness, lobes.amplitude),
            *(shown.values, shown.gaussian, shown.scale),
        )
    )
    return Images(Lobes(axes, sharpness, amplitude, lobes.form), values, gaussian, scale)


def images(lobes: Lobes, places: AdaptiveCells) -> Images:
    """Evaluate lobes on adaptive cells.  [F, N, .]."""
    if compiled.serves(lobes, places):
        return Images(lobes, *compiled.images(lobes, places.compiled, places.share.shape[-1]))
    if lobes.form is Form.FLAT:
        terms = images(flat.terms(lobes), places)
        # terms averaged over an adaptive cell each by itself may miss 0 by a little
        values = flat.summed(terms.values * terms.scale[..., None], 1).clamp(min=0)
        return Images(lobes, values, values, torch.ones_like(terms.scale[:, : lobes.count]), terms)
    levels = places.levels
    found = exponents(lobes, as_seen(lobes, [rows for rows, _, _ in levels]))
    parts = [
        _values(lobes, exponent, monomials)
        for exponent, (_, monomials, _) in zip(found, levels, strict=True)
    ]
    values = torch.cat([part[0] for part in parts], dim=-1)
    gaussian = values
    if lobes.form is Form.ASG:
        gaussian = torch.cat([part[1] for part in parts], dim=-1)
    return Images(
        lobes, values, gaussian, _scale(lobes, (values @ places.share[..., None])[..., 0])
    )


def _scale(lobes: Lobes, mean: Tensor) -> Tensor:
    """Return what makes the mean over the sphere of narrow lobes exact.  [F, N]."""
    exact = _plane_integral(lobes) / (4 * math.pi)
    scale = (exact / mean.clamp(min=torch.finfo(mean.dtype).tiny)).clamp(SCALE_MIN, SCALE_MAX)
    return torch.where(_is_narrow(lobes), scale, 1.0)


def _scale_slopes(lobes: Lobes, scale: Tensor, change: Tensor) -> Tensor:
    """Return d log scale along the five coordinates, where it is not at a bound.  [F, N, 5].

    Args:
        lobes: The lobes.  [F, N, .]
        scale: Their `_scale`.  [F, N]
        change: d log mean, the mean over the adaptive cells.  [F, N, 5]
    """
    free = _is_narrow(lobes) & (scale > SCALE_MIN) & (scale < SCALE_MAX)
    return torch.where(free[..., None], _plane_integral_slopes(lobes) - change, 0.0)


def _is_narrow(lobes: Lobes) -> Tensor:
    sharpness = lobes.sharpness
    return (sharpness.amax(-1) > NARROW_SHARPNESS) & (sharpness.amin(-1) > LONG_SHARPNESS)


def _plane_integral(lobes: Lobes) -> Tensor:
    """Return the integral of narrow lobes of amplitude 1.  [F, N]."""
    sx, sy = lobes.sharpness.unbind(-1)
    if lobes.form is Form.SG:
        return 2 * math.pi / sx
    plane = math.pi / (sx * sy).sqrt()
    if lobes.form is Form.ASG:  # dx dy = z dw
        return plane
    return 2 * plane * (1 + (1 / sx + 1 / sy) / 4)  # two lobes; dw = dx dy / z, 1 / z ~ 1 + r^2 / 2


def _plane_integral_slopes(lobes: Lobes) -> Tensor:
    """Return d log of it along the five coordinates, of which widths hold it nearly.  [F, N, 5]."""
    sharpness = lobes.sharpness
    found = sharpness.new_zeros(*sharpness.shape[:-1], 5)
    if lobes.form is Form.SG:
        found[..., 2] = -BROAD / sharpness[..., 0]
        return found
    found[..., 2:4] = -BROAD / (2 * sharpness)
    if lobes.form is Form.BINGHAM:
        sides = 4 + (1 / sharpness).sum(-1, keepdim=True)
        found[..., 2:4] -= (sharpness + BROAD) / (sharpness.square() * sides)
    return found


def _values(lobes: Lobes, exponent: Tensor, monomials: Tensor) -> tuple[Tensor, Tensor]:
    """Return values and values over z.  Two [F, N, P']."""
    power = torch.matmul(exponent, monomials[..., 1:, :]).clamp_(min=EXPONENT_MIN)
    if lobes.form is not Form.ASG:
        values = power.exp_()
        return values, values
    z = torch.matmul(lobes.axis_z, monomials[..., 1:4, :])
    # a product with 1 in front and 0 behind takes a tenth of the time of a choice
    gaussian = power.exp_().mul_(z.sign().clamp_(min=0))
    return z.mul_(gaussian), gaussian


def scale_slopes(shown: Images, seen: Footprint, places: AdaptiveCells) -> Tensor:
    """Return d log scale along the five coordinates; of flat lobes, of their terms.  [F, N, 5].

    Args:
        shown: The lobes on the adaptive cells.
        seen: Their footprint on the adaptive cells' levels.
        places: The adaptive cells.
    """
    shown = shown.terms or shown
    share = places.share[:, None]
    mean = (shown.values @ share.mT).clamp(min=torch.finfo(share.dtype).tiny)
    return _scale_slopes(shown.lobes, shown.scale, _shape_slopes(shown, seen, share, places) / mean)


def slopes(
    shown: Images, seen: Footprint, of_scale: Tensor, slope: Tensor, places: AdaptiveCells
) -> Tensor:
    """Contract the derivatives of each lobe with the slope of a loss.

    Args:
        shown: The lobes on the adaptive cells.
        seen: Their footprint on the adaptive cells' levels.
        of_scale: Their `scale_slopes`.  [F, N, 5]
        slope: dJ / d radiance.  [F, 3, P]
        places: The adaptive cells.

    Returns:
        dJ along the five coordinates and the three amplitudes of each lobe.  [F, N, 8]
    """
    if shown.terms is not None:
        of_terms = slopes(shown.terms, seen, of_scale, slope, places)
        return flat_terms.slopes_of_lobes(of_terms, shown.terms.lobes, shown.lobes)
    along = shown.light @ slope  # dJ / d value  [F, N, P]
    shape = _shape_slopes(shown, seen, along, places)
    light = shown.values @ slope.mT * shown.scale[..., None]
    shape += of_scale * (light * shown.lobes.amplitude).sum(-1, keepdim=True)
    return torch.cat([shape, light], dim=-1)


def _shape_slopes(shown: Images, seen: Footprint, along: Tensor, places: AdaptiveCells) -> Tensor:
    """Return the slopes of sum along * value along the five coordinates.  [F, N or 1, P]."""
    lobes = shown.lobes
    valued = shown.values * along
    moments = [valued[..., place] @ mono[..., 1:, :].mT for _, mono, place in places.levels]
    shape = (seen.derivatives @ torch.stack(moments)[..., None])[..., 0].sum(0)
    if lobes.form is Form.ASG:
        tilted = shown.gaussian * along
        vector = sum(tilted[..., place] @ mono[..., 1:4, :].mT for _, mono, place in places.levels)
        shape[..., :2] += (lobes.axes[..., :2, :] @ torch.as_tensor(vector)[..., None])[..., 0]
    return shape


def columns(lobes: Lobes, seen: Footprint, level: int, monomials: Tensor) -> Tensor:
    """Return each lobe and its five derivatives as means over cells of one size, but for `scale`.

    Args:
        lobes: The lobes.  [F, N, .]
        seen: Their footprint.
        level: Which of the footprint's sizes the adaptive cells have.
        monomials: Of the adaptive cells' centres.  [(F,) 10, P']

    Returns:
        Row 6 i is lobe i, rows 6 i + 1 to 6 i + 5 its derivatives.  [F, 6 N, P']
    """
    if lobes.form is Form.FLAT:
        of_terms = columns(flat.terms(lobes), seen, level, monomials)
        return flat_terms.columns_of_lobes(of_terms, lobes)
    values, gaussian = _values(lobes, seen.exponent[level], monomials)
    shape = torch.matmul(seen.derivatives[level].flatten(1, 2), monomials[..., 1:, :])
    shape = shape.unflatten(1, (lobes.count, 5)).mul_(values[:, :, None])
    if lobes.form is Form.ASG:
        across = torch.matmul(lobes.axes[..., :2, :].flatten(1, 2), monomials[..., 1:4, :])
        shape[:, :, :2] += across.unflatten(1, (lobes.count, 2)).mul_(gaussian[:, :, None])
    return torch.cat([values[:, :, None], shape], dim=2).flatten(1, 2)


def grid_columns(lobes: Lobes, seen: Footprint, level: int, cells: Grid) -> Tensor:
    """Return `columns` over all cells of a grid, at the scale of the lobes there.

    Args:
        lobes: The lobes.  [F, N, .]
        seen: Their footprint.
        level: Which of the footprint's sizes the cells have.
        cells: The grid.

    Returns:
        Rows as those of `columns`.  [F, 6 N, P']
    """
    if lobes.form is Form.FLAT:
        of_terms = grid_columns(flat.terms(lobes), seen, level, cells)
        return flat_terms.columns_of_lobes(of_terms, lobes)
    found = columns(lobes, seen, level, cells.monomials)
    mean = (found @ cells.share).unflatten(1, (lobes.count, COLUMNS))
    scale = _scale(lobes, mean[..., 0])
    change = mean[..., 1:] / mean[..., :1].clamp(min=torch.finfo(mean.dtype).tiny)
    return _scaled(found, scale, _scale_slopes(lobes, scale, change))


def adaptive_columns(
    shown: Images, seen: Footprint, of_scale: Tensor, level: int, monomials: Tensor
) -> Tensor:
    """Return `columns` over the adaptive cells of one size, at the scale of the lobes on all.

    Args:
        shown: The lobes on all adaptive cells.
        seen: Their footprint.
        of_scale: Their `scale_slopes`.  [F, N, 5]
        level: Which of the footprint's sizes the adaptive cells have.
        monomials: Of the adaptive cells' centres.  [(F,) 10, P']

    Returns:
        Rows as those of `columns`.  [F, 6 N, P']
    """
    if shown.terms is not None:
        of_terms = adaptive_columns(shown.terms, seen, of_scale, level, monomials)
        return flat_terms.columns_of_lobes(of_terms, shown.lobes)
    return _scaled(columns(shown.lobes, seen, level, monomials), shown.scale, of_scale)


def _scaled(found: Tensor, scale: Tensor, of_scale: Tensor) -> Tensor:
    """Multiply columns by a scale that depends on the lobe.  [F, 6 N, P'].

    Args:
        found: The columns, which are changed.  [F, 6 N, P']
        scale: [F, N]
        of_scale: d log scale along the five coordinates.  [F, N, 5]
    """
    found = found.unflatten(1, (scale.shape[-1], COLUMNS))
    found[:, :, 1:] += of_scale[..., None] * found[:, :, :1]
    return found.mul_(scale[..., None, None]).flatten(1, 2)
