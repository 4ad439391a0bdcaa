# SPDX-License-Identifier: Apache-2.0
"""What the fast fit minimises: the error of the map and of what three materials show of it.

    J = w_env sum omega phi(fit - ref) / sum omega |ref|
        + sum over probes k of w_k mean phi(K_k fit - K_k ref) / mean |K_k ref|

K_k filters the map with Lambert's cosine and with GGX lobes of roughness 0.5 and 0.25 at Fibonacci
directions: the diffuse loss of Clausen et al. 2024, asked at three widths. One more K is the mean
radiance; it weighs more than all else together, so no lobe gains by going dark. phi(r) =
sqrt(|r|^2 + eps^2) over RGB is the L1 norm with its corner rounded, so that the map's error weighs
as the metrics weigh it and the curvature stays finite. Its quadratic majoriser has the weight
1 / phi: iteratively reweighted least squares.

The probes see the map on coarse grids, for what they show is smooth at that scale.
"""

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from asglight.shading import kernels
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

ENV_WEIGHT = 0.5

ENV_CORNER = 0.3
"""phi's corner for the map, of the mean radiance: errors below a tenth count by their square."""


@dataclass(frozen=True)
class Probe:
    """One material that the fit must look right on.

    Attributes:
        kernel: `kernels.LAMBERT`, `kernels.EVEN` or a GGX roughness.
        weight: w_k.
        height: Rows of the grid it filters: its kernel is wider than four texels of it.
        directions: Fibonacci directions at which it looks; their spacing is below its width.
        corner: phi's corner, of the mean filtered radiance.
    """

    kernel: str | float
    weight: float
    height: int
    directions: int
    corner: float = 0.02


PROBES = (
    # a wide corner: a step may miss the flux by a percent, which the last scaling mends
    Probe(kernels.EVEN, 10.0, 32, 1, 0.2),
    Probe(kernels.LAMBERT, 4.0, 32, 160),
    Probe(0.5, 2.0, 32, 256),
    Probe(0.25, 1.0, 64, 640),
)


@dataclass(frozen=True)
class Target:
    """One frame on one grid, with everything of J that does not depend on the lobes.

    Attributes:
        radiance: Reference on the grid.  [P, 3]
        directions: Texel centres.  [P, 3]
        height: Rows of the grid; it has twice as many columns.
        env_weight: w_env omega / sum omega |ref|.  [P]
        env_corner: eps of the map.
        probed: The probes' view of the reference.  One [D, 3] a probe.
        probe_weight: w_k / (D mean |K_k ref|), a number a probe.
        probe_corner: eps, a number a probe.
    """

    radiance: Tensor
    directions: Tensor
    height: int
    env_weight: Tensor
    env_corner: float
    probed: tuple[Tensor, ...]
    probe_weight: tuple[float, ...]
    probe_corner: tuple[float, ...]


def target(reference: Tensor) -> Target:
    """Prepare J for a map on its own grid.  reference: [H, 2 H, 3]."""
    height, width, _ = reference.shape
    device = reference.device
    solid_angle = latlong.texel_solid_angles(height, width, device=device).reshape(-1)
    radiance = reference.reshape(-1, 3)
    total = (solid_angle * radiance.norm(dim=-1)).sum().clamp(min=torch.finfo(torch.float32).tiny)
    probed = probe(radiance.mT, height)
    scales = [max(float(view.norm(dim=0).mean()), 1e-37) for view in probed]
    return Target(
        radiance=radiance,
        directions=latlong.directions(height, width, device=device).reshape(-1, 3),
        height=height,
        env_weight=ENV_WEIGHT * solid_angle / total,
        env_corner=ENV_CORNER * float(total) / (4 * torch.pi),
        probed=tuple(view.mT for view in probed),
        probe_weight=tuple(
            p.weight / (p.directions * scale) for p, scale in zip(PROBES, scales, strict=True)
        ),
        probe_corner=tuple(p.corner * scale for p, scale in zip(PROBES, scales, strict=True)),
    )


def probe(columns: Tensor, height: int) -> tuple[Tensor, ...]:
    """Filter images with every probe.

    Args:
        columns: Images on a grid of `height` rows.  [M, P]
        height: Rows of that grid.

    Returns:
        What each probe shows of each image.  One [M, D] a probe.
    """
    on_grid = {height: columns}
    for needed in sorted({p.height for p in PROBES}, reverse=True):
        if needed < height:
            finer = min(h for h in on_grid if h > needed)
            on_grid[needed] = _coarsen(on_grid[finer], finer, needed)
    return tuple(
        on_grid[min(p.height, height)]
        @ _probe_matrix(p, min(p.height, height), str(columns.device)).mT
        for p in PROBES
    )


def _coarsen(columns: Tensor, height: int, coarse: int) -> Tensor:
    """Average images onto a coarser grid, weighted by solid angle.  [M, P] -> [M, P']."""
    count, factor = columns.shape[0], height // coarse
    if height % coarse:
        images = columns.reshape(count, height, 2 * height).permute(1, 2, 0)
        return latlong.reduce(images, coarse, 2 * coarse).reshape(-1, count).mT
    rows = latlong.texel_solid_angles(height, 1, device=columns.device).reshape(coarse, factor)
    rows = rows / (factor * rows.sum(-1, keepdim=True))
    along_rows = columns.reshape(count, coarse, factor, 2 * coarse, factor).sum(-1)
    return (along_rows * rows[:, :, None]).sum(2).reshape(count, -1)


@lru_cache(maxsize=16)
def _probe_matrix(source: Probe, height: int, device: str) -> Tensor:
    """Return the filter of one probe as a matrix over the texels of a grid.  [D, P]."""
    texels = latlong.directions(height, 2 * height).reshape(-1, 3)
    cosine = fibonacci_directions(source.directions) @ texels.mT
    weight = kernels.kernel_values(source.kernel, cosine)
    weight = weight * latlong.texel_solid_angles(height, 2 * height).reshape(-1)
    return (weight / weight.sum(-1, keepdim=True)).to(device)


def value(radiance: Tensor, frame: Target) -> float:
    """Return J of a reconstructed map, less its constant: 0 for a perfect fit.

    Args:
        radiance: The reconstruction.  [P, 3]
        frame: The map and its weights.
    """
    env = phi(radiance - frame.radiance, frame.env_corner) - frame.env_corner
    total = float((frame.env_weight * env).sum())
    views = probe(radiance.mT, frame.height)
    for view, reference, weight, corner in zip(
        views, frame.probed, frame.probe_weight, frame.probe_corner, strict=True
    ):
        total += weight * float((phi(view.mT - reference, corner) - corner).sum())
    return total


def phi(residual: Tensor, corner: float) -> Tensor:
    """Return sqrt(|r|^2 + eps^2) over RGB.  [..., 3] -> [...]."""
    # the tiny term keeps a black map's exact zero residual from a division 0 / 0
    return (residual.square().sum(-1) + corner**2 + 1e-37).sqrt()
