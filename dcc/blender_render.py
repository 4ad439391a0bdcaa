# SPDX-License-Identifier: Apache-2.0
"""Renders stages in Blender's Cycles: runs where `import bpy` does, told what to do by a JSON file.

    python -m dcc.blender_render jobs.json

The file is a list of jobs, each with `stage`, `out` (an .npz), `kind` and `samples`:

    balls    float32 [seed, view, material, size, size, 3], with `size`, `seeds`, `views` and `rows`
             (of the dome's image)
    facing   of every light by itself: name, direction, and what a patch that faces it shows

The stage is imported as it is: nothing of its lights is touched. Cycles is asked for the plain
integral: no clamp, no denoiser, no bounce, a filter of a hundredth of a pixel. The balls neither
block nor reflect each other.
"""

import json
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

from dcc import scene as balls

RADIUS = 0.05
"""Of a ball, in metres: from end to end of the row, the direction to a card at 1,000 metres turns
by less than 0.02 degrees."""

SUBDIVISIONS = 7
"""Of the icosahedron: edges of one degree. Its faces lie 5e-5 radii below the sphere, which moves
normals by 2e-4 where n.v = 0.3, and by less elsewhere."""

FILTER_PIXELS = 0.01
"""Cycles' narrowest."""


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        scene = imported(Path(job["stage"]))
        set_cycles(scene, job["samples"])
        if job["kind"] == "facing":
            result = facing(scene)
        else:
            scene.world.cycles.sampling_method = "MANUAL"
            scene.world.cycles.sample_map_resolution = 4 * job["rows"]
            result = {"balls": all_balls(scene, job["size"], job["seeds"], job["views"])}
        np.savez(job["out"], version=bpy.app.version_string, **result)


def imported(stage: Path) -> bpy.types.Scene:
    """Return a new scene that holds a stage and nothing else, at time 0."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("world")  # without one, Blender drops domes silently
    scene.world.color = (0, 0, 0)  # a new one is grey
    if bpy.ops.wm.usd_import(filepath=str(stage)) != {"FINISHED"}:
        sys.exit(f"{stage}: Blender could not import it")
    scene.frame_set(0)
    return scene


def set_cycles(scene: bpy.types.Scene, samples: int) -> None:
    """Ask Cycles for the plain integral."""
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    scene.render.resolution_percentage = 100
    settings = {
        "device": "CPU",
        "samples": samples,
        "use_adaptive_sampling": False,
        "use_denoising": False,
        "max_bounces": 0,
        "sample_clamp_direct": 0,
        "sample_clamp_indirect": 0,
        "light_sampling_threshold": 0,
        "blur_glossy": 0,
        "pixel_filter_type": "GAUSSIAN",
        "filter_width": FILTER_PIXELS,
    }
    for name, value in settings.items():
        setattr(scene.cycles, name, value)
    image = scene.render.image_settings
    image.file_format, image.color_depth, image.color_mode = "OPEN_EXR", "32", "RGBA"


def all_balls(scene: bpy.types.Scene, size: int, seeds: list[int], views: list[str]) -> np.ndarray:
    """Render the row of balls from some sides.  [seed, view, material, size, size, 3]."""
    add_row(scene, list(balls.MATERIALS.values()))
    return row_pictures(scene, len(balls.MATERIALS), size, seeds, views)


def add_row(scene: bpy.types.Scene, roughnesses: list[float | None]) -> None:
    """Add white balls side by side."""
    count = len(roughnesses)
    for index, roughness in enumerate(roughnesses):
        add_ball(2 * RADIUS * (index - (count - 1) / 2), roughness)


def row_pictures(
    scene: bpy.types.Scene, count: int, size: int, seeds: list[int], views: list[str]
) -> np.ndarray:
    """Render a row of balls that is there.  [seed, view, count, size, size, 3]."""
    images = []
    for seed in seeds:
        scene.cycles.seed = seed
        for view in views:
            aim(scene, to_blender(balls.camera_frame(view)), 2 * RADIUS * count)
            row = rendered(scene, count * size, size)
            parts = np.split(row, count, axis=1)
            images.append(parts[::-1] if view == "back" else parts)
    return np.array(images).reshape(len(seeds), len(views), count, size, size, 3)


def facing(scene: bpy.types.Scene) -> dict[str, np.ndarray]:
    """Render, for every light by itself, a white patch that faces it.

    Returns:
        Names [N]; directions to the lights [N, 3]; what the patch shows times pi [N, 3].
    """
    add_ball(0.0, None)
    lights = sorted((o for o in scene.objects if o.type == "LIGHT"), key=lambda o: o.name)
    directions, shown = [], []
    for light in lights:
        for other in lights:
            other.hide_render = other is not light
        towards = np.array(light.matrix_world.to_3x3().normalized() @ Vector((0, 0, 1)))
        frame = np.array(Vector(towards).to_track_quat("Z", "Y").to_matrix()).T
        aim(scene, frame, 0.01 * RADIUS)  # so near the middle the normal is the view
        shown.append(np.pi * rendered(scene, 4, 4).mean((0, 1)))
        directions.append(towards @ to_blender(np.eye(3)).T)
    names = np.array([light.name for light in lights])
    return {"names": names, "directions": np.array(directions), "irradiance": np.array(shown)}


def to_blender(directions: np.ndarray) -> np.ndarray:
    """Turn asglight's directions into Blender's, +Z up: (x, y, z) is (x, -z, y).  [..., 3]."""
    return np.stack([directions[..., 0], -directions[..., 2], directions[..., 1]], axis=-1)


def add_ball(place: float, roughness: float | None) -> None:
    """Add a white ball at (place, 0, 0) that no ray but the camera's meets."""
    bpy.ops.mesh.primitive_ico_sphere_add(
        subdivisions=SUBDIVISIONS, radius=RADIUS, location=(place, 0, 0)
    )
    ball = bpy.context.object
    bpy.ops.object.shade_smooth()
    ball.data.materials.append(white(roughness))
    for ray in ("diffuse", "glossy", "transmission", "shadow", "volume_scatter"):
        setattr(ball, f"visible_{ray}", False)


