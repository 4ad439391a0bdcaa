# SPDX-License-Identifier: GPL-3.0-or-later
"""The tab of the 3D view: rigs, the gains of their lobes, and what can be done with them."""

import bpy

from . import building
from .fitting import ASGLIGHT_OT_fit_world
from .importing import ASGLIGHT_OT_import
from .saving import ASGLIGHT_OT_save_edits


class ASGLIGHT_PT_rigs(bpy.types.Panel):  # noqa: N801 - Blender's way to name classes
    """All that the scene has of asglight."""

    bl_label = "asglight"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "asglight"

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the buttons and the gains."""
        layout = self.layout
        layout.operator(ASGLIGHT_OT_import.bl_idname, text="Import stage", icon="IMPORT")
        layout.operator(ASGLIGHT_OT_fit_world.bl_idname, icon="WORLD")
        for rig in building.rigs_in(context.scene):
            self._rig(rig)

    def _rig(self, rig: bpy.types.Object) -> None:
        box = self.layout.box()
        row = box.row(align=True)
        row.label(text=rig.name, icon="OUTLINER_OB_LIGHT")
        again = row.operator(ASGLIGHT_OT_import.bl_idname, text="", icon="FILE_REFRESH")
        again.filepath, again.rig = rig[building.STAGE], rig.name
        again.representation = rig.get(building.WISHED, "stage")
        again.distance = rig[building.DISTANCE]
        again.offset = rig[building.OFFSET]
        again.strength = rig[building.STRENGTH]
        again.use_world = rig.get(building.WORLD, True)
        again.set_time = rig.get(building.TIME, True)
        again.seen = rig.get(building.SEEN, False)
        save = row.operator(ASGLIGHT_OT_save_edits.bl_idname, text="", icon="FILE_TICK")
        save.rig = rig.name
        box.prop(rig, "rotation_euler", index=2, text="Turn")
        column = box.column(align=True)
        column.label(text="Gain")
        for one in sorted(building.parts_of(rig), key=lambda part: part.name):
            if one.type == "EMPTY" and building.GAIN in one:
                column.prop(one, f'["{building.GAIN}"]', text=one.name)


CLASSES = (ASGLIGHT_PT_rigs,)
