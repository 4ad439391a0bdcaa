# SPDX-License-Identifier: Apache-2.0
"""Where the lobes of a first frame start: flux-weighted splitting, then EM with second moments.

A map is a density of flux over the sphere. It is cut into N clusters of cells by variance, each
time the cluster with the most flux and spread along its principal axis: the variance-minimisation
cut [Viriyothai and Debevec 2009]. Other starts for the same map come from a spread that counts no
more for being wider than some degrees: a small lamp with much of the light then gets more lobes.
A start from even directions finds other places than any cut. Expectation-maximisation then fits a
mixture of isotropic densities to the flux [Banerjee et al. 2005]: each lobe takes its share of
every cell and moves to the mean and variance of what it took, and at the end to its in-plane
covariance. Flux is kept exactly: each lobe's amplitude is the RGB
flux it took over its integral.

A cell is a block of texels, the smaller the brighter, down to one texel. It is represented by its
flux and by the exact first and second moments of direction within it, so a lamp of one texel stays
as narrow as it is.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.loss import constants
from asglight.lobes import Form, Lobes, asg, flat
from asglight.lobes.frames import axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

CELL_ROWS = (32, 64, 128)
"""Rows of the grids of blocks, where the map has them: the widest is 5.6 degrees, what GGX 0.25
shows of a point, and each next one is taken where the one before is bright."""

EM_STEPS = 30

EVEN_STEPS = 40
"""From even directions, as the peer takes: so is found what a fit is held
against (reweighting.py)."""

BRIGHT_SHARE = 5e-4
"""Flux share from which a block is taken apart. At most 2,000 of a size can be."""

WIDTH_MIN_TEXELS = 0.2
"""Sigma of the narrowest lobe, in texels of the map: the sun's disc at 256 rows.
Texels shrink with the cosine of latitude: 0.35, for which a square texel's own standard deviation
of 0.29 would speak, spills a third of a high sun onto its neighbours, which doubles `env`."""

SHARE_MIN = 1e-9
"""Flux share below which a lobe takes part in no M-step: it would divide by rounding."""

TIE = 1e-3
"""Relative difference of variances below which two axes of a cluster count alike: of lamps that
stand alike around a middle, texels and the lamps' own widths leave 1e-4."""

ASKEW = (0.2, 0.5, 0.84)
"""Of axes that count alike the one nearest to this is taken: lamps of few places seldom are at a
right angle to it, and it does not hang on the order in which a library finds the axes."""


@dataclass(frozen=True)
class Cells:
    """A map as C cells.

    Attributes:
        flux: RGB flux of each cell.  [C, 3]
        weight: Flux summed over RGB, over that of the whole map.  [C]
        mean: Flux-weighted mean of direction in the cell; its length is below 1.  [C, 3]
        second: Flux-weighted mean of the outer product of direction.  [C, 3, 3]
        variance_min: Smallest variance a lobe may have along an axis, radians squared.
    """

    flux: Tensor
    weight: Tensor
    mean: Tensor
    second: Tensor
    variance_min: float


def cells(reference: Tensor) -> Cells:
    """Gather a map into blocks, down to texels where it is bright.

    Blocks without flux are left out; a black map gives one empty cell.

    Args:
        reference: Radiance.  [H, W, 3]
    """
    height, width, _ = reference.shape
    moments, solid_angle = _of_directions(height, width, str(reference.device))
    # RGB, power times direction and its outer product; no more of so much memory than it takes
    texels = moments.new_empty(height, width, 3 + moments.shape[-1])
    texels[..., :3] = reference
    torch.mul(texels[..., :3].sum(-1, keepdim=True), moments, out=texels[..., 3:])
    texels *= solid_angle
    grids = [texels]  # from fine to coarse
    for rows in reversed(CELL_ROWS):
        if rows < height and height % rows == 0:
            factor = len(grids[-1]) // rows
            columns = grids[-1].unflatten(1, (-1, factor)).sum(2)
            grids.append(columns.unflatten(0, (-1, factor)).sum(1))
    enough = BRIGHT_SHARE * grids[-1][..., :3].sum()
    parts: list[Tensor] = []
    reached = torch.ones(1, 1, dtype=torch.bool, device=reference.device)
    for blocks in reversed(grids[1:]):
        reached = _finer(reached, len(blocks))
        bright = blocks[..., :3].sum(-1) > enough
        parts.append(blocks[reached & ~bright])
        reached = reached & bright
    parts.append(texels[_finer(reached, height)])
    summed = torch.cat(parts)
    power = summed[:, :3].sum(-1)
    lit = power > 0
    if not bool(lit.any()):
        lit[0] = True
    summed, power = summed[lit], power[lit].clamp(min=torch.finfo(torch.float64).tiny)
    return Cells(
        flux=summed[:, :3],
        weight=power / power.sum(),
        mean=summed[:, 3:6] / power[:, None],
        second=summed[:, 6:].reshape(-1, 3, 3) / power[:, None, None],
        variance_min=(WIDTH_MIN_TEXELS * math.pi / height) ** 2,
    )


