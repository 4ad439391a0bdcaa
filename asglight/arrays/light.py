# SPDX-License-Identifier: Apache-2.0
"""The light of lobes: from directions, as a latlong, on surfaces and balls, at any time.

Every function takes the tracks of a shot and a time in frame numbers, fractions too, or lobes
themselves. Tracks are evaluated in float64 on the CPU by the rule of `asglight.lobes.motion`; lobes
as they are, where they are. All is differentiable by torch, to the lobes and to the directions.

Dimension letters: T times, N lobes, P points.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.arrays.radiance import FLOATS, plain
from asglight.errors import InputError, check_number, check_whole
from asglight.lobes import Lobes, LobeTracks, asg, motion
from asglight.lobes.texels import texel_means
from asglight.shading import ggx, ggx_lobes
from asglight.shading.balls import ROUGHNESS, ROUGHNESS_MIN, coverage, covered
from asglight.shading.ggx_layer import layer
from asglight.shading.ggx_lobes import COS_VIEW_MIN
from asglight.shading.rectified import irradiance_over_pi
from asglight.shading.sheets import amplitudes, sheets

Light = LobeTracks | Lobes
"""Tracks, or lobes of one frame.  [N, .]"""

Time = float | Sequence[float] | np.ndarray | Tensor | None
"""In frame numbers, one or several; None for lobes, and for tracks of one frame."""

ALBEDO_NODES = 129
"""Of n.v, from 0 to 1, at which the layer's albedo is integrated; it takes longer than all the rest
of a ball. Between them it is within 5e-4 above n.v = 0.06 (tests/arrays/test_arrays_light.py)."""


ROWS_MAX = 16384
"""Of a latlong and of a ball's picture: those of the largest image that is read (decode.py)."""


def radiance(light: Light, directions: Any, time: Time = None) -> Tensor:
    """Return the radiance that comes from directions.

    Examples:
        >>> asglight.radiance(tracks, [0.0, 1.0, 0.0], 1001.5).shape  # from straight above
        torch.Size([3])

    Args:
        light: Tracks or lobes.
        directions: From the point that is lit towards the light; of any length.  [..., 3]
        time: When.

    Returns:
        Linear Rec.709, relative as the images were.  [..., 3]; of several times [T, ..., 3]

    Raises:
        InputError: The directions cannot be used, or the time is missing or none.
    """
    return _at_points(light, directions, time, asg.evaluate)


def irradiance(light: Light, normals: Any, time: Time = None) -> Tensor:
    """Return the irradiance of surfaces that see all the light above their horizon.

    A matte surface shows albedo / pi times that. Closed form: within a percent of the irradiance of
    a lobe that is cut by the horizon, exact for lobes above it (docs/method/shading.md).

    Examples:
        >>> normals = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        >>> asglight.irradiance(tracks, normals, [1001, 1001.5, 1002]).shape
        torch.Size([3, 2, 3])

    Args:
        light: Tracks or lobes.
        normals: Of any length.  [..., 3]
        time: When.

    Returns:
        Linear Rec.709 times steradians.  [..., 3]; of several times [T, ..., 3]

    Raises:
        InputError: As `radiance`.
    """
    return _at_points(light, normals, time, _irradiance)


def latlong(light: Light, height: int = 256, time: Time = None) -> Tensor:
    """Return the light as a latlong: the mean radiance over each texel, so no lobe is missed.

    Examples:
        >>> asglight.latlong(tracks, height=16, time=1001).shape
        torch.Size([16, 32, 3])

    Args:
        light: Tracks or lobes.
        height: Rows; there are twice as many columns.
        time: When.

    Returns:
        Linear Rec.709, row 0 = +Y.  [H, 2 H, 3]; of several times [T, H, 2 H, 3]

    Raises:
        InputError: There are no such rows, or the time is missing or none.
    """
    check_whole("height", height)
    if not 1 <= height <= ROWS_MAX:
        raise InputError(f"height: {height} rows; expected 1 or more, at most {ROWS_MAX}.")
    return _of_each(light, time, lambda lobes: texel_means(lobes, height, 2 * height))


