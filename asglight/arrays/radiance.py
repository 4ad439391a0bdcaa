# SPDX-License-Identifier: Apache-2.0
"""Radiance as arrays: checked, repaired and reduced as images are."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.options import FIT_HEIGHT
from asglight.images.infinite import Infinities
from asglight.images.loss import check_loss
from asglight.images.message import compressed
from asglight.images.options import LOST_MAX
from asglight.images.repair import Repair, Tally, repair_rows
from asglight.shots.frames import RADIANCE_MAX
from asglight.sphere import latlong
from asglight.sphere.overlaps import row_solid_angles

FLOATS = (np.float16, np.float32, np.float64)


class Frame(NamedTuple):
    """One frame, ready to be fitted.

    Attributes:
        radiance: Finite and >= 0, at most `FIT_HEIGHT` rows.  [H, 2 H, 3] float32
        repair: What was changed.
    """

    radiance: Tensor
    repair: Repair


def device_of(radiance: Any) -> str:
    """Return where an array is: a tensor's own device, else the processor."""
    return str(radiance.device) if isinstance(radiance, Tensor) else "cpu"


def plain(values: Any, name: str, expected: str) -> Any:
    """Return a dense tensor as it is, and else a numpy array.

    Args:
        values: A tensor, or what numpy takes for an array.
        name: What to call it in a message.
        expected: What it is to be.

    Raises:
        InputError: It is no array, or some of it is masked, or not stored: it would count as it
            happens to lie there.
    """
    if isinstance(values, Tensor):
        if values.layout is not torch.strided:
            raise InputError(f"{name}: a sparse tensor; expected a dense one. Call to_dense().")
        return values
    parts = values if isinstance(values, list | tuple) else [values]  # a list of frames
    masked = sum(np.ma.count_masked(part) for part in parts if isinstance(part, np.ma.MaskedArray))
    if masked:
        raise InputError(
            f"{name}: {masked} values are masked; expected none. Call filled() with what is to "
            "stand there."
        )
    try:
        return np.asarray(values)
    except ValueError as error:  # lists of several lengths
        finding = compressed(str(error))
        raise InputError(f"{name}: no array ({finding}); expected {expected}.") from error


def frames_of(radiance: Any) -> list[Any]:
    """Return the frames of an array, none of them copied.

    Args:
        radiance: [H, 2 H, 3], or [F, H, 2 H, 3] of several frames; numpy, torch, or what numpy
            takes for an array.

    Raises:
        InputError: It has another shape, is not of floating-point numbers, or is masked or sparse.
    """
    expected = "[H, 2 H, 3] of one latlong, or [F, H, 2 H, 3] of F frames of one size"
    values = plain(radiance, "radiance", expected)
    shape = tuple(values.shape)
    if len(shape) not in (3, 4) or shape[-1] != 3 or shape[-2] != 2 * shape[-3] or 0 in shape:
        raise InputError(f"radiance: shape {list(shape)}; expected {expected}.")
    if isinstance(values, Tensor):
        is_float = values.is_floating_point()
    else:
        is_float = values.dtype.newbyteorder("=") in FLOATS  # in any order of bytes
    if not is_float:
        raise InputError(
            f"radiance: of type {values.dtype}; expected linear radiance in floating-point "
            "numbers. Integers of 8 or 16 bits are no light: convert them first."
        )
    return [values] if len(shape) == 3 else list(values)


def prepared(radiance: Any, repair: float = LOST_MAX, name: str = "radiance") -> Frame:
    """Return a frame as a file's image would be read.

    Negative and NaN values become 0, infinite ones what is bright beside them; then it is averaged
    down to `FIT_HEIGHT` rows by solid angle. This is done on the processor.

    Args:
        radiance: Linear Rec.709, row 0 = +Y.  [H, 2 H, 3]
        repair: Share of its light or texels that may be lost.
        name: What to call it in a message.

    Returns:
        The frame, on the device that the array is on.

    Raises:
        InputError: It is no latlong, lost too much, or is brighter than lights can be.
    """
    found = frames_of(radiance)
    if len(found) > 1:
        raise InputError(f"{name}: {len(found)} frames; expected one at a time, [H, 2 H, 3].")
    (one,) = found
    values = one.detach().cpu().float().numpy() if isinstance(one, Tensor) else one
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and told of as that
        values = np.asarray(values, dtype=np.float32)
    values, infinite = _finite(values)
    rows, tally = repair_rows(values, row_solid_angles(*values.shape[:2]))
    account = (tally + Tally(infinite=infinite)).account(rows)
    check_loss(Path(name), account, values.shape[0] * values.shape[1], repair)
    brightest = float(rows.max())
    if brightest > RADIANCE_MAX:
        raise InputError(
            f"{name}: has a radiance of {brightest:.2g}; expected at most {RADIANCE_MAX:g}, so "
            "that lights can have numbers. Divide it by a constant."
        )
    height = min(FIT_HEIGHT, len(rows))
    reduced = latlong.reduce(torch.from_numpy(rows), height, 2 * height)
    return Frame(reduced.to(device_of(radiance)), account)


def all_prepared(radiance: Any, repair: float = LOST_MAX, first_frame: int = 1) -> Iterator[Frame]:
    """Prepare the frames of an array, one after the other.

    Raises:
        InputError: As `prepared`; it names the frame.
    """
    for number, one in enumerate(frames_of(radiance), first_frame):
        yield prepared(one, repair, f"frame {number}")


def _finite(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], int]:
    """Replace what is infinite as images have it replaced; return how many texels had it.

    Args:
        values: [H, W, 3]
    """
    red, green, blue = np.ascontiguousarray(np.moveaxis(values, -1, 0))
    found = Infinities()
    (planes,) = found.kept([(red, green, blue)])
    return np.stack(planes, axis=-1), found.count
