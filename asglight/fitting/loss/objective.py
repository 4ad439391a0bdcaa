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

The map's error is taken on adaptive cells (adaptive_cells.py): a cell's is the mean over the parts
it is cut into, for lobes are smooth at its scale but the map is not.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.compiled import layout
from asglight.fitting.loss import adaptive_cells
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.grid import coarsen, coarser
from asglight.fitting.loss.probes import PROBES, of_views, probe, pull, shares, split, tables
from asglight.shading import kernels

ENV_WEIGHT = 0.07
"""w_env: what surfaces show comes first. Over ten maps 0.05 and 0.07 end alike; with 0.1 irr and
r0.5 are a tenth larger in the median, with 0.2 irr a third on single maps; env is up to a tenth
smaller then."""

SCALE_MIN = 1e-12
"""Of a mean, so that a black map's loss is finite. Maps come with a mean near 1."""

EVEN_CORNER = 0.2
"""phi's corner for the mean radiance, of itself: wide, for a step may miss the flux by a percent,
which the last scaling mends."""

PARTS = 2
"""Parts along a side of a cell, 1.4 degrees each on a grid of 64 rows: more gain little on real
maps."""


TRIAL_ROWS = 32
"""Rows of the grid of cells on which lobes compete: it tells them apart as well as a finer one."""

TRIAL_REFINED = 16
"""Cells that are refined there; with 64 a map of 128 rows has twice as many adaptive cells."""

TRIAL_FINE_ROWS = 128
"""Rows of the texels in those, at most: a lamp's place is known well enough to choose."""


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
    """F frames on their adaptive cells, with everything of J that does not depend on the lobes.

    Attributes:
        places: The adaptive cells.
        radiance: Reference on the adaptive cells.  [F, 3, P]
        parts: Reference on the K parts of each cell.  [F, K, 3, C]
        env_scale: mean |ref|.  [F]
        views: What the probes show of the reference.  [F, 3, D]
        probe_scale: mean |K_k ref| of each probe.  [F, K']
        view_weight: Weight of each view in J: w_k and its share of the sphere over that.  [F, D]
        corners: phi's corners.
        env_weight: w_env.
    """

    places: AdaptiveCells
    radiance: Tensor
    parts: Tensor
    env_scale: Tensor
    views: Tensor
    probe_scale: Tensor
    view_weight: Tensor
    corners: Corners
    env_weight: float = ENV_WEIGHT

    @property
    def env_corner(self) -> Tensor:
        """Eps of the map.  [F]."""
        return self.corners.env * self.env_scale

    @property
    def view_corner(self) -> Tensor:
        """Eps of each view.  [F, D]."""
        device = str(self.probe_scale.device)
        corners = _probe_corners(self.corners.probe, device) * self.probe_scale
        return of_views(corners, self.places.rows)

    @cached_property
    def compiled(self) -> layout.Target:
        """The frames for what is compiled."""
        return layout.target(self, _probe_corners(self.corners.probe, "cpu"))

    def with_weights(self, env: float, probes: Sequence[float]) -> "Target":
        """Return the frames with every weight of J times a factor.

        Args:
            env: Of w_env.
            probes: Of the w_k, one for each of `PROBES`.
        """
        factor = of_views(self.view_weight.new_tensor([*probes])[None], self.places.rows)
        return replace(
            self, env_weight=env * self.env_weight, view_weight=factor * self.view_weight
        )

    def repeated(self, count: int) -> "Target":
        """Return one frame as many, for lobes that compete for it.  F = 1 -> F = count."""
        tensors = {
            name: value.expand(count, *value.shape[1:])
            for name, value in vars(self).items()
            if isinstance(value, Tensor)
        }
        return replace(self, places=self.places.repeated(count), **tensors)


@dataclass(frozen=True)
class LossTerms:
    """phi of every error of a reconstruction, and J, which is a sum of them.

    Attributes:
        value: J, less its constant: 0 for a perfect fit.  [F]
        parts: phi on the parts of each cell.  [F, K, C]
        texels: phi on the texels.  [F, Q]
        views: What the probes show wrong.  [F, 3, D]
        seen: phi of that.  [F, D]
    """

    value: Tensor
    parts: Tensor
    texels: Tensor
    views: Tensor
    seen: Tensor