def balls(
    light: Light,
    time: Time = None,
    *,
    roughness: Sequence[float | None] = (*ROUGHNESS, None),
    size: int = 96,
) -> Tensor:
    """Draw white balls, seen from +Z with +Y up, in closed form as the viewer does.

    Examples:
        >>> asglight.balls(tracks, 1001, roughness=(0.25, None), size=16).shape
        torch.Size([2, 16, 16, 3])

    Args:
        light: Tracks or lobes.
        time: When.
        roughness: Perceptual, 0.05 to 1, of balls of metal; None for a matte ball.
        size: Pixels across; a ball fills its picture.

    Returns:
        Linear Rec.709 times the share of each pixel that is covered.  [R, size, size, 3]; of
        several times [T, R, size, size, 3]

    Raises:
        InputError: A roughness or the size is none, or the time is missing or none.
    """
    if not isinstance(roughness, Sequence | np.ndarray | Tensor) or isinstance(roughness, str):
        raise InputError("roughness: no list; expected one or more, such as (0.25, None).")
    if not len(roughness):
        raise InputError("roughness: none; expected one or more.")
    for one in roughness:
        if one is not None and not isinstance(one, Tensor):
            check_number("roughness", one)
    bad = [one for one in roughness if one is not None and not ROUGHNESS_MIN <= one <= 1]
    if bad:
        raise InputError(
            f"roughness: {bad[0]:g}; expected {ROUGHNESS_MIN:g} to 1, or None for a matte ball."
        )
    check_whole("size", size)
    if not 1 <= size <= ROWS_MAX:
        raise InputError(f"size: {size}; expected 1 pixel or more, at most {ROWS_MAX}.")
    return _of_each(light, time, lambda lobes: _balls(lobes, roughness, size))


def _irradiance(lobes: Lobes, normals: Tensor) -> Tensor:
    """Return irradiance.  [N, .], [P, 3] -> [P, 3]."""
    unit = irradiance_over_pi(sheets(lobes), normals)  # [M, P]
    return math.pi * torch.einsum("mp,mc->pc", unit, amplitudes(lobes))


def _balls(lobes: Lobes, roughness: Sequence[float | None], size: int) -> Tensor:
    """Return the balls of one frame.  [R, size, size, 3]."""
    share, normals = covered(size)
    share, normals = share.to(lobes.sharpness), normals.to(lobes.sharpness)
    normals = torch.nn.functional.normalize(normals, dim=-1)
    towards, white = normals.new_tensor([0.0, 0.0, 1.0]), normals.new_ones(3)
    pixels = torch.nonzero(coverage(size).to(normals.device).flatten()).flatten()
    pictures = []
    for one in roughness:
        if one is None:
            shown = _irradiance(lobes, normals) / math.pi
        else:
            layered = layer(torch.as_tensor(one, dtype=normals.dtype, device=normals.device))
            albedo = _albedo(normals[:, 2], one)
            made = sheets(lobes)
            unit = ggx_lobes.reflected(made, normals, towards, layered, white, albedo)
            shown = torch.einsum("mpc,mc->pc", unit, amplitudes(lobes))
        empty = normals.new_zeros(size * size, 3)
        whole = empty.index_copy(0, pixels, shown * share[:, None])
        pictures.append(whole.reshape(size, size, 3))
    return torch.stack(pictures)


def _albedo(cos_view: Tensor, roughness: float) -> Tensor:
    """Return `ggx.albedo_parts` at n.v, between `ALBEDO_NODES` of it.  [P] -> [P, 2]."""
    table = _albedo_table(roughness).to(cos_view)
    place = cos_view.clamp(0, 1) * (ALBEDO_NODES - 1)
    before = place.floor().long().clamp(max=ALBEDO_NODES - 2)
    return torch.lerp(table[before], table[before + 1], (place - before)[:, None])


