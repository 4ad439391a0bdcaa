# SPDX-License-Identifier: Apache-2.0
"""The linear part of the fit: the light of lobes whose shapes are held."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.loss import adaptive_cells, objective
from asglight.fitting.loss.grid import coarsen
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.loss.objective import Corners
from asglight.fitting.loss.probes import probe, tables
from asglight.fitting.steps import newton
from asglight.fitting.steps.non_negative import non_negative_least_squares
from asglight.lobes import texels

CORNERS = Corners(0.1, 0.002)
"""phi's corners of a fit's last solution: what it can mend of what balls show."""

RIDGE = 1e-5
"""Of the unit diagonal of the amplitudes' Gram matrix: above the rounding of float32 images."""


def last(shown: Images, frame: objective.Target, still: Tensor | None = None) -> Images:
    """Return a fit with the last solution for its light, under `CORNERS`.

    Args:
        shown: The lobes on the adaptive cells.
        frame: The maps.
        still: Which lobes keep their light.  [F, N]
    """
    return solve_amplitudes(shown, replace(frame, corners=CORNERS), still)


def with_amplitudes(found: newton.Outcome, frame: objective.Target) -> Images:
    """Return lobes that took their steps with the last solution for their light.

    Args:
        found: The lobes.
        frame: The maps.
    """
    assert found.shown is not None  # of lobes that took steps
    return last(found.shown, frame)


def last_by_texel_means(shown: Images, frame: objective.Target) -> Images:
    """Return lobes with the last solution for their light, by their means over the map's texels.

    Steps see a lobe at the centres of cells, as wide as its mean over one would be. So a streak
    thinner than a texel looks a sixth darker between two rows of centres and a tenth brighter on
    one; where it crosses rows, its middle seems to lie elsewhere. Of one strip lamp, where steps
    saw an irr of 0.0001, it was 0.0012.

    Args:
        shown: The lobes on the adaptive cells.
        frame: The maps.
    """
    places = frame.places
    means = shown.values * shown.scale[..., None]
    found = False
    for index, (values, texel) in enumerate(zip(means, places.texel, strict=True)):
        lobes = shown.lobes[index]
        narrow = texels.is_narrow(lobes, places.fine_rows)
        if bool(narrow.any()):
            grid = places.fine_rows, 2 * places.fine_rows
            own = texels.unit_texel_means(lobes.select(narrow), *grid)
            cells = coarsen(own, places.fine_rows, places.rows)
            values[narrow] = torch.cat([cells, own[:, texel]], dim=-1)
            found = True
    if not found:
        return shown
    return last(Images(shown.lobes, means, means, torch.ones_like(shown.scale)), frame)


def solve_amplitudes(shown: Images, frame: objective.Target, still: Tensor | None = None) -> Images:
    """Solve for the amplitudes alone, shapes held: the linear part of the problem.

    It is a non-negative least squares problem of the reweighted normal equations for each channel
    [Lawson and Hanson 1974].

    Args:
        shown: The lobes on the adaptive cells.
        frame: The maps and their weights.
        still: Which lobes keep their light.  [F, N]
    """
    amplitude = shown.lobes.amplitude
    near = amplitude.double()
    gram, slope = _normal_equations(shown, frame)
    right = gram @ near - slope  # the minimum lies where the slope at the amplitudes is undone
    free = torch.ones_like(shown.scale, dtype=torch.bool) if still is None else ~still
    # solved here, and brought here at once
    systems = zip(*(each.cpu() for each in (gram, right, near, free)), strict=True)
    solved = [_solved(*one) for one in systems]
    lobes = replace(shown.lobes, amplitude=torch.stack(solved).to(amplitude))
    return replace(shown, lobes=lobes)


def _normal_equations(shown: Images, frame: objective.Target) -> tuple[Tensor, Tensor]:
    """Return the Gauss-Newton matrix of the light of any channel, and J's slope, in float64.

    Args:
        shown: The lobes on the adaptive cells.
        frame: The maps and their weights.

    Returns:
        A W A^T [F, N, N], A the images of lobes of unit light and what materials show of them, and
        dJ / d amplitude [F, N, 3].
    """
    if compiled.serves(shown.lobes, frame.places):
        laid = frame.places.compiled, frame.compiled, tables(frame.places.rows)
        return compiled.light(shown, *laid)
    values = shown.values * shown.scale[..., None]
    views = probe(adaptive_cells.to_cells(values, frame.places), frame.places.rows)
    loss_gradient = objective.loss_gradient(shown.lobes.amplitude.mT @ values, frame)
    gram = _weighted_gram(values, loss_gradient.env_weight) + _weighted_gram(
        views, loss_gradient.view_weight
    )
    return gram, values.double() @ loss_gradient.slope.mT.double()


def _weighted_gram(images: Tensor, weight: Tensor) -> Tensor:
    """Return A W A^T in float64: lobes that coincide keep equal rows, whatever the order of sums.

    Args:
        images: A.  [F, N, P]
        weight: The diagonal of W.  [F, P]
    """
    rooted = (images * weight.sqrt()[:, None]).double()
    return rooted @ rooted.mT


def _solved(gram: Tensor, right: Tensor, near: Tensor, free: Tensor) -> Tensor:
    """Minimise a^T G a / 2 - a^T b over what is free of a, which stays at or above 0.

    Args:
        gram: G.  [N, N]
        right: b.  [N, 3]
        near: The amplitudes so far.  [N, 3]
        free: Which may change.  [N]
    """
    if bool(free.all()):
        return _non_negative(gram, right, near)
    found = near.clone()
    if bool(free.any()):
        rest = right[free] - gram[free][:, ~free] @ near[~free]
        found[free] = _non_negative(gram[free][:, free], rest, near[free])
    return found


def _non_negative(gram: Tensor, right: Tensor, near: Tensor) -> Tensor:
    """Minimise a^T G a / 2 - a^T b over a >= 0 for each channel, near to where a was.

    Lobes that coincide share a change evenly: the ridge, which pulls towards `near`, is as large
    as the rounding of images in float32, and grows where that is not enough.

    Args:
        gram: G.  [N, N]
        right: b.  [N, 3]
        near: The amplitudes so far.  [N, 3]
    """
    matrix, wanted, before = (each.cpu().numpy() for each in (gram, right, near))
    scale = 1 / np.sqrt(matrix.diagonal().clip(min=1e-300))  # to unit diagonal
    scaled = matrix * scale[:, None] * scale
    ridge = RIDGE
    while not _is_definite(ridged := scaled + ridge * np.eye(len(scaled))):
        ridge *= 10
        if ridge > 1:
            return near.clone()
    start = before / scale[:, None]
    pulled = wanted * scale[:, None] + ridge * start
    columns = zip(pulled.T, start.T, strict=True)
    solved = [non_negative_least_squares(ridged, *column) for column in columns]
    return torch.from_numpy(np.stack(solved, axis=-1) * scale[:, None]).to(gram)


def _is_definite(matrix: np.ndarray) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True
