# SPDX-License-Identifier: Apache-2.0
"""Stress cases of one frame: extreme radiance, extreme shapes, broken files."""

import functools
import math
from collections.abc import Callable

import torch
from torch import Tensor

from asglight.judging.stress import maps
from asglight.judging.stress.case import FLUX, GRADIENT, IRRADIANCE, Bound, Case, Group

HALF_MAX = 65504.0
"""The largest number of half floats, where many files end."""


def _still(
    group: Group,
    name: str,
    holds: str,
    make: Callable[[], Tensor],
    *,
    irradiance: Bound = IRRADIANCE,
    flux: Bound = FLUX,
    gradient: Bound = GRADIENT,
    refused: str | None = None,
) -> Case:
    """Return a case of one frame.

    Args:
        group: What is extreme.
        name: Unique, words with hyphens.
        holds: The input, in a few words.
        make: Makes the map.  [H, W, 3]
        irradiance: Bound of irr.
        flux: Bound of the flux.
        gradient: Bound of the gradient's error.
        refused: Words of the one line that refuses the input, where it has to be.
    """
    return Case(
        name,
        group,
        holds,
        lambda: [make()],
        irradiance=irradiance,
        flux=flux,
        gradient=gradient,
        refused=refused,
    )


_radiance = functools.partial(_still, Group.RADIANCE)
_shape = functools.partial(_still, Group.SHAPE)
_broken = functools.partial(_still, Group.BROKEN)


def _texel(name: str, holds: str, row: int, column: int, value: float, around: float = 0.0) -> Case:
    """Return a case whose map is of one radiance but for a texel."""
    return _radiance(name, holds, lambda: maps.texel(row, column, value, around))


def _times(factor: float) -> Callable[[], Tensor]:
    """Return what makes sun and sky, so many times as bright.  [H, W, 3]."""
    return lambda: maps.sun_and_sky() * factor


def _only(channel: int) -> Callable[[], Tensor]:
    """Return what makes sun and sky, black but for a channel.  [H, W, 3]."""
    return lambda: maps.sun_and_sky() * torch.eye(3)[channel]


RADIANCE = (
    *(
        _radiance(f"times-{factor:g}", f"sun and sky times {factor:g}", _times(factor))
        for factor in (1e-9, 1e-4, 1e4, 1e9, 1e30)
    ),
    _texel("range-1e18", "a texel of 1e9, all else 1e-9", 20, 40, 1e9, 1e-9),
    _texel("half-max", "a texel of 65504, all else 1", 20, 40, HALF_MAX, 1.0),
    _radiance("half-max-all", "65504 everywhere", lambda: maps.constant(HALF_MAX)),
    _radiance("denormal", "sun and sky of 3e-43 to 1e-39", _times(1e-39 / 3e3)),
    _radiance(
        "denormal-min",
        "1.4e-45 everywhere, the least there is",
        lambda: maps.constant(1.4e-45),
        flux=Bound(1.0, "An amplitude is this number times 0, 1, 2, ...: nothing lies between."),
        irradiance=Bound(1.0, "As the flux."),
    ),
    _radiance("only-red", "sun and sky, one channel", _only(0)),
    _radiance("only-green", "sun and sky, one channel", _only(1)),
    _radiance("only-blue", "sun and sky, one channel", _only(2)),
    _texel("one-texel", "all light in one texel", 20, 40, 1e6),
    _texel("one-texel-pole", "all light in one texel at the pole", 0, 40, 1e6),
    _texel("one-texel-seam", "all light in one texel at the seam", 32, 0, 1e6),
)


def _large() -> Tensor:
    """Return a map of 4,096 x 8,192 with three lamps of one texel each."""
    radiance = maps.enlarged(maps.sun_and_sky(256), 16)
    for row, column in ((1000, 20), (2500, 4000), (4000, 7000)):
        radiance[row, column] = 2e5
    return radiance


FEW_ROWS = "Texels of 22 degrees and more have edges, which 15 lobes seen on 16 rows soften."

COARSE = Bound(
    0.1, "The gradient takes a texel's shape as that at a lobe's centre, on 16 rows a rough guess."
)


def _sized(rows: int, irradiance: Bound = IRRADIANCE, gradient: Bound = GRADIENT) -> Case:
    """Return sun and sky on a map of so many rows."""
    make = functools.partial(maps.sun_and_sky, rows)
    holds = f"sun and sky, {rows} {'row' if rows == 1 else 'rows'}"
    return _shape(f"{rows}x{2 * rows}", holds, make, irradiance=irradiance, gradient=gradient)


SHAPE = (
    *(_sized(rows, Bound(0.025, FEW_ROWS), COARSE) for rows in (1, 2, 3, 5, 8)),
    *(_sized(rows) for rows in (16, 61, 256, 1024)),
    _shape("4096x8192", "sun, sky, three lamps of a texel", _large),
    _shape("constant", "one value everywhere", lambda: maps.constant(0.5)),
    _shape("black", "no light", lambda: maps.constant(0.0)),
    _shape("black-but-one", "one texel of 1", lambda: maps.texel(40, 100, 1.0)),
    _shape("white-but-one", "one black texel", lambda: maps.texel(20, 40, 0.0, 1.0)),
    _shape("checkerboard", "every other texel", lambda: maps.checkerboard(1)),
    _shape("checkerboard-16", "squares of 45 degrees", lambda: maps.checkerboard(16)),
    _shape("noise", "even noise", maps.noise),
    _shape("noise-rare", "noise with few bright texels", lambda: maps.noise(20.0)),
    _shape("rectangle", "30 by 60 degrees", lambda: maps.rectangle((0, 30), (-20, 40))),
    _shape(
        "rectangle-small",
        "10 by 25 degrees, on dim grey",
        lambda: maps.rectangle((20, 30), (-5, 20), 100.0, 0.1),
    ),
    _shape("half-up", "the upper half", lambda: maps.rectangle((0, 90), (-180, 180))),
    _shape("half-front", "the front half", lambda: maps.rectangle((-90, 90), (-90, 90))),
    _shape("line-short", "a tube: 3 by 60 degrees", lambda: maps.rectangle((30, 33), (-30, 30))),
    _shape("line-level", "a ring of one row", lambda: maps.rectangle((30, 33), (-180, 180))),
    _shape("line-upright", "from pole to pole", lambda: maps.rectangle((-90, 90), (40, 43))),
)


NO_LATLONG = "expected a 2:1 latlong"


def _speckled() -> Tensor:
    """Return sun and sky with texels that are NaN, infinite and negative."""
    radiance = maps.sun_and_sky()
    radiance[3, 5], radiance[4, 9], radiance[10, 60:70] = math.nan, math.inf, -1.0
    return radiance


BROKEN = (
    _broken("speckled", "NaN, Inf and negative texels in sun and sky", _speckled),
    _broken(
        "all-nan",
        "NaN everywhere",
        lambda: maps.constant(math.nan),
        refused="holds nothing but NaN",
    ),
    _broken(
        "all-negative",
        "-1 everywhere",
        lambda: maps.constant(-1.0),
        refused="nothing above 0",
    ),
    _broken(
        "float-max",
        "a texel of 3.4e38",
        lambda: maps.texel(20, 40, 3.4e38),
        refused="at most 1e+36",
    ),
    _broken("square", "64 x 64", lambda: maps.constant(1.0)[:, :64], refused=NO_LATLONG),
    _broken("single", "1 x 1", lambda: maps.constant(1.0)[:1, :1], refused=NO_LATLONG),
)
