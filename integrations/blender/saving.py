# SPDX-License-Identifier: GPL-3.0-or-later
"""Save light edits: what a rig is in the scene at all times, handed to edits.py."""

import math
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ExportHelper

from . import building, reading, worlds
from .lamps import TYPES
from .plain import rigs
from .plain.edits import Seen, View, write_edits
from .plain.rigs import Rig
from .plain.tracks import Array, in_one_hemisphere


class ASGLIGHT_OT_save_edits(bpy.types.Operator, ExportHelper):  # noqa: N801 - Blender's way
    """Write what was changed of the lights as a layer over their stage, which stays as it is."""

    bl_idname = "asglight.save_edits"
    bl_label = "Save light edits"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender reads a set
    filename_ext = ".usda"
    filter_glob: StringProperty(default="*.usda;*.usdc;*.usd", options={"HIDDEN"})
    rig: StringProperty(name="Rig", options={"HIDDEN"}, description="Empty of the rig")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is a rig."""
        return bool(building.rigs_in(context.scene))

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask where the layer goes."""
        stage = Path(_rig(context, self.rig)[building.STAGE])
        self.filepath = str(stage.with_name(f"{stage.stem}_edits.usda"))
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Look at every time and write."""
        rig = _rig(context, self.rig)
        target = Path(bpy.path.abspath(self.filepath)).resolve()
        source = Path(rig[building.STAGE])
        try:
            view = seen_of(context, rig)
            words = write_edits(source, target, rig[worlds.PRIM], view)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, f"{source}: {error}")
            return {"CANCELLED"}
        if not words:
            self.report({"WARNING"}, f"{rig.name}: nothing differs from the stage; nothing written")
            return {"CANCELLED"}
        for line in words:
            self.report({"INFO"}, f"edited: {line}")
        return {"FINISHED"}


def _rig(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """Return the rig of a name, or of the active object, or the first."""
    found = building.rigs_in(context.scene)
    active = context.view_layer.objects.active
    while active is not None and active.parent is not None:
        active = active.parent
    for one in found:
        if one.name == name or (not name and one == active):
            return one
    return found[0]


def seen_of(context: bpy.types.Context, rig: bpy.types.Object) -> View:
    """Return what a rig is at every frame of its stage, and at every sample between.

    Raises:
        ValueError: The stage cannot be opened or lacks the rig, or what is seen is nothing that it
            could hold.
    """
    if not rig[building.STRENGTH]:
        raise ValueError(
            "was imported with strength 0, which leaves no light to compare; import it again with "
            "another"
        )
    scene = context.scene
    stage = rigs.opened(rig[building.STAGE])
    prim = stage.GetPrimAtPath(rig[worlds.PRIM])
    if not prim:
        raise ValueError(f"has no {rig[worlds.PRIM]} any more; import it again")
    representation = str(rig[building.REPRESENTATION])
    if prim.GetVariantSets().HasVariantSet(rigs.VARIANT_SET):
        stage.SetEditTarget(stage.GetSessionLayer())
        prim.GetVariantSet(rigs.VARIANT_SET).SetVariantSelection(representation)
    known = rigs.read_rig(prim, reading.working_space())
    shown = _shown(rig, known)
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    every = [np.arange(math.ceil(first), math.floor(last) + 1, dtype=float)]
    for lamp in known.lamps:
        place = lamp.place
        tracks = (lamp.brightness, lamp.colour, lamp.size, place.rotation, place.position)
        every += [track.times for track in tracks if not track.is_constant]
    times = np.unique(np.concatenate(every))
    for part in building.parts_of(rig):
        part.update_tag()  # a gain that a script set is told to nobody else
    kept = scene.frame_current, scene.frame_subframe
    try:
        moments = list(_moments(context, rig, shown, times))
    finally:
        scene.frame_set(kept[0], subframe=kept[1])
    paths = {path for found, _ in moments for path in found}
    lights = [_together(path, [found.get(path) for found, _ in moments]) for path in sorted(paths)]
    turn = np.array([turn for _, turn in moments])
    return View(representation, times, lights, turn, reading.working_space())


def _shown(rig: bpy.types.Object, known: Rig) -> list[bpy.types.Object]:
    """Return the lights that the stage has too.

    Raises:
        ValueError: One was made a light of another type.
    """
    types = {lamp.path: TYPES[lamp.kind] for lamp in known.lamps}
    found = [one for one in building.parts_of(rig) if one.type == "LIGHT"]
    found = [one for one in found if str(one[worlds.PRIM]) in types]
    for one in found:
        expected = types[str(one[worlds.PRIM])]
        if one.data.type != expected:
            raise ValueError(
                f"cannot hold {one.name}, a {one.data.type.title()} light now; expected "
                f"{expected.title()}. Change its type back, or delete it"
            )
    return found


Moment = tuple[Array, Array | None, bool, Array | None, Array | None]
"""Light, size, visible, position, rotation: as in `Seen`, at one time."""


def _moments(
    context: bpy.types.Context,
    rig: bpy.types.Object,
    lights: list[bpy.types.Object],
    times: Array,
) -> Iterator[tuple[dict[str, Moment], float]]:
    """Give all lights by prim, and the turn of the rig in degrees, at each time."""
    scene, scale = context.scene, float(rig[building.SCALE])
    strength = float(rig[building.STRENGTH])
    for time in times.tolist():
        frame = time + rig[building.OFFSET]
        scene.frame_set(math.floor(frame), subframe=frame - math.floor(frame))
        graph = context.evaluated_depsgraph_get()
        root = rig.evaluated_get(graph)
        back = root.matrix_world.inverted()
        found = {}
        for light in lights:
            found[str(light[worlds.PRIM])] = _moment(
                light.evaluated_get(graph), back, scale, strength
            )
        found |= _domes(scene, rig, strength)
        yield found, math.degrees(root.matrix_world.to_euler("XYZ").z)


def _moment(light: bpy.types.Object, back: object, scale: float, strength: float) -> Moment:
    data = light.data
    place = back @ light.matrix_world
    lengths = np.array(place.to_scale())
    colour = np.array(data.color)
    if data.use_temperature:
        colour = colour * np.array(data.temperature_color)
    value = data.energy * 2.0**data.exposure
    if data.type == "AREA":
        height = data.size_y if data.shape in {"RECTANGLE", "ELLIPSE"} else data.size
        metres = np.array([data.size, height]) * lengths[:2]
        size = metres / scale
        value /= math.pi * (metres.prod() if data.normalize else 1.0)
    else:
        size = np.degrees([data.angle])
    position = np.array(place.translation) / scale
    return (
        value / strength * colour,
        size,
        not light.hide_render,
        position,
        np.array(place.to_quaternion()),
    )


def _domes(scene: bpy.types.Scene, rig: bpy.types.Object, strength: float) -> dict[str, Moment]:
    """Return the domes that the World shows, where it is the rig's."""
    world = scene.world
    if world is None or world.get(worlds.OWN) != rig[building.STAGE]:
        return {}
    found = {}
    for node in world.node_tree.nodes:
        if worlds.PRIM not in node:
            continue
        tint = world.node_tree.nodes[f"{node.name} colour"]
        light = node.inputs["Strength"].default_value * np.array(tint.inputs[1].default_value)
        found[str(node[worlds.PRIM])] = (light / strength, None, True, None, None)
    return found


def _together(path: str, moments: list[Moment | None]) -> Seen:
    """Return a light over time."""
    there = [one for one in moments if one is not None]
    light, size, visible, position, rotation = zip(*there, strict=True)
    turns = None if rotation[0] is None else in_one_hemisphere(np.array(rotation))
    return Seen(
        path,
        np.array(light),
        None if size[0] is None else np.array(size),
        np.array(visible),
        None if position[0] is None else np.array(position),
        turns,
    )


CLASSES = (ASGLIGHT_OT_save_edits,)
