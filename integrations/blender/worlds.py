# SPDX-License-Identifier: GPL-3.0-or-later
"""Domes of a stage as Blender's World."""

from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Matrix, Quaternion

from .animation import Frames, animate, drive, forget
from .plain import colours
from .plain.image_files import ImageSequence, image_sequence
from .plain.rigs import Dome, Rig
from .plain.tracks import Track

SIDE = "asglight_side"
"""The property of an image that says which node shows it."""

PRIM = "asglight_prim"
"""The property of a Background that says which dome it is."""

DEFAULT_GREYS = (0.0500, 0.0509)
"""What a new World shines with in every channel, made by hand or with a new file. Nobody chose it,
and it is as bright as some of the light of a stage."""

OWN, BEFORE = "asglight_stage", "asglight_before"
"""Properties of a World: whose it is, and which one was there."""


def show_domes(
    scene: bpy.types.Scene,
    rig: Rig,
    frames: Frames,
    stage: str,
    turned_by: bpy.types.Object | None = None,
) -> None:
    """Make the scene's World show a rig's domes, and nothing where it has none.

    Args:
        scene: Its World is kept with a fake user, unless it is one made here.
        rig: The rig.
        frames: Where time codes are in the scene.
        stage: File of the stage; copies of images that Blender cannot play where they are go
            to a folder beside it.
        turned_by: An object whose turn about the vertical turns the domes.

    Raises:
        OSError: An image cannot be copied.
    """
    world = scene.world
    if world is None or OWN not in world:
        before = world
        world = bpy.data.worlds.new(f"asglight {Path(stage).stem}")
        if before is not None:
            before.use_fake_user = True
            world[BEFORE] = before
        scene.world = world
    world[OWN] = stage
    world.use_nodes = True
    tree = world.node_tree
    forget(tree)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    black = tree.nodes.new("ShaderNodeBackground")
    black.inputs["Color"].default_value = (0, 0, 0, 1)
    black.location = (-200, 300)
    shown = black.outputs[0]
    for index, dome in enumerate(rig.domes):
        background = _dome(tree, dome, rig, frames, folder_of_copies(stage))
        if index == 0:
            shown = background.outputs[0]
            continue
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(shown, both.inputs[0])
        tree.links.new(background.outputs[0], both.inputs[1])
        shown = both.outputs[0]
    if rig.domes:
        tree.nodes.remove(black)
    tree.links.new(shown, output.inputs["Surface"])
    if turned_by is not None:
        _turn(tree, turned_by)


def folder_of_copies(stage: str) -> Path:
    """Return the folder beside a stage for images that Blender cannot play where they are."""
    path = Path(stage)
    return path.with_name(f"{path.stem}_images")


def show_nothing_grey(scene: bpy.types.Scene) -> bool:
    """Make a World that is as Blender makes new ones black; return whether all is well now.

    A stage without a dome says nothing of the surroundings, and a new World is grey.
    """
    world = scene.world
    if world is None:
        return True
    nodes = list(world.node_tree.nodes) if world.use_nodes and world.node_tree else []
    backgrounds = [node for node in nodes if node.bl_idname == "ShaderNodeBackground"]
    if len(backgrounds) > 1 or any(node.inputs["Color"].is_linked for node in backgrounds):
        return False
    colour = backgrounds[0].inputs["Color"].default_value if backgrounds else world.color
    values = np.array(colour[:3])
    if any(np.allclose(values, grey, rtol=2e-3, atol=0) for grey in DEFAULT_GREYS):
        colour[0] = colour[1] = colour[2] = 0.0
        values[:] = 0
    return not values.any()


def _dome(
    tree: bpy.types.NodeTree, dome: Dome, rig: Rig, frames: Frames, copies: Path
) -> bpy.types.Node:
    """Build the nodes of one dome; return the last, a Background."""
    name = dome.path.rpartition("/")[2]
    background = tree.nodes.new("ShaderNodeBackground")
    background.name = background.label = name
    background[PRIM] = dome.path
    background.location = (-200, 0)
    tint = tree.nodes.new("ShaderNodeVectorMath")
    tint.operation, tint.name, tint.label = "MULTIPLY", f"{name} colour", "colour"
    tint.location = (-400, 0)
    tree.links.new(tint.outputs[0], background.inputs["Color"])
    lit = _lit(dome)
    animate(tree, _input(background, "Strength"), lit, frames)
    path = f'nodes["{tint.name}"].inputs[1].default_value'
    animate(tree, path, dome.colour, frames)
    if dome.images:
        images = image_sequence(dome.images, copies)
        place = _mapping(tree, dome, name, frames)
        tree.links.new(_picture(tree, dome, images, name, rig, place, frames), tint.inputs[0])
    else:
        tint.inputs[0].default_value = (1, 1, 1)
    return background


def _lit(dome: Dome) -> Track:
    """Return the strength of a dome, zero while it is invisible."""
    if dome.visible.is_constant:
        return Track(dome.brightness.times, dome.brightness.values * dome.visible.values[0])
    times = np.union1d(dome.brightness.times, dome.visible.times)
    return Track(times, dome.brightness.at(times) * dome.visible.held_at(times))


