# SPDX-License-Identifier: GPL-3.0-or-later
"""Fit lights from the World's image, by the `asglight` command that the user has."""

import math
from pathlib import Path

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from . import building
from .plain.command import Images, Run, fit_line, has_keys, pattern_of, shown_files
from .preferences import command
from .worlds import BEFORE

TICK = 0.1
"""Seconds between two looks at the command."""

IMAGE_TURN = math.pi / 2
"""A World without a turn has the middle of its image at +X, a stage in Blender at -Y."""

TILT_MAX = 1e-4
"""Radians of a tilt that is rounding."""

NO_KEYS, KEYS = "none", "auto"


class ASGLIGHT_OT_fit_world(bpy.types.Operator):  # noqa: N801 - Blender's way to name classes
    """Fit lights to the World's image or sequence with asglight, and import them in its place."""

    bl_idname = "asglight.fit_world"
    bl_label = "Fit lights from World HDRI"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender reads a set
    filepath: StringProperty(
        name="Stage", subtype="FILE_PATH", description="Where the fitted stage is written"
    )
    filter_glob: StringProperty(default="*.usda;*.usdc;*.usdz", options={"HIDDEN"})
    keys: EnumProperty(
        name="Lights",
        items=(
            (NO_KEYS, "Lobes", "All light as lobes"),
            (KEYS, "Keys and rest", "A light for each lamp, and an image for the rest"),
        ),
        default=NO_KEYS,
    )
    distance: FloatProperty(name="Card distance", default=100.0, min=0.01, unit="LENGTH")
    _run: Run | None = None
    _timer: bpy.types.Timer | None = None
    _offset = 0
    _turn = 0.0
    _strength = 1.0

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Tell whether there is an image to fit."""
        return _environment(context.scene) is not None

    def invoke(self, context: bpy.types.Context, _: bpy.types.Event) -> set[str]:
        """Ask where the stage goes."""
        node = _environment(context.scene)
        if not self.filepath and node is not None:
            image = Path(bpy.path.abspath(node.image.filepath))
            self.filepath = str(image.with_name(f"{image.name.split('.')[0]}_lights.usdc"))
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the command; without a window, wait for it."""
        try:
            self._start(context)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background:
            assert self._run is not None
            return self._done(context, self._run.wait())
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Show how far it is; Escape ends it."""
        assert self._run is not None
        if event.type == "ESC":
            self._run.cancel()
            self._tidy(context)
            self.report({"INFO"}, "asglight: cancelled; nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        status = self._run.poll()
        context.window_manager.progress_update(round(100 * self._run.share))
        words = f"asglight: {self._run.share:.0%}, {self._run.line or 'starting'}   (Esc cancels)"
        context.workspace.status_text_set(words)
        if status is None:
            return {"RUNNING_MODAL"}
        self._tidy(context)
        return self._done(context, status)

    def cancel(self, context: bpy.types.Context) -> None:
        """End the command where Blender ends or opens a file; no file may have been chosen yet."""
        if self._run is None:
            return
        self._run.cancel()
        self._tidy(context)

    def _start(self, context: bpy.types.Context) -> None:
        """Start the command.

        Raises:
            OSError: It cannot be started.
            ValueError: There is nothing to fit, or the command cannot do it.
        """
        node = _environment(context.scene)
        if node is None:
            raise ValueError("the World has no environment image; expected one to fit")
        self._turn, self._strength = _turn_of(node), _strength_of(node)
        images = _images(node, context.scene)
        self._offset = 0 if images.first is None else _offset_of(node)
        asked = "" if self.keys == NO_KEYS else self.keys
        found = command()
        if asked and not has_keys(found):
            raise ValueError(f"{found}: has no --keys; expected a newer asglight")
        render = context.scene.render
        rate = render.fps / render.fps_base
        stage = bpy.path.abspath(self.filepath)
        self._run = Run(fit_line(found, images, stage, rate, asked))

    def _done(self, context: bpy.types.Context, status: int) -> set[str]:
        """Import what was fitted, or say what the command said."""
        assert self._run is not None
        if status:
            self.report({"ERROR"}, self._run.line or f"asglight: ended with status {status}")
            return {"CANCELLED"}
        bpy.ops.import_scene.asglight(
            filepath=self.filepath,
            distance=self.distance,
            strength=self._strength,
            offset=self._offset,
            set_time=False,
        )
        stage = str(Path(bpy.path.abspath(self.filepath)).resolve())
        for rig in building.rigs_in(context.scene):
            if rig[building.STAGE] == stage:
                rig.rotation_euler.z = self._turn
        return {"FINISHED"}

    def _tidy(self, context: bpy.types.Context) -> None:
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        manager.progress_end()
        if context.workspace is not None:  # as Blender ends there is none
            context.workspace.status_text_set(None)


def _environment(scene: bpy.types.Scene) -> bpy.types.Node | None:
    """Return the World's node that has an environment image."""
    world = scene.world
    if world is not None and BEFORE in world:  # what was imported is no image of the set
        world = world[BEFORE]
    if world is None or not world.use_nodes or world.node_tree is None:
        return None
    for node in world.node_tree.nodes:
        if node.bl_idname == "ShaderNodeTexEnvironment" and node.image is not None:
            return node
    return None


