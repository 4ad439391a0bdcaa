# SPDX-License-Identifier: Apache-2.0
"""What the fast fit minimises: the error of the map and of what three materials show of it.

    J = w_env mean phi(fit - ref) / mean |ref|
        + sum over probes k of w_k mean phi(K_k fit - K_k ref) / mean |K_k ref|

with means over the sphere. K_k filters the map with Lambert's cosine and with GGX lobes of
roughness 0.5 and 0.25 (probes.py): the diffuse loss of Clausen et al. 2024, asked at three widths.
One more K is the mean radiance; it weighs more than all else together, so no lobe gains by going
dark. phi(r) = sqrt(|r|^2 + eps^2) over RGB is the L1 norm with its corner rounded, so that the
map's error weighs as the metrics weigh it and the curvature stays finite. Its quadratic majoriser
has the weight 1 / phi: iteratively reweighted least squares.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting.grid import Grid, grid, spread
from asglight.fitting.probes import PROBES, probe, probe_rows, pull, shares
from asglight.shading import kernels

ENV_WEIGHT = 0.5

SCALE_MIN = 1e-12
"""Of a mean, so that a black map's loss is finite. Maps come with a mean near 1."""

EVEN_CORNER = 0.2
"""phi's corner for the mean radiance, of itself: wide, for a step may miss the flux by a percent,
which the last scaling mends."""


@dataclass(frozen=True)
class Corners:
    """phi's corners: errors below them count by their square.

    Attributes:
        env: For the map, of its mean radiance.
        probe: For a material, of its mean filtered radiance.
    """

    env: float = 0.1
    probe: float = 0.01


@dataclass(frozen=True)
class Target:
    """One frame on one grid, with everything of J that does not depend on the lobes.

    Attributes:
        radiance: Reference on the grid.  [3, P]
        height: Rows of the grid.
        env_weight: w_env over mean |ref|.  []
        env_corner: eps of the map.  []
        probe_weight: w_k over mean |K_k ref| of each probe.  [K]
        probe_corner: eps of each probe.  [K]
    """

    radiance: Tensor
    height: int
    env_weight: Tensor
    env_corner: Tensor
    probe_weight: Tensor
    probe_corner: Tensor

    @property
    def grid(self) -> Grid:
        """The grid."""
        return grid(self.height, str(self.radiance.device))


@dataclass(frozen=True)
class Misfit:
    """How J changes with a reconstruction.

    Attributes:
        slope: dJ / d radiance.  [3, P]
        env_weight: Weight of each texel's square in J's majoriser.  [P]
        probe_weights: The same for each probe's views.  One [D] a probe.
    """

    slope: Tensor
    env_weight: Tensor
    probe_weights: tuple[Tensor, ...]


def target(reference: Tensor, corners: Corners = Corners()) -> Target:
    """Prepare J for a map on its own grid.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        corners: phi's corners.
    """
    height = reference.shape[0]
    radiance = reference.permute(2, 0, 1).reshape(3, -1).contiguous()
    share = grid(height, str(reference.device)).share
    mean = (share * radiance.norm(dim=0)).sum().clamp(min=SCALE_MIN)
    device = str(reference.device)
    scales = [
        (share * view.norm(dim=0)).sum()
        for view, share in zip(probe(radiance, height), shares(height, device), strict=True)
    ]
    scale = torch.stack(scales).clamp(min=SCALE_MIN)
    weights = scale.new_tensor([p.weight for p in PROBES])
    rounded = [EVEN_CORNER if p.kernel == kernels.EVEN else corners.probe for p in PROBES]
    return Target(
        radiance=radiance,
        height=height,
        env_weight=ENV_WEIGHT / mean,
        env_corner=corners.env * mean,
        probe_weight=weights / scale,
        probe_corner=scale.new_tensor(rounded) * scale,
    )


def value(radiance: Tensor, frame: Target) -> Tensor:
    """Return J, less its constant: 0 for a perfect fit.  radiance: [3, P]; result []."""
    residual = radiance - frame.radiance
    size = phi(residual, frame.env_corner)
    total = frame.env_weight * ((frame.grid.share * size).sum() - frame.env_corner)
    views = probe(residual, frame.height)
    for index, share in enumerate(shares(frame.height, str(radiance.device))):
        corner = frame.probe_corner[index]
        size = phi(views[index], corner)
        total = total + frame.probe_weight[index] * ((share * size).sum() - corner)
    return total


def misfit(radiance: Tensor, frame: Target) -> Misfit:
    """Return the slope of J and the weights of its majoriser for a reconstructed map."""
    residual = radiance - frame.radiance
    env_weight = frame.env_weight * frame.grid.share / phi(residual, frame.env_corner)
    slope = residual * env_weight
    by_rows: dict[int, Tensor] = {}
    weights: list[Tensor] = []
    views = probe(residual, frame.height)
    for index, share in enumerate(shares(frame.height, str(radiance.device))):
        size = phi(views[index], frame.probe_corner[index])
        weights.append(frame.probe_weight[index] * share / size)
        source, rows = PROBES[index], probe_rows(PROBES[index], frame.height)
        pulled = pull(views[index] * weights[-1], source, rows)
        by_rows[rows] = by_rows[rows] + pulled if rows in by_rows else pulled
    for rows, pulled in by_rows.items():
        slope = slope + spread(pulled, rows, frame.height)
    return Misfit(slope, env_weight, tuple(weights))


def phi(residual: Tensor, corner: Tensor | float) -> Tensor:
    """Return sqrt(|r|^2 + eps^2) over RGB.  [..., 3, P] -> [..., P]."""
    return (residual.square().sum(-2) + corner * corner).sqrt()
