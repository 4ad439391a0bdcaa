# SPDX-License-Identifier: Apache-2.0
"""Texels of a dome, made for renderers that interpolate between them, as nearly all do.

Linear interpolation shows a texel as a tent two texels wide. It leaves flux and direction as they
are and adds 1/6 square texel to the variance each way, which on 256 rows is 0.3 degrees: as much as
a sun has. Mean radiances over texels would also move a sun by up to half a texel. So the texels
hold narrower lobes, and what interpolation makes of them has the lobes' own second moments:

- A lobe of a texel or more is taken at the texel centres, narrowed by the tent.
- A smaller one is cut into points, and each point shared by the four texels around it, as
  interpolation would weigh them there. Sharing adds 1/6 square texel once more, so the lobe is
  narrowed twice as much, to a line or a point at the least. A point between two texels takes both,
  and shows 1/4 square texel wider than one in the middle; nothing not negative is narrower. A flat
  lobe so small is taken for an asg one: no texel can tell.

Rows next to a pole count as all others; a renderer has no texel beyond them.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import torch
from torch import Tensor

from asglight.lobes import asg, flat, texels
from asglight.lobes.data import Form, Lobes
from asglight.sphere import latlong

TENT = 1 / 6
"""Variance of a tent two texels wide, in square texels."""

SAMPLED_WIDTH_TEXELS = 1.0
"""Sigma from which a lobe is taken at the centres: narrowed it has variance 5/6, and the sum over
a grid is right to 2 exp(-2 pi^2 5/6) = 1e-7 (Poisson's summation formula)."""

GAUSSIAN_WIDTH = 0.05
"""Sigma in radians below which a lobe of the form sg is taken for an asg one of its flux: at two
sigma the exponents are 0.5 % apart."""

REACH = 5.0
"""Sigmas to which the points of a lobe go: 6e-7 of a Gaussian lies beyond each way."""


EXPONENT_MAX = 30.0
"""Beyond it a lobe is left out of whole rows: 1e-13 of its peak."""

ROWS = 16
"""Of an image, for which it is decided together which lobes are left out."""

TEXELS_AT_ONCE = 2**13
"""What 15 lobes are there takes 1 MB and stays in the cache of a core: 16 rows of 256, or all of an
image of 64 rows that leaves out no lobe. All rows of 256 at once take 1.3 times as long, 4 rows
1.15 times."""


@dataclass(frozen=True)
class _Part:
    """Lobes of some frames that are brought to the texels in one way.

    Attributes:
        lobes: Narrowed, in float64.  [K, .]
        frame: Which frame each belongs to, ascending.  [K]
        is_shared: They are cut into points; the others are taken at the texel centres.
    """

    lobes: Lobes
    frame: Tensor
    is_shared: bool


@dataclass(frozen=True)
class _Sampled:
    """Lobes of one frame that are taken at the texel centres.

    Attributes:
        lobes: In float32.  [K, .]
        near: For each `ROWS` of the image, which lobes are not left out.
    """

    lobes: Lobes
    near: list[tuple[bool, ...]]


@dataclass(frozen=True)
class _Shared:
    """Lobes of one frame that are cut into points.

    Attributes:
        lobes: In float64.  [K, .]
        flux: Theirs.  [K, 3]
    """

    lobes: Lobes
    flux: Tensor


def images(lobes: Lobes, height: int) -> list[Callable[[], Tensor]]:
    """Return for each frame what computes its texels; all lobes are narrowed together before.

    The texels show the lobes where a renderer interpolates between them.

    Args:
        lobes: N lobes of F frames.  [F, N, .]
        height: Rows; there are twice as many columns.

    Returns:
        For each frame what returns linear RGB radiance, float32.  [H, 2H, 3]
    """
    count, lobe_count = lobes.sharpness.shape[:2]
    frame = torch.arange(count).repeat_interleave(lobe_count)
    flattened = Lobes(
        lobes.axes.flatten(0, 1),
        lobes.sharpness.flatten(0, 1),
        lobes.amplitude.flatten(0, 1),
        lobes.form,
    ).to("cpu", torch.float64)
    by_frame = [
        _shared_by_frame(part, count) if part.is_shared else _sampled_by_frame(part, count, height)
        for part in _parts(flattened, frame, math.pi / height)
    ]
    return [partial(_image, list(parts), height) for parts in zip(*by_frame, strict=True)]


def _parts(lobes: Lobes, frame: Tensor, texel: float) -> list[_Part]:
    """Choose the way of each lobe and narrow it for that.  [K, .], [K]."""
    width = texels.lobe_width(lobes)
    if lobes.form is Form.SG:
        narrow = width < max(GAUSSIAN_WIDTH, SAMPLED_WIDTH_TEXELS * texel)
        gaussian = _parts(_as_asg(lobes.select(narrow)), frame[narrow], texel)
        return [_Part(lobes.select(~narrow), frame[~narrow], is_shared=False), *gaussian]
    small = width < SAMPLED_WIDTH_TEXELS * texel
    sampled = _Part(narrowed(lobes.select(~small), texel, TENT), frame[~small], is_shared=False)
    if lobes.form is Form.FLAT and bool(small.any()):
        return [sampled, *_parts(_as_asg(lobes.select(small)), frame[small], texel)]
    points = narrowed(lobes.select(small), texel, 2 * TENT)
    return [sampled, _Part(points, frame[small], is_shared=True)]


def _sampled_by_frame(part: _Part, count: int, height: int) -> list[_Sampled]:
    """Return what each of so many frames has of lobes that are taken at the texel centres."""
    first, last = _rows_reached(part.lobes, height)
    top = torch.arange(0, height, ROWS)
    near = (first[:, None] < (top + ROWS).clamp(max=height)) & (last[:, None] >= top)
    lobes = part.lobes.to("cpu", torch.float32)
    return [
        _Sampled(lobes[own], list(zip(*near[own].tolist(), strict=True)))
        for own in _frames_of(part, count)
    ]


def _shared_by_frame(part: _Part, count: int) -> list[_Shared]:
    """Return what each of so many frames has of lobes that are cut into points."""
    flux = asg.flux(part.lobes)
    return [_Shared(part.lobes[own], flux[own]) for own in _frames_of(part, count)]


def _frames_of(part: _Part, count: int) -> list[slice]:
    """Return where the lobes of each of so many frames are; they are in the order of frames."""
    ends = torch.searchsorted(part.frame, torch.arange(count + 1)).tolist()
    return [slice(first, end) for first, end in itertools.pairwise(ends)]


def _image(parts: list[_Sampled | _Shared], height: int) -> Tensor:
    """Return the texels of one frame.  [H, 2H, 3]."""
    image = torch.zeros(2 * height * height, 3)
    for part in parts:
        if isinstance(part, _Sampled):
            _add_samples(image, part, height)
    shared = [part for part in parts if isinstance(part, _Shared) and part.lobes.count]
    if not shared:
        return image.view(height, 2 * height, 3)
    flux = torch.zeros(2 * height * height, 3, dtype=torch.float64)
    for part in shared:
        for index in range(part.lobes.count):
            _share(flux, part.lobes[index : index + 1], part.flux[index], height)
    solid_angles = latlong.texel_solid_angles(height, 2 * height, dtype=torch.float64)[..., None]
    found = flux.view(height, 2 * height, 3) / solid_angles
    return image.view(height, 2 * height, 3) + found.float()


def narrowed(lobes: Lobes, texel: float, squares: float) -> Lobes:
    """Take the variance of so many square texels from lobes, their flux kept.

    Args:
        lobes: Lobes of the form asg, bingham or flat.  [N, .]
        texel: Height of a row, in radians.
        squares: Variance along rows and columns, in square texels.

    Returns:
        Lobes in float64; a variance that is used up becomes that of the sharpest lobe.  [N, .]
    """
    lobes = lobes.to("cpu", torch.float64)
    axis_z = lobes.axis_z
    level = axis_z[..., [0, 2]].norm(dim=-1)  # cosine of latitude: how wide a texel is
    # at a pole a texel has no width, and it does not matter where east is
    east = torch.stack([axis_z[..., 2], torch.zeros_like(level), -axis_z[..., 0]], dim=-1)
    east = east / level.clamp(min=1e-12)[..., None]
    grid = torch.stack([east * level[..., None], torch.linalg.cross(axis_z, east)], dim=-2)
    across = lobes.axes[..., :2, :]
    along = across @ grid.mT  # [N, 2, 2]
    per_variance = asg.per_variance(lobes.form)
    variance = torch.diag_embed(1 / (per_variance * lobes.sharpness.clamp(min=asg.SHARPNESS_MIN)))
    variance -= squares * texel**2 * along @ along.mT
    values, vectors = torch.linalg.eigh(variance)
    axis_x = (vectors.mT @ across)[..., 0, :]
    axes = torch.stack([axis_x, torch.linalg.cross(axis_z, axis_x), axis_z], dim=-2)
    narrowest = 1 / (per_variance * asg.SHARPNESS_MAX)
    sharpness = 1 / (per_variance * values.clamp(min=narrowest))
    result = replace(lobes, axes=axes, sharpness=sharpness)
    ratio = asg.integral(lobes) / asg.integral(result)
    return replace(result, amplitude=lobes.amplitude * ratio[..., None])


def _add_samples(image: Tensor, sampled: _Sampled, height: int) -> None:
    """Add the radiance at the texel centres.

    Args:
        image: Added to.  [2HH, 3]
        sampled: Lobes that are taken there.
        height: Rows.
    """
    width, centres = 2 * height, _centres(height)
    for near, first, last in _runs(sampled.near, max(TEXELS_AT_ONCE // (width * ROWS), 1)):
        if any(near):
            texels_of_rows = slice(first * ROWS * width, last * ROWS * width)
            chosen = sampled.lobes if all(near) else sampled.lobes.select(torch.tensor(near))
            image[texels_of_rows] += _values(chosen, centres[:, texels_of_rows])


def _runs(
    near: Sequence[tuple[bool, ...]], most: int
) -> Iterator[tuple[tuple[bool, ...], int, int]]:
    """Yield what several neighbours have in common, and where they begin and end.

    Args:
        near: What each has.
        most: How many at once.
    """
    first = 0
    for after in range(1, len(near) + 1):
        if after == len(near) or after - first == most or near[after] != near[first]:
            yield near[first], first, after
            first = after


def _rows_reached(lobes: Lobes, height: int) -> tuple[Tensor, Tensor]:
    """Return the first and the last row in which a lobe is more than exp(-EXPONENT_MAX).  [N]."""
    polar = torch.acos(lobes.axis_z[..., 1].clamp(-1, 1))
    if lobes.form is Form.SG:  # broad ones only, which have no hemisphere
        reach = torch.full_like(polar, math.pi)
    else:
        reach = torch.asin((EXPONENT_MAX / lobes.sharpness.amin(-1)).sqrt().clamp(max=1))
    top, bottom = polar, polar
    if lobes.form is Form.BINGHAM:  # from the one side to the other
        top, bottom = torch.minimum(polar, math.pi - polar), torch.maximum(polar, math.pi - polar)
    per_row = height / math.pi
    return ((top - reach) * per_row).floor(), ((bottom + reach) * per_row).floor()


def _values(lobes: Lobes, directions: Tensor) -> Tensor:
    """Return `asg.evaluate` at directions [3, P]; as few arrays as can be.  [P, 3]."""
    if lobes.form is Form.SG:
        return asg.evaluate(lobes, directions.mT)
    root = lobes.sharpness.sqrt()
    x = (lobes.axis_x * root[:, :1]) @ directions
    y = (lobes.axis_y * root[:, 1:]) @ directions
    value = x.square_().addcmul_(y, y).neg_().exp_()
    if lobes.form is Form.FLAT:
        value = flat.values(value)
    if lobes.form is not Form.BINGHAM:
        value.mul_((lobes.axis_z @ directions).clamp_(min=0))
    return value.mT @ lobes.amplitude


@lru_cache(maxsize=4)
@torch.inference_mode(False)
def _centres(height: int) -> Tensor:
    """Return the directions of the texel centres.  [3, P] float32."""
    return latlong.directions(height, 2 * height).view(-1, 3).mT.contiguous()


def _as_asg(lobes: Lobes) -> Lobes:
    """Return narrow lobes as such of the form asg, of the same flux and variances."""
    found = replace(lobes.to("cpu", torch.float64), form=Form.ASG)
    found = replace(found, sharpness=found.sharpness * asg.per_variance(lobes.form) / 2)
    ratio = asg.integral(lobes.to("cpu", torch.float64)) / asg.integral(found)
    return replace(found, amplitude=found.amplitude * ratio[..., None])


def _share(shared: Tensor, lobe: Lobes, flux_of_lobe: Tensor, height: int) -> None:
    """Add the flux of one lobe to the texels around its points.

    Args:
        shared: Flux of every texel, added to.  [2HH, 3]
        lobe: One lobe, its x axis the narrower one.  [1, .]
        flux_of_lobe: Its flux.  [3]
        height: Rows.
    """
    directions, share_of_flux = _points(lobe, math.pi / height)
    flux = share_of_flux[:, None] * flux_of_lobe
    u, v = latlong.uv_from_direction(directions)
    row, column = v * height - 0.5, u * 2 * height - 0.5
    above, left = row.floor(), column.floor()
    for down in (0, 1):
        for right in (0, 1):
            share = (1 - (row - above - down).abs()) * (1 - (column - left - right).abs())
            # rows of the caps above the first centre and below the last are their neighbour's
            place = (above.long() + down).clamp(0, height - 1) * 2 * height
            place += (left.long() + right) % (2 * height)
            shared.index_add_(0, place, share[:, None] * flux)


def _points(lobe: Lobes, texel: float) -> tuple[Tensor, Tensor]:
    """Cut one lobe into points, evenly in x and in t where d = (x, r sin t, r cos t).

    With r = sqrt(1 - x^2), dw = dx dt. Steps of sigma sum a Gaussian to 1e-8, steps of half a texel
    its product with a tent.

    Returns:
        Directions [T, 3]; the share of the flux of each [T], 1 together.
    """
    sigma = (2 * lobe.sharpness[0]).rsqrt().tolist()
    reach = [math.asin(min(1.0, REACH * one)) for one in sigma]
    x, t = (
        torch.linspace(-far, far, 2 * math.ceil(far / min(one, texel / 2)) + 1, dtype=torch.float64)
        for far, one in zip(reach, sigma, strict=True)
    )
    x, t = (grid.flatten() for grid in torch.meshgrid(x, t, indexing="ij"))
    radius = (1 - x * x).clamp(min=0).sqrt()
    local = torch.stack([x, radius * t.sin(), radius * t.cos()])
    share = asg.local_values(lobe, local[None])[0]
    share = share / share.sum()
    directions = local.mT @ lobe.axes[0]
    if lobe.form is Form.BINGHAM:
        return torch.cat([directions, -directions]), torch.cat([share, share]) / 2
    return directions, share
