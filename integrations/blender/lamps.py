# SPDX-License-Identifier: GPL-3.0-or-later
"""One light of a stage as one of Blender's."""

import math

import bpy
import numpy as np

from .animation import Frames, animate, clear
from .plain.rigs import Lamp
from .plain.tracks import Array, Track

TYPES = {"card": "AREA", "sun": "SUN"}

ANGLE_MAX = math.pi
"""Of a sun in Blender, in radians."""

POWER = "asglight_power"
"""The property of a light that holds its own energy, where a gain drives what Blender shows."""

HIDING = ("hide_render", "hide_viewport")
"""What hides an object."""

HIDDEN = "asglight_hidden"
"""The property of an object that its stage hides: what of `HIDING` was set before."""


def energy(lamp: Lamp) -> Track:
    """Return what Blender calls strength.  [T, 1].

    A card that is not normalised by its area shines with strength / pi; a sun's strength is the
    irradiance that a patch facing it gets. Blender's own importer of USD multiplies suns by four.
    """
    factor = math.pi if lamp.kind == "card" else 1.0
    return Track(lamp.brightness.times, factor * lamp.brightness.values)


def sizes(lamp: Lamp, scale: Array) -> Track:
    """Return width and height, or the angle in radians.

    Args:
        lamp: The light.
        scale: What a card's width and height are multiplied by.  [2]
    """
    if lamp.kind == "card":
        return Track(lamp.size.times, lamp.size.values * scale)
    return Track(lamp.size.times, np.radians(lamp.size.values).clip(max=ANGLE_MAX))


def show(data: bpy.types.Light, lamp: Lamp, scale: Array, frames: Frames, power: str) -> None:
    """Give a light of Blender's all that its stage says, but where it is.

    Args:
        data: Of the right type.
        lamp: The light of the stage.
        scale: What a card's width and height are multiplied by.  [2]
        frames: Where time codes are in the scene.
        power: The property that its energy goes to.
    """
    data.exposure = 0.0
    data.normalize = lamp.kind == "sun"
    data.use_temperature = False
    animate(data, power, energy(lamp), frames)
    animate(data, "color", lamp.colour, frames)
    size = sizes(lamp, scale)
    names = ("size", "size_y") if lamp.kind == "card" else ("angle",)
    if lamp.kind == "card":
        data.shape = "RECTANGLE"
    for index, name in enumerate(names):
        values = size.values[:, index : index + 1]
        animate(data, name, Track(size.times, values), frames)


def hide(thing: bpy.types.Object, lamp: Lamp, frames: Frames) -> None:
    """Hide an object while its light is invisible; else whether it is hidden is the user's."""
    if lamp.visible.is_constant and lamp.visible.values.all():
        _show_again(thing)
        return
    if HIDDEN not in thing:
        thing[HIDDEN] = [int(getattr(thing, name)) for name in HIDING]
    hidden = Track(lamp.visible.times, 1.0 - lamp.visible.values)
    for name in HIDING:
        animate(thing, name, hidden, frames, held=True)


def _show_again(thing: bpy.types.Object) -> None:
    """Give an object that an older stage hid back to the user, as it was."""
    if HIDDEN not in thing:
        return
    for name, before in zip(HIDING, thing[HIDDEN], strict=True):
        clear(thing, name)
        setattr(thing, name, bool(before))
    del thing[HIDDEN]
