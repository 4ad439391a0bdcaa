# SPDX-License-Identifier: Apache-2.0
"""Renders a small set under stages, as an artist would: runs where `import bpy` does.

    python -m dcc.moving.picture_render jobs.json

A job has `stage`, `way` (`original` and `plain` without the extension, `hook` or `importer` with
it), `frames`, `width`, `height`, `samples`, `glossy` (the right ball's roughness), `zip` and `out`:
an .npz with `pictures`, float32 [frame, height, width, 4], linear.
"""

import json
import sys
import tempfile
from pathlib import Path

from dcc.moving import render  # isort: skip - it says where Blender keeps extensions

import bpy
import numpy as np
from mathutils import Vector

CAMERA, TARGET = (0.0, -5.6, 3.3), (0.0, 0.0, 0.5)
"""Where the camera stands and looks, in metres."""

LENS = 50.0


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    render.install(jobs[0]["zip"])
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        extended = job["way"] in {"hook", "importer"}
        switch = bpy.ops.preferences.addon_enable if extended else bpy.ops.preferences.addon_disable
        switch(module=render.ADDON)
        way = "importer" if job["way"] == "importer" else "hook"
        made = render.imported(job | {"way": way, "settings": {}})
        if job["way"] == "plain":
            made.world.color = (0, 0, 0)
        furnish(made, job["glossy"])
        set_cycles(made, job)
        pictures = []
        for frame in job["frames"]:
            made.frame_set(frame)
            pictures.append(rendered(made))
        np.savez(job["out"], version=bpy.app.version_string, pictures=np.array(pictures))
    bpy.ops.preferences.addon_disable(module=render.ADDON)


def furnish(made: bpy.types.Scene, roughness: float) -> None:
    """Set a floor, a matte head, a matte and a glossy ball, and a camera."""
    bpy.ops.mesh.primitive_plane_add(size=40)
    bpy.context.object.data.materials.append(material("floor", 0.3, 0.9, 0.0))
    white = material("matte", 0.75, 1.0, 0.0)
    bpy.ops.mesh.primitive_monkey_add(size=1.5, location=(0, 0, 0.75), rotation=(-0.62, 0, 0))
    head = bpy.context.object
    head.modifiers.new("smooth", "SUBSURF").render_levels = 2
    bpy.ops.object.shade_smooth()
    head.data.materials.append(white)
    for x, finish in ((-1.5, white), (1.5, material("glossy", 0.9, roughness, 1.0))):
        bpy.ops.mesh.primitive_uv_sphere_add(
            segments=96, ring_count=48, radius=0.55, location=(x, 0, 0.55)
        )
        bpy.ops.object.shade_smooth()
        bpy.context.object.data.materials.append(finish)
    data = bpy.data.cameras.new("camera")
    data.lens = LENS
    camera = bpy.data.objects.new("camera", data)
    camera.location = CAMERA
    towards = Vector(TARGET) - Vector(CAMERA)
    camera.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    made.collection.objects.link(camera)
    made.camera = camera


def material(name: str, level: float, roughness: float, metallic: float) -> bpy.types.Material:
    """Make a grey material."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    shader = next(
        node for node in made.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled"
    )
    shader.inputs["Base Color"].default_value = (level, level, level, 1)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Metallic"].default_value = metallic
    return made


def set_cycles(made: bpy.types.Scene, job: dict) -> None:
    """Ask for a picture as artists do, with bounces and a denoiser."""
    made.render.engine = "CYCLES"
    made.render.film_transparent = True
    made.render.resolution_x, made.render.resolution_y = job["width"], job["height"]
    made.render.resolution_percentage = 100
    made.cycles.device, made.cycles.samples = "CPU", job["samples"]
    made.cycles.max_bounces = 4
    made.cycles.use_denoising = True
    made.world.cycles.sampling_method = "MANUAL"
    made.world.cycles.sample_map_resolution = 1024
    image = made.render.image_settings
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"


def rendered(made: bpy.types.Scene) -> np.ndarray:
    """Return what the camera sees, linear, row 0 at the top.  [height, width, 4]."""
    with tempfile.TemporaryDirectory() as folder:
        made.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(made.render.filepath)
        width, height = image.size
        values = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[::-1]


if __name__ == "__main__":
    main(sys.argv[1])