def _mapping(tree: bpy.types.NodeTree, dome: Dome, name: str, frames: Frames) -> bpy.types.Node:
    """Return the node that turns directions of the scene into those of Blender's image.

    The middle of an image is +Z of the dome's prim, and +X of a texture in Blender; its top is +Y
    there and +Z here.
    """
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    coordinates.location = (-1200, 0)
    turn = tree.nodes.new("ShaderNodeMapping")
    turn.vector_type, turn.name, turn.label = "POINT", f"{name} turn", "turn"
    turn.location = (-1000, 0)
    tree.links.new(coordinates.outputs["Generated"], turn.inputs["Vector"])
    to_image = Matrix(((0, 0, 1), (1, 0, 0), (0, 1, 0)))
    angles: list[Euler] = []
    for quaternion in dome.place.rotation.values:
        matrix = to_image @ Quaternion(quaternion).to_matrix().transposed()
        angles.append(matrix.to_euler("XYZ", angles[-1]) if angles else matrix.to_euler("XYZ"))
    track = Track(dome.place.rotation.times, np.array([tuple(one) for one in angles]))
    animate(tree, _input(turn, "Rotation"), track, frames)
    return turn


def _picture(
    tree: bpy.types.NodeTree,
    dome: Dome,
    images: ImageSequence,
    name: str,
    rig: Rig,
    place: bpy.types.Node,
    frames: Frames,
) -> bpy.types.NodeSocket:
    """Return the socket that has the dome's image at every frame.

    Two nodes show the images in turn, and each changes while the other is seen alone. Between the
    times of two images they are mixed, so that light between frames is between that of the frames.
    """
    count = len(images.numbers)
    nodes = []
    for side in range(2 if count > 1 else 1):
        node = tree.nodes.new("ShaderNodeTexEnvironment")
        node.name, node.label = f"{name} image {side}", f"{name}, {('even', 'odd')[side]} images"
        node.location = (-800, -300 * side)
        tree.links.new(place.outputs[0], node.inputs["Vector"])
        node.image = _image(images, side, rig)
        if count > 1:
            _play(tree, node, dome, images, side, frames)
        nodes.append(node)
    if count <= 1:
        return nodes[0].outputs[0]
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type, mix.name, mix.label = "RGBA", f"{name} mix", "between images"
    mix.location = (-600, 0)
    factor, first, second = (
        next(socket for socket in mix.inputs if socket.identifier == identifier)
        for identifier in ("Factor_Float", "A_Color", "B_Color")
    )
    tree.links.new(nodes[0].outputs[0], first)
    tree.links.new(nodes[1].outputs[0], second)
    turns = (np.arange(count) % 2).astype(float)[:, None]
    path = f'nodes["{mix.name}"].inputs[{list(mix.inputs).index(factor)}].default_value'
    animate(tree, path, Track(dome.times, turns), frames)
    return next(socket for socket in mix.outputs if socket.identifier == "Result_Color")


def _image(images: ImageSequence, side: int, rig: Rig) -> bpy.types.Image:
    """Load an image for one of the nodes, or load it again."""
    path = str(images.first)
    there = [one for one in bpy.data.images if one.get(SIDE) == side and one.filepath == path]
    image = there[0] if there else bpy.data.images.load(path)
    image[SIDE] = side
    if there:
        image.reload()
    if images.numbers:
        image.source = "SEQUENCE"
    image.name = f"{images.first.stem} {('even', 'odd')[side]}" if images.numbers else image.name
    space = colours.BLENDER_NAMES.get(rig.colourspace)
    if space is not None:
        image.colorspace_settings.name = space
    return image


def _play(
    tree: bpy.types.NodeTree,
    node: bpy.types.Node,
    dome: Dome,
    images: ImageSequence,
    side: int,
    frames: Frames,
) -> None:
    """Say which image a node shows when.

    A sequence of one frame shows file `1 + offset` at every frame of the scene, so the offset
    chooses the file, also where there is none for some frames.
    """
    user = node.image_user
    user.frame_start, user.frame_duration = 1, 1
    user.use_auto_refresh = True
    numbers = np.array(images.numbers, dtype=float)[side::2]
    # it changes when the other node's image is seen alone
    begins = np.concatenate([dome.times[:1], dome.times[side + 1 :: 2]])[: len(numbers)]
    path = f'nodes["{node.name}"].image_user.frame_offset'
    animate(tree, path, Track(begins, numbers[:, None] - 1), frames, held=True)


def _turn(tree: bpy.types.NodeTree, turned_by: bpy.types.Object) -> None:
    """Turn all domes with an object: before their own Mapping comes one that it drives."""
    for own in [node for node in tree.nodes if node.bl_idname == "ShaderNodeMapping"]:
        rig = tree.nodes.new("ShaderNodeMapping")
        rig.vector_type, rig.label, rig.location = "POINT", "turn of the rig", (-1100, 200)
        rig.name = f"{own.name} of the rig"
        link = own.inputs["Vector"].links[0]
        tree.links.new(link.from_socket, rig.inputs["Vector"])
        tree.links.new(rig.outputs[0], own.inputs["Vector"])
        inputs = {"turn": (turned_by, "rotation_euler[2]")}
        drive(tree, _input(rig, "Rotation"), "-turn", inputs, index=2)


def _input(node: bpy.types.Node, name: str) -> str:
    index = node.inputs.find(name)
    return f'nodes["{node.name}"].inputs[{index}].default_value'
