# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracks as F-curves, and constants as plain values."""

from collections.abc import Callable

import bpy
import numpy as np

from .plain.tracks import Array, Track

_INTERPOLATION = {"CONSTANT": 0, "LINEAR": 1}
"""Blender's own numbers, which setting all keys at once takes."""

Frames = Callable[[Array], Array]
"""From a stage's time codes to Blender's frames.  [T] to [T]."""


def animate(
    owner: bpy.types.ID, path: str, track: Track, frames: Frames, held: bool = False
) -> None:
    """Give a property a track; what animated it before is gone.

    Args:
        owner: The data-block.
        path: From the data-block to the property, as Blender writes it.
        track: Values; one of more components goes to a property that has as many.
        frames: Where its times are in the scene.
        held: Whether a value holds until the next.
    """
    clear(owner, path)
    first = track.values[0].tolist()
    set_value(owner, path, first if len(first) > 1 else first[0])
    if track.is_constant:
        return
    bag = _channels(owner)
    for index, values in enumerate(track.values.T):
        curve = bag.fcurves.new(path, index=index)
        points = curve.keyframe_points
        points.add(len(values))
        points.foreach_set("co", np.stack([frames(track.times), values], axis=-1).ravel())
        kind = _INTERPOLATION["CONSTANT" if held else "LINEAR"]
        points.foreach_set("interpolation", np.full(len(values), kind, np.int32))
        curve.update()


def set_value(owner: bpy.types.ID, path: str, value: object) -> None:
    """Set a property that is given by its path."""
    if path.startswith('["'):
        owner[path[2:-2]] = value
        return
    parent, _, name = path.rpartition(".")
    holder = owner.path_resolve(parent) if parent else owner
    kind = holder.bl_rna.properties[name].type
    if kind in {"BOOLEAN", "INT"} and not isinstance(value, list):
        value = bool(value) if kind == "BOOLEAN" else round(value)
    setattr(holder, name, value)


def clear(owner: bpy.types.ID, path: str) -> None:
    """Remove what animates a property."""
    data = owner.animation_data
    if data is None or data.action is None or data.action_slot is None:
        return
    for layer in data.action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(data.action_slot)
            for curve in [curve for curve in bag.fcurves if curve.data_path == path] if bag else []:
                bag.fcurves.remove(curve)


def forget(owner: bpy.types.ID) -> None:
    """Remove all that animates a data-block, and its action where nothing else has it."""
    if owner.animation_data is None:
        return
    action = owner.animation_data.action
    owner.animation_data_clear()
    if action is not None and action.users == 0:
        bpy.data.actions.remove(action)


def _channels(owner: bpy.types.ID) -> bpy.types.ActionChannelbag:
    """Return where a data-block's curves are, made if it has none."""
    data = owner.animation_data or owner.animation_data_create()
    if data.action is None:
        data.action = bpy.data.actions.new(f"asglight {owner.name}")
    action = data.action
    if data.action_slot is None:
        data.action_slot = action.slots.new(id_type=owner.id_type, name=owner.name)
    layer = action.layers[0] if action.layers else action.layers.new("asglight")
    strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
    return strip.channelbag(data.action_slot, ensure=True)


def drive(
    owner: bpy.types.ID,
    path: str,
    expression: str,
    inputs: dict[str, tuple[bpy.types.ID, str]],
    index: int = -1,
) -> None:
    """Let a property follow others, by an expression simple enough to need no trust in scripts.

    Args:
        owner: The data-block.
        path: Of the property.
        expression: Of the names of the inputs.
        inputs: By name, a data-block and the path from it.
        index: Of the component, of a property that has several.
    """
    owner.driver_remove(path, index)
    driver = owner.driver_add(path, index).driver
    driver.type = "SCRIPTED"
    for name, (source, source_path) in inputs.items():
        variable = driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        target.id_type = source.id_type
        target.id = source
        target.data_path = source_path
    driver.expression = expression
