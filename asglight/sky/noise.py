# SPDX-License-Identifier: Apache-2.0
"""Seeded gradient noise in three dimensions (Perlin 2002, "Improving Noise"), and its octaves."""

import torch
from torch import Tensor

_LATTICE = 256
"""Period of the noise in lattice cells; the cloud spans a few, so no repeat is ever seen."""


def fractal(points: Tensor, seed: int, octaves: int = 5) -> Tensor:
    """Sum octaves of gradient noise, each of half the size and half the strength.

    Args:
        points: Float64 coordinates; the largest features have size 1.  [..., 3]
        seed: Any integer; the same seed gives the same noise on every machine.
        octaves: Number of octaves.

    Returns:
        About -1 to 1, mean 0, twice differentiable.  [...]
    """
    table, gradients = _tables(seed)
    total = torch.zeros(points.shape[:-1], dtype=points.dtype)
    for octave in range(octaves):
        # The offset keeps the zeros of the octaves, which lie on lattice points, apart.
        shifted = points * 2.0**octave + 17.31 * octave
        total = total + 0.5**octave * _gradient_noise(shifted, table, gradients)
    return total


def _tables(seed: int) -> tuple[Tensor, Tensor]:
    """Return a permutation [256] and unit gradients [256, 3]."""
    generator = torch.Generator().manual_seed(seed)
    table = torch.randperm(_LATTICE, generator=generator)
    gradients = torch.randn(_LATTICE, 3, generator=generator, dtype=torch.float64)
    return table, gradients / gradients.norm(dim=-1, keepdim=True)


def _gradient_noise(points: Tensor, table: Tensor, gradients: Tensor) -> Tensor:
    """Blend the ramps of the eight lattice corners with a quintic.  [..., 3] -> [...]."""
    corner = points.floor()
    offset = points - corner
    cell = corner.long() % _LATTICE
    blend = offset**3 * (offset * (offset * 6 - 15) + 10)
    total = torch.zeros(points.shape[:-1], dtype=points.dtype)
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                step = torch.tensor((i, j, k))
                x, y, z = ((cell + step) % _LATTICE).unbind(-1)
                index = table[(table[(table[x] + y) % _LATTICE] + z) % _LATTICE]
                ramp = (gradients[index] * (offset - step)).sum(-1)
                weight = torch.where(step.bool(), blend, 1 - blend).prod(-1)
                total = total + weight * ramp
    return total
