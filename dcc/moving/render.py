# SPDX-License-Identifier: Apache-2.0
"""Renders shots that the extension brought into Blender: runs where `import bpy` does.

    python -m dcc.moving.render jobs.json

A job has `stage`, `way` (`hook`, or `importer`), `settings` of the importer, `zip` (the extension),
`times`, `size`, `samples`, `seeds`, `rows` (of the dome's image) and `out`: an .npz with `balls`,
float32 [time, seed, view, 1, size, size, 3], of a matte ball, and what Blender said. The extension
is installed from its zip, as a user installs it, into folders of this run alone.
"""

import json
import math
import os
import sys
import tempfile
from pathlib import Path

PLACE = tempfile.TemporaryDirectory()
os.environ["BLENDER_USER_RESOURCES"] = PLACE.name  # before Blender starts

import bpy  # noqa: E402
import numpy as np  # noqa: E402

from dcc import blender_render, scene  # noqa: E402

MATTE = "matte"
ADDON = "bl_ext.user_default.asglight"


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    install(jobs[0]["zip"])
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        made = imported(job)
        blender_render.set_cycles(made, job["samples"])
        if made.world is not None:
            made.world.cycles.sampling_method = "MANUAL"
            made.world.cycles.sample_map_resolution = 4 * job["rows"]
        blender_render.add_ball(0.0, scene.MATERIALS[MATTE])
        pictures = []
        for time in job["times"]:
            made.frame_set(math.floor(time), subframe=time - math.floor(time))
            pictures.append(balls(made, job["size"], job["seeds"]))
        np.savez(job["out"], version=bpy.app.version_string, balls=np.array(pictures))
    bpy.ops.preferences.addon_disable(module=ADDON)


def install(package: str) -> None:
    """Install the extension from its zip and switch it on."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.extensions.package_install_files(
        filepath=package, repo="user_default", enable_on_install=True
    )
    if ADDON not in bpy.context.preferences.addons:
        sys.exit(f"{package}: Blender did not switch it on")


def imported(job: dict) -> bpy.types.Scene:
    """Return a scene that holds a stage, in a World as Blender makes them."""
    made = bpy.data.scenes.new("scene")
    old = bpy.context.scene
    bpy.context.window.scene = made
    bpy.data.scenes.remove(old)
    bpy.data.batch_remove([*bpy.data.images, *bpy.data.worlds])  # an import would take them again
    made.world = bpy.data.worlds.new("World")
    if job["way"] == "hook":
        done = bpy.ops.wm.usd_import(filepath=job["stage"])
    else:
        done = bpy.ops.import_scene.asglight(filepath=job["stage"], **job["settings"])
    if done != {"FINISHED"}:
        sys.exit(f"{job['stage']}: Blender could not import it")
    return made


def balls(made: bpy.types.Scene, size: int, seeds: list[int]) -> np.ndarray:
    """Render the ball from both sides.  [seed, view, 1, size, size, 3]."""
    images = []
    for seed in seeds:
        made.cycles.seed = seed
        for view in scene.VIEWS:
            frame = blender_render.to_blender(scene.camera_frame(view))
            blender_render.aim(made, frame, 2 * blender_render.RADIUS)
            images.append(blender_render.rendered(made, size, size))
    return np.array(images).reshape(len(seeds), len(scene.VIEWS), 1, size, size, 3)


if __name__ == "__main__":
    main(sys.argv[1])
