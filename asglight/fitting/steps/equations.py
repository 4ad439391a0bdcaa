# SPDX-License-Identifier: Apache-2.0
"""The equations of a Levenberg-Marquardt step: (H + damping diag H) delta = -gradient.

H is the Gauss-Newton matrix of J's quadratic majoriser (objective.py) [Marquardt 1963]. The
gradient is taken over every adaptive cell. H only shapes the step: its cells are coarser still, but
for the refined ones. C has the same functions (compiled/equations.c, compiled/steps.c).
"""

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.coordinates import UNKNOWNS
from asglight.fitting.loss.footprints import Footprint, footprint
from asglight.fitting.loss.grid import Grid, cell_sums, coarser, grid
from asglight.fitting.loss.lobe_images import COLUMNS, Images
from asglight.fitting.loss.objective import LossGradient
from asglight.fitting.loss.probes import CURVATURE_ROWS, probe, tables
from asglight.lobes import Lobes, asg


def normal_equations(
    shown: Images, loss_gradient: LossGradient, frame: objective.Target
) -> tuple[Tensor, Tensor]:
    """Return the Gauss-Newton matrix and the gradient of J.

    Args:
        shown: The lobes on the frames' adaptive cells.
        loss_gradient: Of what they show.
        frame: The maps and their weights.

    Returns:
        H [F, 8 N, 8 N] and g [F, 8 N] in float64, unknowns of a lobe together, shape before light.
    """
    lobes, places = shown.lobes, frame.places
    cells = summed_on(places)
    if compiled.serves(lobes, places):
        adaptive, probes = places.compiled, tables(cells.height)
        slopes, of_scale = compiled.slopes(lobes, shown.scale, loss_gradient.slope, adaptive)
        weights = loss_gradient.env_weight, loss_gradient.view_weight
        scales = shown.scale, of_scale
        hessian = compiled.matrix(lobes, scales, adaptive, cells, probes, weights)
        return hessian, slopes.flatten(1)
    sizes = [rows for rows, _, _ in places.levels]
    seen = footprint(lobes, [*sizes, cells.height])
    of_adaptive = Footprint(seen.exponent[:-1], seen.derivatives[:-1])
    of_scale = lobe_images.scale_slopes(shown, of_adaptive, places)
    slopes = lobe_images.slopes(shown, of_adaptive, of_scale, loss_gradient.slope, places)
    coarse = lobe_images.grid_columns(lobes, seen, -1, cells)
    weight = cell_sums(loss_gradient.env_weight[:, : places.count], places.rows, cells.height)
    gram = (coarse * weight[:, None]) @ coarse.mT
    for level, (_, monomials, place) in list(enumerate(places.levels))[1:]:
        sharp = lobe_images.adaptive_columns(shown, seen, of_scale, level, monomials)
        gram += (sharp * loss_gradient.env_weight[:, None, place]) @ sharp.mT
    views = probe(coarse, cells.height)
    gram += (views * loss_gradient.view_weight[:, None]) @ views.mT
    return _chain(gram.double(), lobes.amplitude.double()), slopes.double().flatten(1)


def _chain(gram: Tensor, amplitude: Tensor) -> Tensor:
    """Go from columns to unknowns: a shape unknown moves each channel by the lobe's amplitude."""
    frames, count, _ = amplitude.shape
    blocks = gram.reshape(frames, count, COLUMNS, count, COLUMNS)
    shape_light = blocks[:, :, 1:, :, :1] * amplitude[:, :, None, None]  # [F, N, 5, N, 3]
    hessian = gram.new_zeros(frames, count, UNKNOWNS, count, UNKNOWNS)
    both = (amplitude @ amplitude.mT)[:, :, None, :, None]
    hessian[:, :, :5, :, :5] = blocks[:, :, 1:, :, 1:] * both
    hessian[:, :, :5, :, 5:] = shape_light
    hessian[:, :, 5:, :, :5] = shape_light.permute(0, 3, 4, 1, 2)
    for channel in range(5, 8):
        hessian[:, :, channel, :, channel] = blocks[:, :, 0, :, 0]
    return hessian.reshape(frames, count * UNKNOWNS, count * UNKNOWNS)


def solve(
    hessian: Tensor, gradient: Tensor, lobes: Lobes, damping: Tensor, still: Tensor | None = None
) -> Tensor:
    """Solve the damped systems; unknowns at a bound that would cross it stay.  [F, N, 8]."""
    ahead = gradient.reshape(-1, lobes.count, UNKNOWNS)
    held = torch.zeros_like(ahead, dtype=torch.bool)
    held[..., 2:4] = (lobes.sharpness <= asg.SHARPNESS_MIN) & (ahead[..., 2:4] > 0)
    held[..., 5:] = (lobes.amplitude <= 0) & (ahead[..., 5:] > 0)
    if still is not None:
        held |= still[..., None]
    free = ~held.flatten(1)
    diagonal = torch.diagonal(hessian, dim1=-2, dim2=-1)
    largest = diagonal.amax(-1, keepdim=True).clamp(min=1e-300)
    # unknowns that nothing in the map sees get unit curvature, far above their gradient of 0
    curvature = torch.where(diagonal > 1e-12 * largest, diagonal, largest)
    # scaled to unit diagonal: sharpness and radiance differ by ten orders of magnitude
    scale = free * (diagonal + damping[:, None] * curvature).clamp(min=1e-300).rsqrt()
    scaled = hessian * (scale[:, :, None] * scale[:, None, :])
    torch.diagonal(scaled, dim1=-2, dim2=-1).fill_(1.0)
    right = -gradient * scale
    factor, failed = torch.linalg.cholesky_ex(scaled)
    # cholesky_solve of several systems is MAGMA's on a GPU, which no graph can hold
    half = torch.linalg.solve_triangular(factor, right[..., None], upper=False)
    step = torch.linalg.solve_triangular(factor.mT, half, upper=True)[..., 0] * scale
    step = torch.where((failed > 0)[:, None], 0.0, step)
    return step.reshape(-1, lobes.count, UNKNOWNS)


def summed_on(places: AdaptiveCells) -> Grid:
    """Return the grid of cells on which the matrix is summed."""
    return grid(coarser(places.rows, CURVATURE_ROWS), str(places.refined.device))
