# SPDX-License-Identifier: Apache-2.0
"""Starts of many maps: the functions of seeding.py, compiled map by map, or by `torch.vmap`."""

from collections.abc import Sequence

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.first_frame import seeding
from asglight.fitting.first_frame.seeding import Cells
from asglight.lobes import Form, Lobes
from asglight.lobes.data import stack


def seeds_of_each(
    sources: Sequence[Cells], count: int, form: Form, spread_deg: float | None
) -> Lobes:
    """Return `seeding.seed_lobes` of each map.  [F, N, .].

    Args:
        sources: The cells of each map, as many as it has.
        count: N.
        form: Lobe function.
        spread_deg: Of the cut into clusters; None for no cut, but even directions.
    """
    if compiled.mixes(sources[0].weight):
        return stack([seeding.seed_lobes(each, count, form, spread_deg) for each in sources])
    least = sources[0].variance_min

    def of_one(flux: Tensor, weight: Tensor, mean: Tensor, second: Tensor) -> tuple[Tensor, ...]:
        source = Cells(flux, weight, mean, second, least)
        found = seeding.seed_lobes(source, count, form, spread_deg)
        return found.axes, found.sharpness, found.amplitude

    axes, sharpness, amplitude = torch.vmap(of_one)(*padded(sources))
    return Lobes(axes, sharpness, amplitude, form)


def padded(sources: Sequence[Cells]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return flux, weight, mean and second of maps, each with as many cells as the one with most.

    Cells that are added have no weight, and a direction, so that nothing divides by its length.

    Args:
        sources: The cells of each map.

    Returns:
        [F, C, 3], [F, C], [F, C, 3] and [F, C, 3, 3].
    """
    most = max(len(source.weight) for source in sources)

    def alike(tensors: list[Tensor]) -> Tensor:
        room = tensors[0].new_zeros(len(tensors), most, *tensors[0].shape[1:])
        for own, tensor in zip(room, tensors, strict=True):
            own[: len(tensor)] = tensor
        return room

    flux, weight, mean, second = (
        alike([getattr(source, name) for source in sources])
        for name in ("flux", "weight", "mean", "second")
    )
    mean[..., 2] += weight == 0
    return flux, weight, mean, second
