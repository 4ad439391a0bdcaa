# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > asglight, and stages dropped on a window."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper, poll_file_object_drop
from pxr import Usd, UsdGeom

from . import building, reading, worlds
from .building import Wishes
from .plain import rigs

DISTANCE = 100.0
"""Of the cards, in metres: far beyond a set, and most lie inside the clip range of 1,000."""

SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")

AS_STAGE = "stage"
REPRESENTATIONS = (
    (AS_STAGE, "As the stage", "What the stage opens with"),
    ("cards", "Cards", "Area lights, and a dome for what is broad"),
    ("keys", "Keys", "One light for each lamp, and a dome for the rest"),
    ("distant", "Distant", "Suns; broad ones are not right in Blender"),
    ("dome", "Dome", "Images of all lobes as the World"),
)


class ASGLIGHT_OT_import(bpy.types.Operator, ImportHelper):  # noqa: N801 - Blender's way
    """Import the lights of an asglight stage, or bring those that are there up to date."""

    bl_idname = "import_scene.asglight"
    bl_label = "Import asglight"
    bl_options = {"REGISTER", "UNDO", "PRESET"}  # noqa: RUF012 - Blender reads a set
    filename_ext = ".usda"
    filter_glob: StringProperty(default="*.usda;*.usdc;*.usd;*.usdz", options={"HIDDEN"})
    representation: EnumProperty(
        name="Show as", items=REPRESENTATIONS, default=AS_STAGE, description="What the lobes become"
    )
    distance: FloatProperty(
        name="Card distance",
        default=DISTANCE,
        min=0.01,
        soft_max=1000.0,
        unit="LENGTH",
        description="How far away lights stand; their light at the middle does not depend on it",
    )
    strength: FloatProperty(
        name="Strength", default=1.0, min=0.0, soft_max=10.0, description="Multiplies all light"
    )
    offset: IntProperty(name="Frame offset", description="Frames that the light comes later")
    set_time: BoolProperty(
        name="Frames and rate",
        default=True,
        description="Give the scene the frames and the rate of the stage",
    )
    use_world: BoolProperty(
        name="World",
        default=True,
        description="Show the dome of the stage, or black, in place of the World that is there",
    )
    seen: BoolProperty(name="Seen by cameras", description="Whether cameras see the cards")
    rig: StringProperty(
        name="Rig",
        options={"HIDDEN", "SKIP_SAVE"},
        description="Empty of the rig to bring up to date; one of the same stage if empty",
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for a file, or for options alone where a file was dropped."""
        if self.filepath and Path(self.filepath).suffix in SUFFIXES:
            # ImportHelper.invoke_popup is for operators of several files
            name = Path(self.filepath).name
            return context.window_manager.invoke_props_dialog(
                self, title=name, confirm_text="Import"
            )
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Import the stage."""
        try:
            rig, warned = self._import(context)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, f"{self.filepath}: {error}")
            return {"CANCELLED"}
        for line in warned.lines:
            self.report({"WARNING"}, line)
        count = sum(1 for one in building.parts_of(rig) if one.type == "LIGHT")
        self.report({"INFO"}, f"{rig.name}: {count} lights")
        return {"FINISHED"}

    def _import(self, context: bpy.types.Context) -> tuple[bpy.types.Object, reading.Warned]:
        path = str(Path(bpy.path.abspath(self.filepath)).resolve())
        stage = rigs.opened(path)
        prims = rigs.rig_prims(stage)
        if not prims:
            raise ValueError("no lobes of asglight; expected a stage that asglight wrote")
        stage.SetEditTarget(stage.GetSessionLayer())
        _choose(prims[0], self.representation)
        found = rigs.read_rig(rigs.rig_prims(stage)[0], reading.working_space())
        scene = context.scene
        self._set_time(scene, stage)
        metres = UsdGeom.GetStageMetersPerUnit(stage)
        scale = self.distance / found.distance if found.distance > 0 else metres
        wishes = Wishes(
            path,
            scale,
            self.distance,
            self.representation,
            self.offset,
            self.strength,
            self.use_world,
            self.seen,
            self.set_time,
        )
        rig = building.build(context, found, wishes, self._there(scene, path, found.path))
        if found.place.position.is_constant:
            moved = metres * found.place.position.values[0]
            if moved.any():
                rig.location = moved.tolist()
        warned = reading.Warned()
        warned.about(found)
        if len(prims) > 1:
            warned.say(f"the stage has {len(prims)} rigs; {found.path} is imported")
        if scene.render.fps / scene.render.fps_base != stage.GetTimeCodesPerSecond():
            warned.say(
                f"the stage runs at {stage.GetTimeCodesPerSecond():g} frames a second, the scene "
                "does not; its frames keep their numbers"
            )
        return rig, warned

    def _there(self, scene: bpy.types.Scene, path: str, prim: str) -> bpy.types.Object | None:
        """Return the rig to bring up to date."""
        for one in building.rigs_in(scene):
            if one.name == self.rig or (
                not self.rig and one[building.STAGE] == path and one[worlds.PRIM] == prim
            ):
                return one
        return None

    def _set_time(self, scene: bpy.types.Scene, stage: Usd.Stage) -> None:
        if not self.set_time:
            return
        rate = stage.GetTimeCodesPerSecond()
        scene.render.fps = max(round(rate), 1)
        scene.render.fps_base = scene.render.fps / rate
        scene.frame_start = round(stage.GetStartTimeCode()) + self.offset
        scene.frame_end = round(stage.GetEndTimeCode()) + self.offset
        scene.frame_set(min(max(scene.frame_current, scene.frame_start), scene.frame_end))


def _choose(rig: Usd.Prim, wanted: str) -> None:
    """Have a rig show a representation.

    Raises:
        ValueError: It does not hold that.
    """
    held = rigs.representations(rig)
    if wanted in {AS_STAGE, *held[:1]}:
        return
    if wanted not in held:
        raise ValueError(
            f"holds {', '.join(held) or 'no representation'}, not {wanted}; add it with: "
            f"asglight export STAGE --to {wanted}"
        )
    rig.GetVariantSet(rigs.VARIANT_SET).SetVariantSelection(wanted)


class ASGLIGHT_FH_stage(bpy.types.FileHandler):  # noqa: N801 - Blender's way to name classes
    """Stages that are dropped on a window."""

    bl_idname = "ASGLIGHT_FH_stage"
    bl_label = "asglight"
    bl_import_operator = "import_scene.asglight"
    bl_file_extensions = ";".join(SUFFIXES)

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        """Tell whether a stage may be dropped here."""
        return poll_file_object_drop(context)


def menu(self: bpy.types.Menu, _: bpy.types.Context) -> None:
    """Draw the entry in File > Import."""
    self.layout.operator(ASGLIGHT_OT_import.bl_idname, text="asglight (.usda/.usdc/.usdz)")


CLASSES = (ASGLIGHT_OT_import, ASGLIGHT_FH_stage)
