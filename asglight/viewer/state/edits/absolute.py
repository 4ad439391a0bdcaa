# SPDX-License-Identifier: Apache-2.0
"""What a lobe is in an artist's terms, and the edits that bring it to other values.

Azimuth is 0 at +Z and 90 at +X, elevation 90 at +Y. Roll is how far the lobe's x axis is turned
from the horizontal about its direction. Width and height are full angles at half of the peak, along
the x and the y axis; of a key they are those of its rectangle. Intensity is in stops from middle
grey, of the radiance at the peak, or of the rectangle.

An edit says by how much. So a value that is set for one frame is met there, and all other frames of
the edit change alike: a lamp that moves goes on moving.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from asglight.lobes import Form, Lobes, asg
from asglight.luminance import LUMINANCE
from asglight.usd.lights.colour_temperature import temperature_of
from asglight.viewer.state.balls import Rgb
from asglight.viewer.state.display import MIDDLE_GREY
from asglight.viewer.state.edits import rectangles
from asglight.viewer.state.edits.edit import LOG2_MAX, TINT_MIN, Edit, Span
from asglight.viewer.uniforms.outlines import half_angles

GRID = 129
"""Sharpnesses that are tried at a time: after two rounds the step is 1e-3 of an octave."""

ROUNDS = 3
"""Of trying; the angle is then met to 1e-5 of itself."""


@dataclass(frozen=True)
class Lamp:
    """One lobe of one frame.

    Attributes:
        azimuth: Degrees around +Y.
        elevation: Degrees above the horizon.
        roll: Degrees about the direction.
        width: Degrees at half of the peak along x, 180 where it does not fall so far; of a key
            those of its rectangle.
        height: The same along y.
        intensity: Stops of the peak's luminance from middle grey, or of the rectangle's; -inf for
            black.
        colour: Linear RGB of luminance 1.
        kelvin: The nearest colour temperature.
        tint: Stops of green from that temperature's colour.
    """

    azimuth: float
    elevation: float
    roll: float
    width: float
    height: float
    intensity: float
    colour: Rgb
    kelvin: float
    tint: float

    @property
    def radiance(self) -> float:
        """Luminance of the peak, or of the rectangle."""
        return MIDDLE_GREY * 2.0**self.intensity


def lamp_of(lobe: Lobes, *, is_key: bool = False) -> Lamp:
    """Return what a lobe is, or a key.

    Args:
        lobe: One lobe.  [.]
        is_key: Whether it is the lobe of a key's rectangle.
    """
    axes = lobe.axes.to("cpu", torch.float64).numpy()
    x, y, z = axes[2]
    elevation = math.degrees(math.atan2(y, math.hypot(x, z)))
    right, up = level(axes[2])
    roll = math.degrees(math.atan2(axes[0] @ up, axes[0] @ right))
    halves = rectangles.half_angles(lobe) if is_key else half_angles(lobe[None])[0]
    width, height = np.degrees(2 * halves.numpy())
    gain = rectangles.gain(lobe) if is_key else 1.0
    red, green, blue = (gain * float(value) for value in lobe.amplitude)
    luminance = float(np.dot(LUMINANCE, (red, green, blue)))
    colour: Rgb = (1.0, 1.0, 1.0)
    if luminance > 0:
        colour = red / luminance, green / luminance, blue / luminance
    kelvin, tint = temperature_of(colour)
    return Lamp(
        azimuth=math.degrees(math.atan2(x, z)),
        elevation=elevation,
        roll=roll,
        width=float(width),
        height=float(height),
        intensity=math.log2(luminance / MIDDLE_GREY) if luminance > 0 else -math.inf,
        colour=colour,
        kelvin=kelvin,
        tint=tint,
    )


def edit_of(
    lobe: Lobes,
    place: tuple[int, Span | None],
    field: str,
    value: float,
    *,
    is_key: bool = False,
) -> Edit:
    """Return the edit that brings one value of a lobe to another.

    Args:
        lobe: The lobe in the frame in which the value is to be met.  [.]
        place: Index of the lobe, and where the edit holds; None for all frames.
        field: One of FIELDS.
        value: In the units of `Lamp`.
        is_key: Whether it is the lobe of a key's rectangle.
    """
    index, span = place
    lamp = lamp_of(lobe, is_key=is_key)
    if field == "intensity":
        stops = value - lamp.intensity if math.isfinite(lamp.intensity) else 0.0
        stops = max(-LOG2_MAX, min(LOG2_MAX, stops))
        return Edit(index, span, gain_log2=(stops, stops, stops))
    if field in ("width", "height"):
        axis = int(field == "height")
        if is_key:
            powers, stops = rectangles.sized(lobe, axis, math.radians(value) / 2)
            return Edit(index, span, sharpness_log2=powers, gain_log2=(stops, stops, stops))
        power = _power(lobe, axis, math.radians(value) / 2)
        powers = (power, power) if lobe.form is Form.SG else (power * (1 - axis), power * axis)
        return Edit(index, span, sharpness_log2=powers)
    axes = lobe.axes.to("cpu", torch.float64).numpy()
    around = {
        "azimuth": (np.array([0.0, 1.0, 0.0]), value - lamp.azimuth),
        "elevation": (-level(axes[2])[0], value - lamp.elevation),
        "roll": (axes[2], value - lamp.roll),
    }
    axis_of_turn, degrees = around[field]
    return Edit(index, span, rotation=_quaternion(axis_of_turn, math.radians(degrees)))


def colour_edit(lobe: Lobes, place: tuple[int, Span | None], colour: Sequence[float]) -> Edit:
    """Return the edit that gives a lobe another colour and leaves its luminance.

    Args:
        lobe: The lobe in the frame in which the colour is to be met.  [.]
        place: Index of the lobe, and where the edit holds; None for all frames.
        colour: Linear RGB of any luminance above 0.
    """
    before = np.maximum(lamp_of(lobe).colour, TINT_MIN)
    wanted = np.maximum(np.asarray(colour, dtype=np.float64), 0)
    luminance = float(wanted @ LUMINANCE)
    if luminance <= 0:
        return Edit(place[0], place[1])
    stops = np.log2(np.maximum(wanted / luminance, TINT_MIN) / before)
    red, green, blue = (float(value) for value in stops)
    return Edit(*place, gain_log2=(red, green, blue))


def level(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the horizontal axis and the upward one at right angles to a direction.  [3] each.

    Straight up and down, where every axis is horizontal, it is +X.
    """
    right = np.cross([0.0, 1.0, 0.0], direction)
    length = float(np.linalg.norm(right))
    right = right / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])  # 1e-9: its rounding
    return right, np.cross(direction, right)