def _finer(blocks: Tensor, rows: int) -> Tensor:
    """Repeat what is known of blocks on a finer grid.  [H', 2 H' or 1] -> [rows, 2 rows]."""
    finer = blocks.repeat_interleave(rows // blocks.shape[0], 0)
    return finer.repeat_interleave(2 * rows // blocks.shape[1], 1)


@lru_cache(maxsize=4)
@torch.inference_mode(False)
def _of_directions(height: int, width: int, device: str) -> tuple[Tensor, Tensor]:
    """Return what depends on the grid alone: made once, for it is brought to a GPU.

    Returns:
        Direction and its outer product [H, W, 12], and solid angle [H, W, 1], of each texel.
    """
    directions = latlong.directions(height, width, dtype=torch.float64)
    outer = (directions[..., :, None] * directions[..., None, :]).flatten(2)
    solid_angle = latlong.texel_solid_angles(height, width, dtype=torch.float64)[..., None]
    return torch.cat([directions, outer], dim=-1).to(device), solid_angle.contiguous().to(device)


def split(source: Cells, count: int, spread_deg: float) -> Tensor:
    """Cut the cells into clusters of small flux-weighted spread.

    Args:
        source: The cells.
        count: N.
        spread_deg: Standard deviation that counts as half of the most there is; infinity for one
            that counts in full.

    Returns:
        Cluster index of each cell, below `count`; fewer clusters where cells run out.  [C]
    """
    labels = torch.zeros_like(source.weight, dtype=torch.long)
    half = math.radians(spread_deg) ** 2
    sizes, axes, middles = (each[None] for each in _principal_spread(source, labels == 0, half))
    for new in range(1, count):
        chosen = sizes.argmax()
        own = torch.arange(new, device=labels.device) == chosen
        axis, middle = (own[:, None] * axes).sum(0), (own * middles).sum()
        beyond = source.mean @ axis > middle
        members = labels == chosen
        labels = torch.where(members & beyond & (sizes.max() > 0), new, labels)
        left = _principal_spread(source, labels == chosen, half)
        right = _principal_spread(source, labels == new, half)
        sizes, middles = (
            torch.cat([torch.where(own, less, each), more[None]])
            for each, less, more in ((sizes, left[0], right[0]), (middles, left[2], right[2]))
        )
        axes = torch.cat([torch.where(own[:, None], left[1], axes), right[1][None]])
    return labels


def _principal_spread(source: Cells, members: Tensor, half: float) -> tuple[Tensor, Tensor, Tensor]:
    """Return flux times variance / (1 + variance / half), the axis of it, and the mean along it.

    Where lamps stand alike around a middle no axis is the principal one, and a plane across that
    which comes first goes through lamps: of six on the axes two shared a lobe in the end. A plane
    askew to them passes between.

    Args:
        source: The cells; those of no weight count nowhere.
        members: Which of them.  [C]
        half: Variance that counts as half of the most there is.

    Returns:
        [], [3] and []; the first is 0 where there are fewer than two.
    """
    weight = source.weight * members
    total = weight.sum().clamp(min=torch.finfo(weight.dtype).tiny)
    centre = (weight[:, None] * source.mean).sum(0) / total
    offset = source.mean - centre
    scatter = (weight[:, None] * offset).mT @ offset
    values, vectors = torch.linalg.eigh(scatter)
    tied = values >= (1 - TIE) * values[-1]
    askew = vectors @ (tied * (vectors.mT @ constants.like(vectors, *ASKEW)))
    askew = torch.nn.functional.normalize(askew, dim=0)
    axis = torch.where(tied.sum() > 1, askew, vectors[:, -1])
    variance = values[-1] / total
    size = total * variance / (1 + variance / half)
    return torch.where((weight > 0).sum() > 1, size, 0.0), axis, (centre * axis).sum()


@dataclass(frozen=True)
class Mixture:
    """Isotropic densities of flux, which lobes of any form can start from.

    Attributes:
        lobes: Lobes of the form sg with their directions and widths.  [N, .]
        taken: The share of each cell that each takes.  [C, N]
    """

    lobes: Lobes
    taken: Tensor


def expectation_maximisation(source: Cells, taken: Tensor, steps: int) -> Mixture:
    """Fit a mixture of isotropic densities to the cells' flux.

    Anisotropic densities find worse starts: on ten maps, each at three angles, fits from them end
    with a J larger by 6 % in the mean, and all errors with it.

    Args:
        source: The cells.
        taken: The share of each cell that each lobe takes at first.  [C, N]
        steps: How many.
    """
    if compiled.mixes(source.weight):
        axis_z, sharpness, taken = compiled.mixture(source, taken, steps)
        widths = sharpness[:, None].expand(-1, 2)
        return Mixture(Lobes(axes_around(axis_z), widths, torch.ones_like(axis_z), Form.SG), taken)
    lobes = _maximisation(source, taken, Form.SG, None)
    for _ in range(steps):
        taken = _expectation(source, lobes, taken)
        lobes = _maximisation(source, taken, Form.SG, lobes)
    return Mixture(lobes, taken)


def lobes_of(found: Mixture, source: Cells, form: Form) -> Lobes:
    """Return lobes with the moments of what each part of a mixture took.

    Args:
        found: The mixture.
        source: The cells.
        form: Lobe function; flat ones are found as asg.

    Returns:
        In float32, of the map's flux.  [N, .]
    """
    if form is Form.FLAT:  # so measured; no other start was tried
        return flat.as_flat(lobes_of(found, source, Form.ASG))
    lobes = _maximisation(source, found.taken, form, found.lobes)
    flux = found.taken.mT @ source.flux  # [N, 3]
    amplitude = flux / asg.integral(lobes)[:, None]
    return Lobes(lobes.axes, lobes.sharpness, amplitude, form).to(torch.float32)


def _expectation(source: Cells, lobes: Lobes, taken: Tensor) -> Tensor:
    """Return each lobe's share of each cell, from the densities at the cell's mean.  [C, N]."""
    share = (source.weight @ taken).clamp(min=torch.finfo(torch.float64).tiny)
    centre = torch.nn.functional.normalize(source.mean, dim=-1)
    density = asg.unit_lobes(lobes, centre) / asg.integral(lobes)[:, None]  # [N, C]
    likelihood = (share[:, None] * density).mT.contiguous()
    total = likelihood.sum(-1, keepdim=True)
    # cells that no density reaches go to the nearest lobe
    nearest = (centre @ lobes.axis_z.mT).argmax(-1)
    return torch.where(total < 1e-250, _shares_of(nearest, lobes.count), likelihood / total)


def _shares_of(labels: Tensor, count: int) -> Tensor:
    """Return 1 for the label of each cell, 0 for others, in float64.  [C] -> [C, N]."""
    return (labels[:, None] == torch.arange(count, device=labels.device)).double()


def _maximisation(source: Cells, taken: Tensor, form: Form, previous: Lobes | None) -> Lobes:
    """Return the lobes with the mean and covariance of the flux that each took."""
    weight = source.weight[:, None] * taken  # [C, N]
    total = weight.sum(0)
    safe = total.clamp(min=SHARE_MIN)
    mean = (weight.mT @ source.mean) / safe[:, None]
    second = torch.einsum("cn,cij->nij", weight, source.second) / safe[:, None, None]
    alive = (total > SHARE_MIN) & (mean.norm(dim=-1) > 1e-6)
    if previous is None:
        fallback = axes_around(constants.like(mean, 0.0, 1.0, 0.0).expand(len(total), 3))
        fallback_sharpness = torch.ones_like(mean[:, :2])
    else:
        fallback, fallback_sharpness = previous.axes, previous.sharpness
    axis_z = torch.nn.functional.normalize(mean, dim=-1)
    axis_z = torch.where(alive[:, None], axis_z, fallback[:, 2])
    tangent = axes_around(axis_z)[:, :2]  # [N, 2, 3]
    in_plane = tangent @ second @ tangent.mT
    variance, vectors = torch.linalg.eigh(in_plane)  # ascending: x is the sharper axis
    if form is Form.SG:
        variance = variance.mean(-1, keepdim=True).expand(-1, 2)
    axis_x, axis_y = (vectors.mT @ tangent).unbind(1)
    flip = torch.linalg.det(torch.stack([axis_x, axis_y, axis_z], dim=1)) < 0
    axes = torch.stack([torch.where(flip[:, None], -axis_x, axis_x), axis_y, axis_z], dim=1)
    sharpness = sharpness_from_variance(variance.clamp(min=source.variance_min), form)
    return Lobes(
        torch.where(alive[:, None, None], axes, fallback),
        torch.where(alive[:, None], sharpness, fallback_sharpness),
        torch.ones_like(mean),
        form,
    )


def sharpness_from_variance(variance: Tensor, form: Form) -> Tensor:
    """Return the sharpness whose lobe has the given mean of x^2; within 2 % for one axis alone.

    For a narrow lobe it is 1 / (2 variance) (sg: 1 / variance). For a broad one the hemisphere
    bounds x^2: the uniform asg has variance 1/4, which the exponential correction reproduces.
    """
    if form is Form.FLAT:
        return flat.VARIANCE * sharpness_from_variance(variance, Form.ASG)
    if form is Form.SG:
        return (1 / variance - 1).clamp(min=asg.SHARPNESS_MIN, max=asg.SHARPNESS_MAX)
    narrow = 1 / (2 * variance)
    corrected = narrow - 2 * torch.exp(-0.9 * (narrow - 2).clamp(min=0))
    return corrected.clamp(min=asg.SHARPNESS_MIN, max=asg.SHARPNESS_MAX)


def seed_lobes(source: Cells, count: int, form: Form, spread_deg: float | None) -> Lobes:
    """Return starting lobes for a map's cells.

    Args:
        source: The cells.
        count: N.
        form: Lobe function.
        spread_deg: Of the cut into clusters (`split`); None for no cut, but even directions.

    Returns:
        In units of the map.  [N, .]
    """
    return lobes_of(mixture(source, count, spread_deg), source, form)


def mixture(source: Cells, count: int, spread_deg: float | None) -> Mixture:
    """Return where lobes of any form start from; see `seed_lobes`."""
    if spread_deg is None:
        return expectation_maximisation(source, _even(source, count), EVEN_STEPS)
    labels = split(source, count, spread_deg)
    return expectation_maximisation(source, _shares_of(labels, count), EM_STEPS)


def _even(source: Cells, count: int) -> Tensor:
    """Return what densities in even directions that just overlap take of each cell.  [C, N].

    Start and steps are those of the peer (asglight/peers/vmf_em.py).
    """
    axes = axes_around(fibonacci_directions(count).to(source.mean))
    sharpness = torch.full_like(axes[:, :2, 0], float(count))
    start = Lobes(axes, sharpness, torch.ones_like(axes[:, 0]), Form.SG)
    alike = torch.full_like(source.weight[:, None], 1 / count).expand(-1, count)
    return _expectation(source, start, alike)
