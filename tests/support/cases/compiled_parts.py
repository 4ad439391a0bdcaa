# SPDX-License-Identifier: Apache-2.0
"""The parts of a compiled step, which nothing but minimise.c calls, called with tensors."""

from ctypes import addressof, c_float, c_int64, c_void_p
from typing import Any

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.compiled import layout
from asglight.fitting.loss import temporal
from asglight.lobes import Lobes, asg


def solve(
    hessian: Tensor, gradient: Tensor, lobes: Lobes, damping: Tensor, still: Tensor | None
) -> Tensor:
    """Return `equations.solve`."""
    found = torch.empty(*lobes.sharpness.shape[:2], 8, dtype=torch.float64)
    given = hessian.contiguous(), gradient, lobes.sharpness, lobes.amplitude, damping, still
    least = c_float(asg.SHARPNESS_MIN)
    _call("asglight_solve", *lobes.sharpness.shape[:2], *given, least, found)
    return found


def advance(lobes: Lobes, step: Tensor, width_min: float) -> Lobes:
    """Return `coordinates.advance`."""
    found = [torch.empty_like(each) for each in (lobes.axes, lobes.sharpness, lobes.amplitude)]
    bounds = layout._bounds(width_min)
    given = lobes.axes, lobes.sharpness, lobes.amplitude, step.contiguous(), bounds
    _call("asglight_advance", lobes.sharpness.numel() // 2, *given, *found)
    return Lobes(*found, lobes.form)


def term(lobes: Lobes, held: temporal.Prior) -> tuple[Tensor, Tensor, Tensor]:
    """Return `temporal.value` and both of `temporal.slopes`."""
    frames, count = lobes.sharpness.shape[:2]
    slopes = torch.empty(2, frames, 8 * count, dtype=torch.float64)
    value, before = torch.empty(frames), held.lobes
    given = lobes.axes, lobes.sharpness, lobes.amplitude
    then = before.axes, before.sharpness, before.amplitude, held.share, held.scale
    corner = c_float(temporal.CORNER)
    _call("asglight_temporal", frames, count, *given, *then, corner, value, *slopes)
    return value, slopes[0], slopes[1]


def _call(name: str, *given: Any) -> None:
    arguments = [
        c_int64(each)
        if isinstance(each, int)
        else c_void_p(each.data_ptr() if isinstance(each, Tensor) else each and addressof(each))
        for each in given
    ]
    function = getattr(compiled.LIBRARY, name)
    function.restype = None
    function(*arguments)
