# SPDX-License-Identifier: Apache-2.0
"""Evenly spread directions."""

import math

import torch
from torch import Tensor


def fibonacci_directions(count: int, *, dtype: torch.dtype = torch.float32) -> Tensor:
    """Return `count` directions on a golden-angle spiral from +Y to -Y, each of equal area.

    Heights are (i + 1/2) / count, turns are multiples of the golden angle
    [Swinbank and Purser 2006, "Fibonacci grids: a novel approach to global modelling"].

    Returns:
        Unit directions.  [P, 3]
    """
    index = torch.arange(count, dtype=torch.float64)
    y = 1 - (2 * index + 1) / count
    turn = math.pi * (3 - math.sqrt(5)) * index
    radius = (1 - y * y).sqrt()
    spiral = torch.stack([radius * torch.cos(turn), y, radius * torch.sin(turn)], dim=-1)
    return spiral.to(dtype)
