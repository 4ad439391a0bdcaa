# SPDX-License-Identifier: Apache-2.0
"""A lobe as a distant light: a round disc in the sky with the lobe's irradiance and spread.

An anisotropic lobe may be three discs in a row along its broad side, so long as it is.

A normalised DistantLight gives a patch that faces it the irradiance `intensity`, whatever `angle`
says (UsdLux); angle is the disc's diameter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from asglight.lobes import asg
from asglight.lobes.data import Lobes
from asglight.usd import schema
from asglight.usd.lights.emission import intensity_and_color, tinted
from asglight.usd.lights.light import Light, on_sides

ANISOTROPIC = 1.1
"""Ratio of the sharpnesses, in any frame, from which three lights differ from one."""

OUTER = 1 / 6
"""Share of each outer light of three: the weights of Gauss and Hermite's rule, 1/6, 2/3, 1/6."""

MIDDLE = "middle"
"""Name of the light between the outer two."""

ACROSS_MAX = 0.32
"""Mean square of the broadest of three discs; at 1/3 tilting one would change nothing."""


def angle_deg(lobes: Lobes, moments: asg.Moments | None = None) -> Tensor:
    """Return the diameter of the disc whose mean x^2 + y^2 is each lobe's, in degrees.

    Over a disc of angular radius t, mean x^2 + y^2 = m = 1 - (1 + cos t + cos^2 t) / 3, so
    sin^2(t / 2) = 3 m / (3 + sqrt(9 - 12 m)). m = 2/3 is the hemisphere, the widest disc.

    Args:
        lobes: N lobes.  [..., N, .]
        moments: Theirs, float64, where they are known.  [..., N, .]

    Returns:
        Degrees in [0, 180], float64.  [..., N]
    """
    zeroth, _, second = moments or asg.moments(lobes.to(torch.float64))
    return torch.rad2deg(2 * disc_radius(second[..., :2].sum(-1) / zeroth)).clamp(max=180)


def disc_radius(spread: Tensor) -> Tensor:
    """Return the angular radius of the disc whose mean x^2 + y^2 is `spread`, in radians."""
    spread = spread.clamp(max=2 / 3)
    # rounding may leave 9 - 12 m a hair below 0 at the hemisphere
    sine_squared = 3 * spread / (3 + (9 - 12 * spread).clamp(min=0).sqrt())
    return 2 * torch.asin(sine_squared.sqrt())


def lights(lobes: Lobes, moments: asg.Moments, threefold: Sequence[bool]) -> list[list[Light]]:
    """Return the distant lights of every lobe.

    Args:
        lobes: Lobes of F frames.  [F, N, .]
        moments: Theirs, float64.  [F, N, .]
        threefold: For each lobe whether it gets three lights.
    """
    irradiance = asg.facing_irradiance(lobes, moments)
    angle = angle_deg(lobes, moments)
    spreads = Spread.of(moments.second[..., :2] / moments.zeroth[..., None])
    found = []
    for index, is_threefold in enumerate(threefold):
        facing = irradiance[:, index]
        own = (
            _three(facing, spreads.of_lobe(index))
            if is_threefold
            else [_light("", facing, angle[:, index])]
        )
        found.append(on_sides(own, lobes.form))
    return found


def threefold(lobes: Lobes, count: int) -> list[bool]:
    """Choose the lobes that get three lights, for all frames.

    Args:
        lobes: Lobes of F frames.  [F, N, .]
        count: Lights of an anisotropic lobe, 1 or 3.
    """
    ratio = lobes.sharpness.amax(-1) / lobes.sharpness.amin(-1)
    return [count == 3 and more for more in (ratio.amax(0) > ANISOTROPIC).tolist()]


@dataclass(frozen=True)
class Spread:
    """How three discs in a row cover a lobe.

    Attributes:
        radius: Of each disc, in radians.
        tilt: From the middle disc to the others, in radians.
        along_x: Whether the row runs along x; y otherwise.
    """

    radius: Tensor
    tilt: Tensor
    along_x: Tensor

    @classmethod
    def of(cls, squares: Tensor) -> Self:
        """Match the mean squares across and along a lobe: its mean x^2 and y^2.  [..., 2].

        A disc of mean square m across each axis, tilted by t, has m + (1 - 3 m) sin^2 t along the
        row; the outer two of three carry `2 OUTER` of the light.
        """
        across = squares.amin(-1).clamp(max=ACROSS_MAX)
        sine_squared = 3 * 2 * across / (3 + (9 - 24 * across).sqrt())
        radius = 2 * torch.asin(sine_squared.sqrt())
        spare = (squares.amax(-1) - across).clamp(min=0) / (2 * OUTER * (1 - 3 * across))
        tilt = torch.asin(spare.clamp(max=1).sqrt())
        # No disc reaches beyond the half space, where its irradiance would not be I cos(tilt).
        tilt = torch.minimum(tilt, (torch.pi / 2 - radius).clamp(min=0))
        return cls(radius, tilt, squares[..., 0] >= squares[..., 1])

    def of_lobe(self, index: int) -> Self:
        """Return one lobe's.  [F]."""
        return type(self)(self.radius[:, index], self.tilt[:, index], self.along_x[:, index])


def _three(facing: Tensor, spread: Spread) -> list[Light]:
    """Return the middle light and those to its sides, whose irradiances together are `facing`.

    Args:
        facing: Irradiance on a patch that faces the lobe.  [F, 3]
        spread: Of the lobe over all frames.  [F]
    """
    whole = (1 - 2 * OUTER) + 2 * OUTER * spread.tilt.cos()
    angle = torch.rad2deg(2 * spread.radius)
    middle = _light(MIDDLE, facing * ((1 - 2 * OUTER) / whole)[:, None], angle)
    sides = []
    for name, sign in (("plus", 1), ("minus", -1)):
        half, zero = sign * spread.tilt / 2, torch.zeros_like(spread.tilt)
        about_y = torch.stack([half.cos(), zero, half.sin(), zero], dim=-1)
        about_x = torch.stack([half.cos(), -half.sin(), zero, zero], dim=-1)
        turn = torch.where(spread.along_x[:, None], about_y, about_x)
        light = _light(name, facing * (OUTER / whole)[:, None], angle)
        tracks = {schema.ORIENT_SIDE: turn, **light.tracks}
        sides.append(replace(light, tracks=tracks, ops=(schema.ORIENT_SIDE,)))
    return [middle, *sides]


def _light(name: str, irradiance: Tensor, angle: Tensor) -> Light:
    """Return a light of an irradiance [F, 3] and a diameter in degrees [F]."""
    intensity, color = intensity_and_color(irradiance)
    tracks = {
        schema.ANGLE: angle[:, None],
        schema.INTENSITY: intensity[:, None],
        schema.COLOR: tinted(intensity, color),
    }
    return Light(name, tracks, {schema.NORMALIZE: True})
