# SPDX-License-Identifier: Apache-2.0
"""Where frames are compared: coarse cells everywhere, texels where the map has detail.

A map of 256 x 512 texels is mostly smooth at the scale of a lobe. Its adaptive cells are the cells
of a coarse grid, and in the few cells with most detail and light the texels themselves, so that a
sun of one texel is one. The materials see the coarse grid, to which refined cells bring their
texels' light each to its own place (splatting.py).

Images on adaptive cells are [F, ..., P]: first all cells in order, then the texels cell by cell. A
refined cell keeps its place among the cells, with no share of the sphere. Dimension letters: F
frames, C cells, R refined cells of one frame, Q their texels, P = C + Q.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from asglight.fitting.compiled import layout
from asglight.fitting.loss import splatting
from asglight.fitting.loss.grid import Grid, cell_sums, coarsen, coarser, grid, repeated

BASE_ROWS = 64
"""Rows of the coarse grid: a cell of 2.8 degrees, half the width of what GGX 0.25 shows of a
point."""

REFINED = 64
"""Cells of a frame that are refined. On five real maps 64 and 512 end at the same errors."""

BRIGHT = 0.2
"""What a cell's light counts beside its detail when refined cells are chosen. A wide lamp is even
inside, but the narrow lobes that make it up are not: on its cells they would look as even as it."""


@dataclass(frozen=True)
class AdaptiveCells:
    """The adaptive cells of F frames.

    Attributes:
        rows: Rows of the coarse grid.
        fine_rows: Rows of the map.
        refined: The refined cells.  [F, R]
        texel: Their texels, cell by cell.  [F, Q]
        monomials: Of the texels' centres, in the order of `grid.POWERS`.  [F, 10, Q]
        cell_share: Solid angle over 4 pi of each cell, 0 where refined.  [F, C]
        texel_share: Solid angle over 4 pi of each texel.  [F, Q]
        around: The cells that the light of each refined cell reaches.  [F, 25 R]
    """

    rows: int
    fine_rows: int
    refined: Tensor
    texel: Tensor
    monomials: Tensor
    cell_share: Tensor
    texel_share: Tensor
    around: Tensor

    @property
    def cells(self) -> Grid:
        """The coarse grid."""
        return grid(self.rows, str(self.refined.device))

    @property
    def count(self) -> int:
        """C, the number of cells."""
        return 2 * self.rows**2

    @property
    def levels(self) -> tuple[tuple[int, Tensor, slice], ...]:
        """Rows, monomials and place of the coarse cells and, if any, of the texels."""
        coarse = (self.rows, self.cells.monomials, slice(0, self.count))
        if not self.texel.shape[-1]:
            return (coarse,)
        return (coarse, (self.fine_rows, self.monomials, slice(self.count, None)))

    @property
    def directions(self) -> Tensor:
        """Centres of the adaptive cells.  [F, 3, P]."""
        cells = self.cells.monomials[1:4].expand(len(self.refined), -1, -1)
        return torch.cat([cells, self.monomials[:, 1:4]], dim=-1)

    @property
    def share(self) -> Tensor:
        """Solid angle over 4 pi of each adaptive cell.  [F, P]."""
        return torch.cat([self.cell_share, self.texel_share], dim=-1)

    @cached_property
    def compiled(self) -> layout.Adaptive:
        """The adaptive cells for what is compiled."""
        return layout.adaptive_cells(self)

    def repeated(self, count: int) -> "AdaptiveCells":
        """Return the adaptive cells of one frame as those of many.  F = 1 -> F = count."""
        tensors = {
            name: value.expand(count, *value.shape[1:])
            for name, value in vars(self).items()
            if isinstance(value, Tensor)
        }
        return replace(self, **tensors)


def adaptive_cells(
    reference: Tensor, rows: int = BASE_ROWS, refined: int = REFINED
) -> AdaptiveCells:
    """Choose the adaptive cells of each frame: refined are cells with much detail or much light.

    Detail is how far the cell's texels are from their mean.

    Args:
        reference: Radiance on the map's grid.  [F, 3, H * 2 H]
        rows: Rows of the coarse grid, about.
        refined: R, at most.
    """
    fine_rows = round((reference.shape[-1] / 2) ** 0.5)
    rows = coarser(fine_rows, rows)
    if rows == fine_rows:
        refined = 0
    device = str(reference.device)
    fine, coarse = grid(fine_rows, device), grid(rows, device)
    chosen = reference.new_zeros(len(reference), 0, dtype=torch.long)
    if refined:
        mean = repeated(coarsen(reference, fine_rows, rows), rows, fine_rows)
        worth = ((reference - mean).abs() + BRIGHT * reference).sum(1) * fine.share
        worth = cell_sums(worth, fine_rows, rows)
        chosen = worth.topk(min(refined, worth.shape[-1]), dim=-1).indices
    texel = _texels_of(chosen, rows, fine_rows)
    return AdaptiveCells(
        rows=rows,
        fine_rows=fine_rows,
        refined=chosen,
        texel=texel,
        monomials=fine.monomials[:, texel].movedim(0, 1).contiguous(),
        cell_share=coarse.share.repeat(len(reference), 1).scatter_(1, chosen, 0.0),
        texel_share=fine.share[texel],
        around=splatting.neighbours(chosen, rows),
    )


def _texels_of(cells: Tensor, rows: int, fine_rows: int) -> Tensor:
    """Return the texels of cells, cell by cell.  [F, R] -> [F, Q]."""
    factor = fine_rows // rows
    offset = torch.arange(factor, device=cells.device)
    row, column = cells // (2 * rows) * factor, cells % (2 * rows) * factor
    texel = (row[..., None, None] + offset[:, None]) * (2 * fine_rows)
    return (texel + column[..., None, None] + offset).flatten(1)


def on_adaptive_cells(images: Tensor, places: AdaptiveCells) -> Tensor:
    """Average images on the map's grid over each adaptive cell.  [F, K, H * 2 H] -> [F, K, P]."""
    cells = coarsen(images, places.fine_rows, places.rows)
    texels = images.gather(-1, places.texel[:, None].expand(-1, images.shape[1], -1))
    return torch.cat([cells, texels], dim=-1)


