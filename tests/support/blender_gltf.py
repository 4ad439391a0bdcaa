# SPDX-License-Identifier: Apache-2.0
"""The lights of a glTF file in Blender at some times, as JSON: runs where `import bpy` does.

python blender_gltf.py FILE OUTPUT FRAME ...
"""

import json
import sys
from pathlib import Path

import bpy

FILE, OUTPUT, *TIMES = sys.argv[1:]


def main() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 24
    bpy.ops.import_scene.gltf(filepath=FILE, export_import_convert_lighting_mode="RAW")
    found = []
    for time in map(float, TIMES):
        scene.frame_set(int(time), subframe=time - int(time))
        graph = bpy.context.evaluated_depsgraph_get()
        lights = [one.evaluated_get(graph) for one in scene.objects if one.type == "LIGHT"]
        found.append({one.name: told(one) for one in lights})
    Path(OUTPUT).write_text(json.dumps(found))


def told(light: bpy.types.Object) -> dict[str, list[float]]:
    return {
        "towards": list(light.matrix_world.col[2])[:3],
        "light": [light.data.energy * channel for channel in light.data.color],
    }


if __name__ == "__main__":
    main()