def _quaternion(axis: np.ndarray, radians: float) -> tuple[float, float, float, float]:
    x, y, z = (float(value) for value in np.sin(radians / 2) * axis)
    return math.cos(radians / 2), x, y, z


def _power(lobe: Lobes, axis: int, half_angle: float) -> float:
    """Return the power of 2 by which a sharpness has to grow for a half angle."""
    before = float(lobe.sharpness[axis])
    low, high = math.log2(asg.SHARPNESS_MIN), math.log2(asg.SHARPNESS_MAX)
    for _ in range(ROUNDS):
        powers = torch.linspace(low, high, GRID, dtype=torch.float64)
        tried = replace(
            lobe.to("cpu", torch.float64)[None].select(torch.zeros(GRID, dtype=torch.long)),
            sharpness=lobe.sharpness.to(torch.float64).repeat(GRID, 1),
        )
        tried.sharpness[:, axis] = torch.exp2(powers)
        if lobe.form is Form.SG:
            tried.sharpness[:, 1 - axis] = torch.exp2(powers)
        angles = half_angles(tried)[:, axis]  # falling
        place = int((angles >= half_angle).sum())
        low = float(powers[max(place - 1, 0)])
        high = float(powers[min(place, GRID - 1)])
    return (low + high) / 2 - math.log2(before)
