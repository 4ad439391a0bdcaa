# SPDX-License-Identifier: Apache-2.0
"""The space that a stage's numbers are in: which axis is up.

asglight has +Y up. In a stage with +Z up everything is turned by 90 degrees about X, which takes
(x, y, z) to (x, -z, y), as `UsdLuxDomeLight::OrientToStageUpAxis` turns a dome's image. The rig
remembers its axis itself, because USD does not compose the stage's from sublayers and references.
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from pxr import Usd

from asglight.lobes.data import Lobes
from asglight.usd import schema

UP_AXES = ("Y", "Z")


@dataclass(frozen=True)
class Space:
    """The space of a stage's numbers.

    Attributes:
        up_axis: `Y` or `Z`.
    """

    up_axis: str = "Y"


def space_of(rig: Usd.Prim) -> Space:
    """Return the space that a rig was written in."""
    data: Any = rig.GetCustomDataByKey(schema.CUSTOM_DATA)
    up_axis = data.get(schema.UP_AXIS) if isinstance(data, dict) else None
    return Space(up_axis if up_axis in UP_AXES else Space.up_axis)


def to_stage(lobes: Lobes, space: Space) -> Lobes:
    """Return lobes as a stage holds them.  [..., N, .]."""
    if space.up_axis == "Y":
        return lobes
    x, y, z = lobes.axes.unbind(-1)
    return replace(lobes, axes=torch.stack([x, -z, y], dim=-1))


def from_stage(lobes: Lobes, space: Space) -> Lobes:
    """Return lobes that a stage holds as asglight has them, undoing `to_stage`.  [..., N, .]."""
    if space.up_axis == "Y":
        return lobes
    x, y, z = lobes.axes.unbind(-1)
    return replace(lobes, axes=torch.stack([x, z, -y], dim=-1))
