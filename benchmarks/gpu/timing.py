# SPDX-License-Identifier: Apache-2.0
"""Seconds of what a device does."""

import time
from collections.abc import Callable
from typing import TypeVar

import torch

Found = TypeVar("Found")


def seconds_of(call: Callable[[], Found], device: str) -> tuple[Found, float]:
    """Return what a call returns, and the seconds until the device has done all of it."""
    finish(device)
    begin = time.perf_counter()
    found = call()
    finish(device)
    return found, time.perf_counter() - begin


def finish(device: str) -> None:
    """Wait until a device has done all that was started on it."""
    if device.startswith("cuda"):
        torch.cuda.synchronize(device)
