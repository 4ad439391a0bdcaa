# SPDX-License-Identifier: Apache-2.0
"""Spherical Gaussians as the arrays of PhySG and NeRD, and back (docs/reference/export.md).

A lobe is seven float32 numbers, a frame [N, 7], a shot [F, N, 7], in a .npy file. Both programs
show amplitude exp(sharpness (axis . d - 1)) from a unit direction d. Read in their sources:

    physg  axis of any length (3), sharpness (1), amplitude (3); of the last two the absolute value.
           [Zhang et al. 2021 "PhySG"; github.com/Kai-46/PhySG, code/model/sg_render.py]
    nerd   amplitude (3), absolute value; axis of any length (3); sharpness (1), which the renderer
           holds between 0.5 and 30. [Boss et al. 2021 "NeRD"; github.com/cgtuebingen/
           NeRD-Neural-Reflectance-Decomposition, nn_utils/sg_rendering.py]

Both have +Y up. Row 0 of a latlong is +Y; at u from the left edge the horizon is, as (x, z),

    asglight  (sin 2 pi u, -cos 2 pi u)
    physg     (sin 2 pi u, -cos 2 pi u)    compute_envmap of sg_render.py
    nerd      (sin 2 pi u,  cos 2 pi u)    uv_to_direction of nn_utils/math_utils.py

so the same map has the same axes in PhySG, and axes with the sign of z changed in NeRD: a mirror
image, which is no matter to lobes that are round.
"""

import os
import tokenize
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from asglight.errors import InputError
from asglight.export.track_file import FRAME_MAX, check_samples
from asglight.images.message import compressed, shown
from asglight.images.output import written_beside
from asglight.lobes import Form, Lobes, LobeTracks, asg, frames, isotropic


class SgLayout(StrEnum):
    """Whose arrays."""

    PHYSG = "physg"
    NERD = "nerd"


WIDTH = 7
"""Numbers of a lobe."""

NERD_SHARPNESS = (0.5, 30.0)
"""What NeRD's renderer holds the sharpness between, as `_extract_sg_components` does."""

NERD_LOBES = 24
"""Lobes of the arrays that NeRD's training blends; one of another number does not fit into it."""

UNIT_ERROR = 1e-6
"""Of an axis' length, below which it stays as it is: ten float32 roundings. So lobes come back to
the bit."""


class _Columns(NamedTuple):
    axis: slice
    sharpness: slice
    amplitude: slice
    mirror: tuple[float, float, float]


_COLUMNS = {
    SgLayout.PHYSG: _Columns(slice(0, 3), slice(3, 4), slice(4, 7), (1.0, 1.0, 1.0)),
    SgLayout.NERD: _Columns(slice(3, 6), slice(6, 7), slice(0, 3), (1.0, 1.0, -1.0)),
}


def as_shown(lobes: Lobes, layout: SgLayout) -> Lobes:
    """Return the sg lobes that an array can hold for lobes of any form.

    Args:
        lobes: N lobes.  [..., N, .]
        layout: Whose array. NeRD's has sharpness from 0.5 to 30; lobes beyond keep their flux.

    Returns:
        Lobes as `isotropic.as_sg` gives them: N, or 2 N of bingham.  [..., N', .]
    """
    round_lobes = isotropic.as_sg(lobes)
    if layout is SgLayout.NERD:
        return isotropic.held_between(round_lobes, *NERD_SHARPNESS)
    return round_lobes


def sg_array(lobes: Lobes, layout: SgLayout) -> NDArray[np.float32]:
    """Return sg lobes as an array.

    Args:
        lobes: From `as_shown`.  [..., N, .]
        layout: Whose array.

    Returns:
        [..., N, 7]
    """
    assert lobes.form is Form.SG
    columns = _COLUMNS[layout]
    parts = lobes.to("cpu", torch.float32)
    array = np.empty((*parts.sharpness.shape[:-1], WIDTH), np.float32)
    array[..., columns.axis] = parts.axis_z * torch.tensor(columns.mirror)
    array[..., columns.sharpness] = parts.sharpness[..., :1]
    array[..., columns.amplitude] = parts.amplitude
    return array


def write_sg_array(path: str | Path, tracks: LobeTracks, layout: SgLayout) -> Lobes:
    """Write tracks as a .npy file: [N, 7] of one frame, else [F, N, 7].

    Args:
        path: The target; its folder must exist.
        tracks: Lobes of any form in F frames.
        layout: Whose array.

    Returns:
        The lobes in the file, as `as_shown` gives them.  [F, N', .]

    Raises:
        InputError: The file cannot be written there, or there are more samples than SAMPLES_MAX.
    """
    path = Path(path)
    check_samples(path, len(tracks.frames), tracks.lobes.count)
    lobes = as_shown(tracks.lobes, layout)
    array = sg_array(lobes, layout)
    # opened here, because numpy would append .npy to other names
    with written_beside(path) as place, place.open("wb") as file:
        np.save(file, array[0] if len(array) == 1 else array, allow_pickle=False)
    return lobes