def _images(node: bpy.types.Node, scene: bpy.types.Scene) -> Images:
    """Return the files of a node's image.

    Raises:
        ValueError: It has none on disk, or is no latlong.
    """
    image, user = node.image, node.image_user
    if node.projection != "EQUIRECTANGULAR":
        raise ValueError(f"{image.name}: is a mirror ball; expected an equirectangular image")
    if image.source not in {"FILE", "SEQUENCE"} or not image.filepath or image.packed_file:
        raise ValueError(f"{image.name}: is not on disk; save or unpack it first")
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == "FILE":
        return Images(path)
    first, last = shown_files(
        (scene.frame_start, scene.frame_end),
        (user.frame_start, user.frame_duration, user.frame_offset),
    )
    return Images(pattern_of(path), first, last)


def _offset_of(node: bpy.types.Node) -> int:
    """Return how many frames later a file is shown than its number says."""
    return node.image_user.frame_start - 1 - node.image_user.frame_offset


def _turn_of(node: bpy.types.Node) -> float:
    """Return how far the World is turned about the vertical from a stage that was just imported.

    Raises:
        ValueError: It is tilted, or turned by something else than a Mapping.
    """
    links = node.inputs["Vector"].links
    if not links:
        return IMAGE_TURN
    mapping = links[0].from_node
    if mapping.bl_idname == "ShaderNodeTexCoord":
        return IMAGE_TURN
    if mapping.bl_idname != "ShaderNodeMapping" or mapping.vector_type != "POINT":
        raise ValueError(
            f"{mapping.name}: turns the World in a way that is not known here; expected a Mapping "
            "of type Point, or none"
        )
    x, y, z = mapping.inputs["Rotation"].default_value
    scale = mapping.inputs["Scale"].default_value
    if max(abs(x), abs(y)) > TILT_MAX or max(abs(one - 1) for one in scale) > TILT_MAX:
        raise ValueError(
            f"{mapping.name}: tilts or scales the World; expected a turn about Z alone"
        )
    return IMAGE_TURN - z


def _strength_of(node: bpy.types.Node) -> float:
    """Return the strength of the World's background, which no link may drive.

    Raises:
        ValueError: Something is between the image and the background.
    """
    for link in node.outputs["Color"].links:
        if link.to_node.bl_idname == "ShaderNodeBackground":
            strength = link.to_node.inputs["Strength"]
            if not strength.is_linked:
                return float(strength.default_value)
    raise ValueError(
        "the World changes its image before it shines; expected the image in a Background"
    )


CLASSES = (ASGLIGHT_OT_fit_world,)
