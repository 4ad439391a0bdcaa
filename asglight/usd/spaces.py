# SPDX-License-Identifier: Apache-2.0
"""The space that a stage's numbers are in: which axis is up, and what its colours mean.

asglight has +Y up. In a stage with +Z up everything is turned by 90 degrees about X, which takes
(x, y, z) to (x, -z, y), as `UsdLuxDomeLight::OrientToStageUpAxis` turns a dome's image. The rig
remembers the axis it was written for, because USD does not compose the stage's from sublayers and
references; how it stands in a stage with another one is read/placement.py.

asglight's radiance is linear Rec.709. Every space that a stage may have contains it, so amplitudes
stay at or above 0; a light that was given a colour outside Rec.709 comes back with its nearest
component at 0.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from pxr import Usd

from asglight.images import ocio
from asglight.lobes.data import Lobes
from asglight.usd import schema
from asglight.usd.options import UP_AXES, StageOptions
from asglight.usd.stage import rig_data


@dataclass(frozen=True)
class Space:
    """The space of a stage's numbers.

    Attributes:
        up_axis: `Y` or `Z`.
        colorspace: Color Interop ID of the colours.
    """

    up_axis: str = "Y"
    colorspace: str = ocio.REC709


def space_for(options: StageOptions) -> Space:
    """Return the space that options ask for."""
    return Space(options.up_axis, ocio.interop_id(options.colorspace))


def space_of(rig: Usd.Prim) -> Space:
    """Return the space that a rig was written in; a colorspace may be one that nobody knows."""
    up_axis = rig_data(rig).get(schema.UP_AXIS)
    colorspace = rig.GetAttribute(schema.COLORSPACE)
    named = colorspace.Get() if colorspace else None
    return Space(up_axis if up_axis in UP_AXES else Space.up_axis, named or ocio.REC709)


def to_stage(lobes: Lobes, space: Space) -> Lobes:
    """Return lobes as a stage holds them.  [..., N, .]."""
    lobes = in_colorspace(lobes, ocio.REC709, space.colorspace)
    return replace(
        lobes, axes=lobes.axes @ torch.from_numpy(from_y_up(space.up_axis)).to(lobes.axes)
    )


def from_y_up(up_axis: str) -> NDArray[np.float64]:
    """Return the matrix from +Y up to the up axis of a stage, for row vectors.  [3, 3]."""
    if up_axis == "Y":
        return np.eye(3)
    return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def in_colorspace(lobes: Lobes, source: str, target: str) -> Lobes:
    """Return lobes with their amplitudes in another space, by Color Interop ID.  [..., N, .]."""
    if source == target:
        return lobes
    matrix = torch.from_numpy(ocio.matrix(source, target))
    amplitude = lobes.amplitude.double() @ matrix.to(lobes.amplitude.device).T
    # a component of 0 comes back as a rounding below it
    return replace(lobes, amplitude=amplitude.clamp(min=0).to(lobes.amplitude.dtype))