@dataclass(frozen=True)
class LossGradient:
    """How J of a reconstruction changes.

    Attributes:
        slope: dJ / d radiance.  [F, 3, P]
        env_weight: Weight of each adaptive cell's square in J's majoriser.  [F, P]
        view_weight: The same for each view of the probes.  [F, D]
    """

    slope: Tensor
    env_weight: Tensor
    view_weight: Tensor


def target(
    reference: Tensor, corners: Corners = Corners(), places: AdaptiveCells | None = None
) -> Target:
    """Prepare J for maps.

    Args:
        reference: Repaired radiance.  [F, 3, H * 2 H]
        corners: phi's corners.
        places: The adaptive cells; chosen by the map's detail if None.
    """
    places = adaptive_cells.adaptive_cells(reference) if places is None else places
    radiance = adaptive_cells.on_adaptive_cells(reference, places)
    parts = _parts(reference, places)
    texels = radiance[..., places.count :]
    env_scale = (places.cell_share * _size(parts).mean(1)).sum(-1)
    env_scale = env_scale + (places.texel_share * _size(texels)).sum(-1)
    views = probe(adaptive_cells.to_cells(radiance, places), places.rows)
    shared = shares(places.rows, str(reference.device))
    sums = [size.sum(-1) for size in split(shared * _size(views), places.rows)]
    probe_scale = torch.stack(sums, dim=-1).clamp(min=SCALE_MIN)
    weights = reference.new_tensor([source.weight for source in PROBES])
    return Target(
        places,
        radiance,
        parts,
        env_scale.clamp(min=SCALE_MIN),
        views,
        probe_scale,
        shared * of_views(weights / probe_scale, places.rows),
        corners,
    )


def trial_target(reference: Tensor, corners: Corners = Corners()) -> Target:
    """Prepare J on few adaptive cells, for lobes that compete.

    Args:
        reference: Repaired radiance.  [F, 3, H * 2 H]
        corners: phi's corners.
    """
    height = round((reference.shape[-1] / 2) ** 0.5)
    rows = coarser(height, TRIAL_FINE_ROWS)
    reference = coarsen(reference, height, rows)
    return target(
        reference, corners, adaptive_cells.adaptive_cells(reference, TRIAL_ROWS, TRIAL_REFINED)
    )


def less(frame: Target, radiance: Tensor) -> Target:
    """Return what some lobes leave to others: J of the others against it is J of all.

    Args:
        frame: The maps; sizes, views and weights stay theirs.
        radiance: What those lobes show on the adaptive cells.  [F, 3, P]
    """
    cells = radiance[:, None, :, : frame.places.count]
    return replace(frame, radiance=frame.radiance - radiance, parts=frame.parts - cells)


def _parts(reference: Tensor, places: AdaptiveCells) -> Tensor:
    """Return means over the parts of each cell.  [F, 3, H * 2 H] -> [F, K, 3, C]."""
    finer = places.fine_rows // places.rows
    factor = max(f for f in range(1, PARTS + 1) if finer % f == 0)
    means = coarsen(reference, places.fine_rows, places.rows * factor)
    blocks = means.unflatten(-1, (places.rows, factor, 2 * places.rows, factor))
    return blocks.permute(0, 3, 5, 1, 2, 4).flatten(-2).flatten(1, 2).contiguous()


def value(radiance: Tensor, frame: Target) -> Tensor:
    """Return J, less its constant: 0 for a perfect fit.  [F, 3, P] -> [F]."""
    return loss_terms(radiance, frame).value