def white(roughness: float | None) -> bpy.types.Material:
    """Return a white material: GGX of a roughness, or Lambertian for None."""
    material = bpy.data.materials.new("white")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    matte = roughness is None
    surface = nodes.new("ShaderNodeBsdfDiffuse" if matte else "ShaderNodeBsdfAnisotropic")
    surface.inputs["Color"].default_value = (1, 1, 1, 1)
    surface.inputs["Roughness"].default_value = 0 if matte else roughness
    if not matte:
        surface.distribution = "GGX"
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(surface.outputs[0], output.inputs["Surface"])
    return material


def aim(scene: bpy.types.Scene, frame: np.ndarray, width: float) -> None:
    """Look at the origin from afar.

    Args:
        scene: Gets a camera.
        frame: Rows right, up, towards the camera, in Blender's directions.  [3, 3]
        width: Of what is seen, in metres.
    """
    data = bpy.data.cameras.new("camera")
    data.type, data.ortho_scale, data.clip_end = "ORTHO", width, 10.0
    camera = bpy.data.objects.new("camera", data)
    place = Matrix(frame.T.tolist()).to_4x4()
    place.translation = Vector(frame[2])
    camera.matrix_world = place
    scene.collection.objects.link(camera)
    scene.camera = camera


def rendered(scene: bpy.types.Scene, width: int, height: int) -> np.ndarray:
    """Return what the camera sees, linear, row 0 at the top.  [height, width, 3]."""
    scene.render.resolution_x, scene.render.resolution_y = width, height
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        values = np.empty(4 * width * height, np.float32)
        image.pixels.foreach_get(values)
        bpy.data.images.remove(image)
    return values.reshape(height, width, 4)[::-1, :, :3]


if __name__ == "__main__":
    main(sys.argv[1])
