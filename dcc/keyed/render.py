# SPDX-License-Identifier: Apache-2.0
"""Renders balls and a board under stages that the extension brought: runs where `import bpy` does.

    python -m dcc.keyed.render jobs.json

A job has `stage`, `times`, `samples`, `seeds`, `rows` (of the world's image), `zip` (the extension)
and `out`, an .npz. With `roughnesses` and `size` that holds `balls`, float32 [time, seed, view,
ball, size, size, 3]; with `board`, rows right, up, normal, and `columns` it holds `boards`, float32
[2, rows, columns, 3], without and with the post, the mean of the seeds.
"""

import json
import math
import sys
from pathlib import Path

from dcc.moving import render  # isort: skip - it says where Blender keeps extensions

import bpy
import numpy as np
from mathutils import Matrix

from dcc import blender_render, scene
from dcc.keyed import board

THICKNESS = 0.01
"""Of the board, in metres."""

MARGIN = 4.0
"""The board is so many times as large as what is seen of it."""


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    render.install(jobs[0]["zip"])
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        made = render.imported({**job, "way": "hook"})
        blender_render.set_cycles(made, job["samples"])
        made.world.cycles.sampling_method = "MANUAL"
        made.world.cycles.sample_map_resolution = 4 * job["rows"]
        if "board" in job:
            np.savez(job["out"], version=bpy.app.version_string, boards=boards(made, job))
        else:
            np.savez(job["out"], version=bpy.app.version_string, balls=balls(made, job))
    bpy.ops.preferences.addon_disable(module=render.ADDON)


def balls(made: bpy.types.Scene, job: dict) -> np.ndarray:
    """Render a row of balls at all times.  [time, seed, view, ball, size, size, 3]."""
    blender_render.add_row(made, job["roughnesses"])
    found = []
    for time in job["times"]:
        made.frame_set(math.floor(time))
        count, views = len(job["roughnesses"]), list(scene.VIEWS)
        found.append(blender_render.row_pictures(made, count, job["size"], job["seeds"], views))
    return np.array(found)


def boards(made: bpy.types.Scene, job: dict) -> np.ndarray:
    """Render a board without and with its post.  [2, rows, columns, 3]."""
    made.frame_set(math.floor(job["times"][0]))
    frame = blender_render.to_blender(np.array(job["board"]))
    size = MARGIN * board.WIDTH
    add_box(made, frame, (size, size, THICKNESS), (0.0, 0.0, -THICKNESS / 2))
    blender_render.aim(made, frame, board.WIDTH)
    columns = job["columns"]
    rows = round(columns * board.HEIGHT / board.WIDTH)
    pictures = [seen(made, job["seeds"], columns, rows)]
    sides = (board.POST, board.POST, board.POST_HEIGHT)
    add_box(made, frame, sides, (board.FOOT, 0.0, board.POST_HEIGHT / 2))
    pictures.append(seen(made, job["seeds"], columns, rows))
    return np.array(pictures)


def seen(made: bpy.types.Scene, seeds: list[int], columns: int, rows: int) -> np.ndarray:
    """Return the mean of pictures of several seeds.  [rows, columns, 3]."""
    found = []
    for seed in seeds:
        made.cycles.seed = seed
        found.append(blender_render.rendered(made, columns, rows))
    return np.mean(found, axis=0)


def add_box(
    made: bpy.types.Scene,
    frame: np.ndarray,
    sides: tuple[float, float, float],
    place: tuple[float, float, float],
) -> None:
    """Add a white box.

    Args:
        made: Where.
        frame: Rows of its axes, in Blender's directions.  [3, 3]
        sides: Along its axes, in metres.
        place: Of its middle, along its axes.
    """
    bpy.ops.mesh.primitive_cube_add(size=1)
    box = bpy.context.object
    turn = Matrix(frame.T.tolist()).to_4x4()
    box.matrix_world = turn @ Matrix.Translation(place) @ Matrix.Diagonal((*sides, 1.0))
    box.data.materials.append(blender_render.white(None))
    made.view_layers.update()


if __name__ == "__main__":
    main(sys.argv[1])
