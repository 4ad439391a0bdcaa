# SPDX-License-Identifier: Apache-2.0
"""The errors irr and r0.5 of a fit, fast enough to ask for after every fit.

They are those of asglight.judging: sum |change| / sum, over RGB and directions, of what Lambert's
cosine and GGX 0.5 show. There the map and the lobes are filtered texel by texel, here with the
probes of the fit (probes.py) on a grid fine enough that the two agree (`ALLOWANCE`).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting.loss import adaptive_cells, lobe_images
from asglight.fitting.loss.adaptive_cells import AdaptiveCells
from asglight.fitting.loss.grid import coarsen, coarser
from asglight.fitting.loss.probes import Probe, probe, shares, split
from asglight.lobes import Lobes
from asglight.shading import kernels

ROWS = 128
"""Rows of the grid, at most. On 64 rows a lamp's place within its cell is lost: where lamps have
hard edges the errors then come out at half their size."""

MEASURED = {"irr": Probe(kernels.LAMBERT, 1.0, 8), "r0.5": Probe(0.5, 1.0, 16)}
"""The errors and their probes, which look where those of the fit look."""

ALLOWANCE = 0.01
"""Share by which an error may be larger than it is measured here: on five real maps with 8 and 16
lobes r0.5 differs by 1 % at most from that of asglight.judging; irr, a fifth of it, by 5 %, and in
a room of hard lamps by 10 %."""


@dataclass(frozen=True)
class Shown:
    """What the probes show of a map.

    Attributes:
        rows: Rows of the grid on which it was filtered.
        views: Filtered radiance.  One [3, D] a probe
    """

    rows: int
    views: tuple[Tensor, ...]


def shown(reference: Tensor) -> Shown:
    """Filter a map.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
    """
    height = reference.shape[0]
    rows = coarser(height, ROWS)
    cells = coarsen(reference.movedim(-1, 0).flatten(1), height, rows)
    sources = tuple(MEASURED.values())
    return Shown(rows, split(probe(cells, rows, sources), rows, sources))


def errors(lobes: Lobes, reference: Shown) -> dict[str, float]:
    """Return the errors of the lobes of one frame, by name.

    A black map has no scale: its errors are 0 for black lobes and infinite otherwise.

    Args:
        lobes: In the units of the map.  [N, .]
        reference: What the probes show of the map.
    """
    sources, device = tuple(MEASURED.values()), str(reference.views[0].device)
    image = lobe_images.images(lobes[None].to(device), even_cells(reference.rows, device))
    found = split(probe(image.radiance[0], reference.rows, sources), reference.rows, sources)
    result = {}
    shared = split(shares(reference.rows, device, sources), reference.rows, sources)
    parts = zip(found, reference.views, shared, strict=True)
    for name, (view, wanted, share) in zip(MEASURED, parts, strict=True):
        change = float((view - wanted).abs().sum(0) @ share)
        whole = float(wanted.sum(0) @ share)
        result[name] = change / whole if whole > 0 else (0.0 if change == 0 else float("inf"))
    return result


def even_cells(rows: int, device: str) -> AdaptiveCells:
    """Return the cells of a grid as adaptive cells, none of them refined."""
    return adaptive_cells.adaptive_cells(
        torch.zeros(1, 3, 2 * rows * rows, device=device), rows, refined=0
    )
