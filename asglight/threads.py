# SPDX-License-Identifier: Apache-2.0
"""How many threads of the processor a part of the work computes on."""

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Compute on one thread: for tensors too small to share.

    A second thread gains nothing, and where other programs run the two wait for each other. Reading
    the next frame has the other core to itself.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
