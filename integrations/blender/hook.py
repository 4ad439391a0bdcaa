# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > USD, made right: what Blender's importer leaves at the first frame is animated.

Blender reads the transforms of a stage at every frame and all else once. Here energy, colour, size,
angle, visibility and the images of domes get F-curves at all their samples.
"""

import bpy

from . import lamps, worlds
from .plain.tracks import Array
from .reading import Warned, rigs_of, working_space


class ASGLIGHT_USD_hook(bpy.types.USDHook):  # noqa: N801 - Blender's way to name classes
    """What Blender calls when it has imported a stage."""

    bl_idname = "asglight_usd_hook"
    bl_label = "asglight"
    bl_description = "Animates the lights of asglight stages"

    @staticmethod
    def on_import(import_context: object) -> bool:
        """Animate what was imported of asglight's rigs; other stages are none of ours."""
        stage = import_context.get_stage()
        found = rigs_of(stage, working_space())
        if not found:
            return True
        scene = bpy.context.scene
        rate = stage.GetTimeCodesPerSecond() * scene.render.fps_base / scene.render.fps

        def frames(times: Array) -> Array:
            return times / rate

        made = import_context.get_prim_map()
        by_path = {str(path): blocks for path, blocks in made.items()}
        warned = Warned()
        path = stage.GetRootLayer().realPath
        for rig in found:
            blocks = [one for lamp in rig.lamps for one in by_path.get(lamp.path, ())]
            if rig.lamps and not any(isinstance(one, bpy.types.Light) for one in blocks):
                continue  # imported without lights
            for lamp in rig.lamps:
                for block in by_path.get(lamp.path, ()):
                    if isinstance(block, bpy.types.Light):
                        lamps.show(block, lamp, _ONE, frames, "energy")
                    elif isinstance(block, bpy.types.Object) and block.type == "LIGHT":
                        block[worlds.PRIM] = lamp.path
                        lamps.hide(block, lamp, frames)
            warned.about(rig)
            if rig.domes:
                worlds.show_domes(scene, rig, frames, path)
            elif not worlds.show_nothing_grey(scene):
                warned.say("the World shines too; make it black, or it adds to the light")
        warned.show()
        return True


_ONE = (1.0, 1.0)
