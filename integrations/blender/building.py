# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig of a stage as a collection of Blender: built, or brought up to date where it is.

    collection  stage_name
      empty     stage_name            the rig: moving or turning it moves or turns all
        empty   lobe_00               turns as the lobe does; has the property `gain`
          light lobe_00 tall          its lights

Objects are found again by where they come from, never by their names, which are the user's.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from .animation import animate, clear, drive
from .lamps import POWER, TYPES, hide, show
from .plain.rigs import Lamp, Place, Rig, quaternions, rotation_matrix
from .plain.tracks import Array, Track, in_one_hemisphere, reduced
from .worlds import PRIM, show_domes

STAGE, GAIN = "asglight_stage", "gain"
SCALE, OFFSET, STRENGTH = "asglight_scale", "asglight_offset", "asglight_strength"
REPRESENTATION, WISHED = "asglight_representation", "asglight_shown_as"
DISTANCE = "asglight_distance"
WORLD, TIME, SEEN = "asglight_use_world", "asglight_set_time", "asglight_seen"
RIG_SIZE = 0.5
"""Of the empty of a rig, in metres."""

UNLIT = "asglight_unlit"
"""Properties of objects: what they were imported from, and how."""


@dataclass(frozen=True)
class Wishes:
    """How a rig is to be built.

    Attributes:
        stage: File of the stage.
        scale: Metres for each of its units.
        distance: Of its cards in metres, as asked for.
        shown_as: The representation, as asked for.
        offset: Frames that its light comes later.
        strength: What all of its light is multiplied by.
        use_world: Whether the World shows its domes.
        seen: Whether cameras see its cards.
        set_time: Whether the scene has its frames and rate.
    """

    stage: str
    scale: float
    distance: float
    shown_as: str
    offset: int
    strength: float
    use_world: bool
    seen: bool
    set_time: bool

    def frames(self, times: Array) -> Array:
        """Return the scene's frames of time codes.  [T] to [T]."""
        return times + self.offset


