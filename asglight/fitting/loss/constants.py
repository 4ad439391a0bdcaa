# SPDX-License-Identifier: Apache-2.0
"""Constants on the device where a fit computes.

A step that brought its constants along would copy them from the host each time, which a GPU waits
for and no graph of a step may hold.
"""

from functools import lru_cache

import torch
from torch import Tensor


@lru_cache(maxsize=64)
@torch.inference_mode(False)
def constant(values: tuple[float, ...], device: torch.device, dtype: torch.dtype) -> Tensor:
    """Return some numbers as a tensor, the same one each time; nobody writes to it.

    Args:
        values: The numbers.
        device: Where.
        dtype: As what.
    """
    return torch.tensor(values, device=device, dtype=dtype)


def like(tensor: Tensor, *values: float) -> Tensor:
    """Return some numbers as a tensor of the kind of another, on its device.

    Args:
        tensor: The other.
        values: The numbers.
    """
    return constant(values, tensor.device, tensor.dtype)