def read_sg_array(
    path: str | Path, layout: SgLayout, *, first_frame: int = 1, fps: float = 24.0
) -> LobeTracks:
    """Read a .npy file of PhySG or NeRD as tracks.

    Args:
        path: [N, 7], or [F, N, 7] of frames in order. Never unpickled.
        layout: Whose array.
        first_frame: Number of the first frame; the others follow by ones.
        fps: Frames per second.

    Returns:
        Tracks with float32 sg lobes, in the order of the file.

    Raises:
        InputError: There is no such file, it is no such array, or a frame number is too large.
    """
    path = Path(path)
    array = _checked(path)  # [F, N, 7]
    columns = _COLUMNS[layout]
    axis_z = _unit(path, array[..., columns.axis]) * torch.tensor(columns.mirror)
    sharpness = torch.from_numpy(array[..., columns.sharpness])
    if layout is SgLayout.NERD:
        _check_rows(path, (sharpness >= 0)[..., 0], "a negative sharpness", "from 0 up")
        sharpness = sharpness.clamp(*NERD_SHARPNESS)
    else:
        # 0 is an even sphere, which a lobe at the limit is to 0.2 %
        sharpness = sharpness.abs().clamp(min=asg.SHARPNESS_MIN)
    amplitude = torch.from_numpy(array[..., columns.amplitude]).abs()
    lobes = Lobes(_axes(axis_z), sharpness.expand(*sharpness.shape[:-1], 2), amplitude, Form.SG)
    last_frame = first_frame + len(array) - 1
    if max(abs(first_frame), abs(last_frame)) > FRAME_MAX:
        raise InputError(f"first frame: {first_frame}; expected frames of 32 bits.")
    numbers = tuple(range(first_frame, last_frame + 1))
    return LobeTracks(numbers, fps, lobes)


def _checked(path: Path) -> NDArray[np.float32]:
    """Return the array of a file, finite and with a dimension of frames.  [F, N, 7]."""
    mapped = _mapped(path)
    if mapped.dtype.kind != "f":
        _fail(path, f"holds {mapped.dtype} numbers", "floating point")
    if mapped.ndim not in (2, 3) or mapped.shape[-1] != WIDTH or 0 in mapped.shape:
        _fail(path, f"shape {list(mapped.shape)}", "[N, 7], or [F, N, 7] of a shot")
    array = mapped[None] if mapped.ndim == 2 else mapped
    check_samples(path, *array.shape[:2])
    # What float32 does not hold becomes infinite, and is refused with what was.
    with np.errstate(over="ignore"):
        array = np.array(array, np.float32)
    good = torch.from_numpy(np.isfinite(array).all(-1))
    _check_rows(path, good, "a number that is not finite in float32", "finite numbers")
    return array


def _mapped(path: Path) -> NDArray[np.generic]:
    """Return the array in a file, of which only the header has been read."""
    expected = "a .npy file of numbers"
    if os.path.exists(path) and not os.path.isfile(path):  # a pipe would be waited for
        _fail(path, "is no file", expected)
    try:
        # It knows no pickles and no archives: objects are refused by their type.
        return np.lib.format.open_memmap(path, mode="r")
    except OSError as error:
        finding = error.strerror or type(error).__name__
        raise InputError(
            f"{shown(path)}: cannot be read ({finding}); expected {expected}."
        ) from error
    except (ValueError, OverflowError, SyntaxError, tokenize.TokenError) as error:
        _fail(path, f"is no whole .npy array ({compressed(str(error))})", expected)


def _unit(path: Path, axis: NDArray[np.float32]) -> Tensor:
    """Return unit axes; those that are unit in float32 to the bit.  [..., 3]."""
    given = torch.from_numpy(axis)
    length = given.double().norm(dim=-1, keepdim=True)
    _check_rows(path, (length > 0)[..., 0], "an axis of length 0", "a direction")
    turned = (given.double() / length).float()
    return torch.where((length - 1).abs() <= UNIT_ERROR, given, turned)


def _axes(axis_z: Tensor) -> Tensor:
    """Complete axes to frames that turn no more than they do.  [F, N, 3] -> [F, N, 3, 3]."""
    exact = torch.nn.functional.normalize(axis_z.double(), dim=-1)
    rows = [frames.axes_around(exact[0])]
    for axis in exact[1:]:
        rows.append(frames.parallel_transport(rows[-1], axis))
    axes = torch.stack(rows).float()
    axes[..., 2, :] = axis_z
    return axes


def _check_rows(path: Path, good: Tensor, found: str, expected: str) -> None:
    """Refuse a file for the first lobe that is not good.  [F, N]."""
    if not bool(good.all()):
        frame, lobe = torch.nonzero(~good)[0].tolist()
        place = f"row {lobe}" if len(good) == 1 else f"row {lobe} of frame {frame}, counted from 0,"
        _fail(path, f"{place} has {found}", expected)


def _fail(path: Path, found: str, expected: str) -> NoReturn:
    raise InputError(
        f"{shown(path)}: {found}; expected {expected}. "
        "docs/reference/export.md describes the arrays."
    )