@functools.cache
@torch.inference_mode(False)
def _albedo_table(roughness: float) -> Tensor:
    """Return `ggx.albedo_parts` at even n.v.  [ALBEDO_NODES, 2]."""
    cos_view = torch.linspace(0, 1, ALBEDO_NODES, dtype=torch.float64).clamp(min=COS_VIEW_MIN)
    return ggx.albedo_parts(cos_view, roughness**2)


def _at_points(
    light: Light, points: Any, time: Time, function: Callable[[Lobes, Tensor], Tensor]
) -> Tensor:
    """Return what a function of lobes and unit vectors gives.  [..., 3] or [T, ..., 3]."""
    vectors = _vectors(points)

    def of(lobes: Lobes) -> Tensor:
        unit = torch.nn.functional.normalize(vectors.to(lobes.sharpness), dim=-1)
        return function(lobes, unit.reshape(-1, 3)).reshape(vectors.shape)

    return _of_each(light, time, of)


def _vectors(points: Any) -> Tensor:
    """Return vectors of any length with 1 as the largest of their components.  [..., 3].

    Raises:
        InputError: They are of another shape or type, not finite, or of no length.
    """
    expected = "[..., 3] of floating-point numbers"
    values = plain(points, "directions", expected)
    if isinstance(values, Tensor):
        is_float = values.is_floating_point()
    else:
        is_float = values.dtype.newbyteorder("=") in FLOATS  # in any order of bytes
    if values.ndim < 1 or values.shape[-1] != 3 or not is_float:
        raise InputError(
            f"directions: shape {list(values.shape)} of {values.dtype}; expected {expected}."
        )
    if isinstance(values, Tensor):
        vectors = values.to(torch.promote_types(values.dtype, torch.float32))
    else:  # a copy, for torch takes no array that runs backwards or cannot be written
        vectors = torch.from_numpy(np.array(values, np.float64, order="C"))
    # of components up to 1, for lengths below 1e-12 are not normalised and large ones overflow
    largest = vectors.detach().abs().amax(-1, keepdim=True)
    if not bool((largest.isfinite() & (largest > 0)).all()):
        raise InputError(
            "directions: one is of length 0, or not finite; expected vectors with a way."
        )
    return vectors / largest


def _of_each(light: Light, time: Time, function: Callable[[Lobes], Tensor]) -> Tensor:
    """Return what a function gives of the lobes of a time, or stacked of several.  [(T,) ...]."""
    if isinstance(light, Lobes):
        if time is not None or light.axes.ndim != 3:
            raise InputError(
                f"time: {time} of lobes of shape {list(light.axes.shape[:-2])}; expected no time, "
                "and lobes [N] of one frame. Tracks have times."
            )
        return function(light)
    if not isinstance(light, LobeTracks):
        raise InputError(f"light: of type {type(light).__name__}; expected tracks, or lobes.")
    time = (
        plain(time, "time", "frame numbers").tolist()
        if isinstance(time, np.ndarray | Tensor)
        else time
    )
    times = _times(light, time)
    lobes = motion.at(light, times)
    found = [function(lobes[place]) for place in range(len(times))]
    return torch.stack(found) if isinstance(time, Sequence) else found[0]


def _times(tracks: LobeTracks, time: Time) -> list[float]:
    """Return the times that are meant.

    Raises:
        InputError: Which one is not said, there is none, or one is not finite.
    """
    first, last = tracks.frames[0], tracks.frames[-1]
    whole = f"{first} to {last}"
    if time is None:
        if first != last:
            raise InputError(f"time: none; expected one, in the frame numbers {whole}.")
        return [float(first)]
    try:
        given = time if isinstance(time, Sequence) else [time]
        # a text is a sequence of letters, and float reads text; True is 1 to it
        if isinstance(time, str | bytes) or any(isinstance(one, str | bool) for one in given):
            raise TypeError
        times = [float(one) for one in given]
    except (TypeError, ValueError, OverflowError):
        times = []
    if not times or not all(map(math.isfinite, times)):
        raise InputError(f"time: {time}; expected numbers, such as frames {whole}.")
    return times