def to_cells(images: Tensor, places: AdaptiveCells) -> Tensor:
    """Bring images on adaptive cells to the cells' centres.  [F, K, P] -> [F, K, C]."""
    if not places.texel.shape[-1]:
        return images
    cells, texels = images[..., : places.count], images[..., places.count :]
    cells = cells.scatter(-1, _each(places.refined, images), 0.0)
    weights = splatting.weights(places.fine_rows // places.rows, str(images.device))
    flux = (texels * places.texel_share[:, None]).unflatten(-1, (-1, len(weights)))
    brought = (flux @ weights.to(flux)).flatten(-2) / _shares_around(places)
    return cells.scatter_add(-1, _each(places.around, images), brought)


def from_cells(slopes: Tensor, places: AdaptiveCells) -> Tensor:
    """Apply the transpose of `to_cells`.  [F, K, C] -> [F, K, P]."""
    if not places.texel.shape[-1]:
        return slopes
    weights = splatting.weights(places.fine_rows // places.rows, str(slopes.device))
    around = slopes.gather(-1, _each(places.around, slopes)) / _shares_around(places)
    around = around.unflatten(-1, (-1, weights.shape[-1]))
    texels = (around @ weights.to(around).mT).flatten(-2) * places.texel_share[:, None]
    cells = slopes.scatter(-1, _each(places.refined, slopes), 0.0)
    return torch.cat([cells, texels], dim=-1)


def _shares_around(places: AdaptiveCells) -> Tensor:
    """Return solid angles over 4 pi, for each image of a frame.  [F, 1, 25 R]."""
    return places.cells.share[places.around][:, None]


def _each(index: Tensor, images: Tensor) -> Tensor:
    """Repeat an index for each image of a frame.  [F, R] -> [F, K, R]."""
    return index[:, None].expand(-1, images.shape[1], -1)