def loss_terms(radiance: Tensor, frame: Target) -> LossTerms:
    """Return J of reconstructions, with the sizes of all errors in it.  [F, 3, P]."""
    if compiled.looks(radiance, frame.places):
        probes = tables(frame.places.rows)
        return LossTerms(
            *compiled.loss_terms(radiance, frame.places.compiled, frame.compiled, probes)
        )
    places, cells = frame.places, frame.places.count
    part = radiance[:, None, :, :cells] - frame.parts
    parts = phi(part, frame.env_corner[:, None, None])  # [F, K, C]
    error = (places.cell_share * parts.mean(1)).sum(-1)
    residual = radiance - frame.radiance
    texels = phi(residual[..., cells:], frame.env_corner[:, None])
    if places.texel.shape[-1]:
        error = error + (places.texel_share * texels).sum(-1)
    views = probe(adaptive_cells.to_cells(residual, places), places.rows)
    seen = phi(views, frame.view_corner)
    total = frame.env_weight * (error / frame.env_scale - frame.corners.env)
    return LossTerms(total + of_materials(seen, frame), parts, texels, views, seen)


def of_materials(seen: Tensor, frame: Target) -> Tensor:
    """Return J's part of what materials show wrong, all but the map's own.

    Args:
        seen: `LossTerms.seen` of reconstructions.  [F, D]
        frame: The maps.

    Returns:
        Less its constant.  [F]
    """
    return (frame.view_weight * (seen - frame.view_corner)).sum(-1)


def loss_gradient(radiance: Tensor, frame: Target, terms: LossTerms | None = None) -> LossGradient:
    """Return the slope of J and the weights of its majoriser for reconstructions.

    Args:
        radiance: Reconstructions on the adaptive cells.  [F, 3, P]
        frame: The maps.
        terms: Their `loss_terms`, where they are known.
    """
    terms = terms or loss_terms(radiance, frame)
    if compiled.looks(radiance, frame.places):
        laid = frame.places.compiled, frame.compiled, tables(frame.places.rows)
        return LossGradient(*compiled.loss_gradient(radiance, terms, *laid))
    places, cells = frame.places, frame.places.count
    share = places.share * (frame.env_weight / frame.env_scale)[:, None]
    part = radiance[:, None, :, :cells] - frame.parts
    weight = share[:, None, :cells] / (terms.parts.shape[1] * terms.parts)
    slope, env_weight = (part * weight[:, :, None]).sum(1), weight.sum(1)
    if places.texel.shape[-1]:
        weight = share[:, cells:] / terms.texels
        residual = radiance[..., cells:] - frame.radiance[..., cells:]
        slope = torch.cat([slope, residual * weight[:, None]], dim=-1)
        env_weight = torch.cat([env_weight, weight], dim=-1)
    view_weight = frame.view_weight / terms.seen
    pulled = pull(terms.views * view_weight[:, None], places.rows)
    return LossGradient(slope + adaptive_cells.from_cells(pulled, places), env_weight, view_weight)


@lru_cache(maxsize=16)
@torch.inference_mode(False)
def _probe_corners(corner: float, device: str) -> Tensor:
    """Return phi's corner for each probe, of its mean.  [K']."""
    corners = [EVEN_CORNER if each.kernel == kernels.EVEN else corner for each in PROBES]
    return torch.tensor(corners, dtype=torch.float32, device=device)


def per_cell_loss(radiance: Tensor, frame: Target) -> Tensor:
    """Lay J out on the adaptive cells: what a probe shows wrong goes to where its light comes from.

    Args:
        radiance: Reconstructions on the adaptive cells.  [F, 3, P]
        frame: The maps; parts of cells count as one here.

    Returns:
        Each adaptive cell's part of J.  [F, P]
    """
    corner = frame.env_corner[:, None]
    residual = radiance - frame.radiance
    error = frame.places.share * (phi(residual, corner) - corner)
    total = error * (frame.env_weight / frame.env_scale)[:, None]
    views = probe(adaptive_cells.to_cells(residual, frame.places), frame.places.rows)
    corner = frame.view_corner
    lying = frame.view_weight * (phi(views, corner) - corner)
    pulled = pull(lying[:, None], frame.places.rows)
    return total + adaptive_cells.from_cells(pulled, frame.places)[:, 0]


def _size(images: Tensor) -> Tensor:
    """Return the norm over RGB.  [..., 3, P] -> [..., P]."""
    return images.square().sum(-2).sqrt()


def phi(residual: Tensor, corner: Tensor) -> Tensor:
    """Return sqrt(|r|^2 + eps^2) over RGB.  [..., 3, P] -> [..., P]."""
    return (residual.square().sum(-2) + corner * corner).sqrt()