def rigs_in(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Return the empties of the rigs of a scene."""
    return [one for one in scene.objects if STAGE in one and PRIM in one and one.parent is None]


def parts_of(rig: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """Give the empties of lobes and keys, and their lights, that a stage brought."""
    for one in rig.children_recursive:
        if PRIM in one:
            yield one


def build(
    context: bpy.types.Context, rig: Rig, wishes: Wishes, there: bpy.types.Object | None
) -> bpy.types.Object:
    """Build a rig, or bring one up to date.

    Args:
        context: Whose scene gets it.
        rig: What the stage says.
        wishes: How to build it.
        there: The empty of a rig to bring up to date.

    Returns:
        The empty of the rig.

    Raises:
        OSError: An image cannot be copied.
    """
    name = Path(wishes.stage).stem
    rig = scaled(rig, wishes.strength)
    if there is None:
        collection = bpy.data.collections.new(name)
        context.scene.collection.children.link(collection)
        there = _empty(name, collection, None, "SPHERE")
        there.lock_rotation = (True, True, False)  # the World follows a turn about the vertical
        there.empty_display_size = RIG_SIZE
    collection = there.users_collection[0]
    known = {str(one[PRIM]): one for one in parts_of(there) if one.type == "EMPTY"}
    lights = {str(one[PRIM]): one for one in parts_of(there) if one.type == "LIGHT"}
    remember(there, rig, wishes)
    for path in rig.groups:
        if path not in known:
            known[path] = _empty(path.rpartition("/")[2], collection, there, "SINGLE_ARROW")
        lamps = [lamp for lamp in rig.lamps if lamp.group == path]
        _group(known.pop(path), path, rig, lamps, lights, collection, wishes)
    for gone in (*known.values(), *lights.values()):
        bpy.data.objects.remove(gone)
    if wishes.use_world:
        show_domes(context.scene, rig, wishes.frames, wishes.stage, there)
    return there


def remember(there: bpy.types.Object, rig: Rig, wishes: Wishes) -> None:
    """Note on the empty of a rig what it was imported from, and how."""
    there[STAGE], there[PRIM] = wishes.stage, rig.path
    there[SCALE], there[OFFSET] = wishes.scale, wishes.offset
    there[STRENGTH], there[DISTANCE] = wishes.strength, wishes.distance
    there[WISHED], there[REPRESENTATION] = wishes.shown_as, rig.representation
    there[WORLD], there[TIME], there[SEEN] = wishes.use_world, wishes.set_time, wishes.seen


def scaled(rig: Rig, strength: float) -> Rig:
    """Return a rig whose light is multiplied."""

    def times(light: Track) -> Track:
        return Track(light.times, strength * light.values)

    lamps = tuple(replace(one, brightness=times(one.brightness)) for one in rig.lamps)
    domes = tuple(replace(one, brightness=times(one.brightness)) for one in rig.domes)
    return replace(rig, lamps=lamps, domes=domes)


def _empty(
    name: str, collection: bpy.types.Collection, parent: bpy.types.Object | None, shape: str
) -> bpy.types.Object:
    empty = bpy.data.objects.new(name, None)
    empty.empty_display_type = shape
    empty.parent = parent
    collection.objects.link(empty)
    return empty


def _group(
    empty: bpy.types.Object,
    path: str,
    rig: Rig,
    lamps: list[Lamp],
    lights: dict[str, bpy.types.Object],
    collection: bpy.types.Collection,
    wishes: Wishes,
) -> None:
    """Bring the empty of a lobe or key, and its lights, up to date; take these out of `lights`."""
    empty[PRIM] = path
    if empty.get(UNLIT) != (not lamps):  # else what is hidden is the user's
        empty.hide_viewport = empty.hide_render = not lamps
    empty[UNLIT] = not lamps
    if lamps and GAIN not in empty:
        empty[GAIN] = 1.0
        empty.id_properties_ui(GAIN).update(
            min=0.0, soft_max=4.0, step=0.1, description="The light of its lobe is multiplied by it"
        )
    place = rig.places[path]
    empty.rotation_mode = "QUATERNION"
    animate(empty, "rotation_quaternion", place.rotation, wishes.frames)
    for lamp in lamps:
        light = lights.pop(lamp.path, None)
        if light is None or light.data.type != TYPES[lamp.kind]:
            light = _light(_name(lamp, len(lamps)), lamp, empty, collection, light)
            light.visible_camera = wishes.seen
        light[PRIM] = lamp.path
        _place(light, lamp, place, rig.place, wishes)
        hide(light, lamp, wishes.frames)
        stretch = wishes.scale * lamp.place.scale.values[0, :2]
        show(light.data, lamp, stretch, wishes.frames, f'["{POWER}"]')
        clear(light.data, "energy")
        inputs = {"power": (light.data, f'["{POWER}"]'), "gain": (empty, f'["{GAIN}"]')}
        drive(light.data, "energy", "power * gain", inputs)


def _name(lamp: Lamp, count: int) -> str:
    """Return the name of a light: its lobe's, and which of several it is."""
    group = lamp.group.rpartition("/")[2]
    own = lamp.path.removeprefix(lamp.group).strip("/").replace("/", " ")
    return f"{group} {own or 'light'}" if count > 1 or not own else f"{group} {own}"


def _light(
    name: str,
    lamp: Lamp,
    empty: bpy.types.Object,
    collection: bpy.types.Collection,
    replaced: bpy.types.Object | None,
) -> bpy.types.Object:
    """Make a light; one of another type that was there gives it its name."""
    if replaced is not None:
        name = replaced.name
        bpy.data.objects.remove(replaced)
    light = bpy.data.objects.new(name, bpy.data.lights.new(name, TYPES[lamp.kind]))
    light.parent = empty
    light.rotation_mode = "QUATERNION"
    collection.objects.link(light)
    return light


def _place(light: bpy.types.Object, lamp: Lamp, group: Place, rig: Place, wishes: Wishes) -> None:
    """Place a light below the empty of its lobe, which stands at the origin of the rig."""
    own = lamp.place
    times = np.unique(
        np.concatenate([own.rotation.times, own.position.times, group.rotation.times])
    )
    position, turn = [], []
    apart = own.position.at(times) - rig.position.at(times)
    for offset, mine, lobes in zip(
        apart, own.rotation.at(times), group.rotation.at(times), strict=True
    ):
        back = rotation_matrix(lobes / np.linalg.norm(lobes)).T
        position.append(wishes.scale * back @ offset)
        turn.append(back @ rotation_matrix(mine / np.linalg.norm(mine)))
    turns = in_one_hemisphere(quaternions(np.array(turn)))
    animate(light, "location", _still(times, np.array(position)), wishes.frames)
    animate(light, "rotation_quaternion", _still(times, turns), wishes.frames)


STILL = 1e-6
"""Of a card's distance, and of a quaternion's components: what turning to and fro rounds off."""


def _still(times: Array, values: Array) -> Track:
    """Return a track, of one value where the rest is rounding."""
    if np.ptp(values, axis=0).max() <= STILL * max(np.abs(values).max(), 1.0):
        return Track(times[:1], values[:1])
    return reduced(Track(times, values))
