# SPDX-License-Identifier: Apache-2.0
"""Renders balls under latlong EXR files in Mitsuba 3: runs where `import mitsuba` does.

    python -m dcc.mitsuba_render jobs.json

The file is a list of jobs, each with `image` (an EXR), `out` (an .npz), `size`, `samples`, `seeds`,
`materials` (roughnesses, null for a matte one) and `pixels`; `out` gets float32 [seed, view,
material, size, size, 3]. Mitsuba reads no USD: what is checked is the dome's image, its orientation
and its radiance. Its pixels have an area. With `pixels` "points" every pixel is therefore a sensor
of its own that looks along one ray; with "means" they are what Mitsuba makes them.
"""

import json
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

from dcc import scene as balls

mi.set_variant("scalar_rgb")

FILM = {"pixel_format": "rgb", "rfilter": {"type": "box"}}


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        images = [
            [
                [
                    PIXELS[job["pixels"]](job, view, roughness, seed)
                    for roughness in job["materials"]
                ]
                for view in balls.VIEWS
            ]
            for seed in job["seeds"]
        ]
        np.savez(job["out"], version=mi.__version__, balls=np.array(images))


def points(job: dict, view: str, roughness: float | None, seed: int) -> np.ndarray:
    """Render one ball at pixel centres; pixels that are not judged stay black.  [size, size, 3]."""
    size, towards = job["size"], np.array(balls.VIEWS[view])
    normals = balls.normals(size, view)
    film = {"type": "hdrfilm", **FILM, "width": 1, "height": 1}
    sensors = {
        f"pixel{index:05d}": {
            "type": "radiancemeter",
            "origin": (place + 4 * towards).tolist(),
            "direction": (-towards).tolist(),
            "film": film,
        }
        for index, place in enumerate(normals)
    }
    camera = {
        "type": "batch",
        "sampler": {"type": "independent", "sample_count": job["samples"]},
        "film": {"type": "hdrfilm", **FILM, "width": len(normals), "height": 1},
        **sensors,
    }
    picture = np.zeros((size, size, 3), np.float32)
    picture[balls.judged(size)] = render(job, roughness, camera, seed)[0]
    return picture


def means(job: dict, view: str, roughness: float | None, seed: int) -> np.ndarray:
    """Render one ball, a pixel the mean over its area, nothing around it.  [size, size, 3]."""
    size, towards = job["size"], balls.VIEWS[view]
    to_world = mi.ScalarTransform4f().look_at(
        origin=[4 * value for value in towards], target=[0, 0, 0], up=[0, 1, 0]
    )
    camera = {
        "type": "orthographic",
        "to_world": to_world,
        "sampler": {"type": "independent", "sample_count": job["samples"]},
        "film": {"type": "hdrfilm", **FILM, "width": size, "height": size},
    }
    return render(job, roughness, camera, seed)


PIXELS = {"points": points, "means": means}


def render(job: dict, roughness: float | None, camera: dict, seed: int) -> np.ndarray:
    """Render a ball of radius 1 under an image.  [rows, columns, 3]."""
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "light": {"type": "envmap", "filename": job["image"]},
            "ball": {"type": "sphere", "bsdf": surface(roughness)},
            "camera": camera,
        }
    )
    return np.array(mi.render(scene, seed=seed))


def surface(roughness: float | None) -> dict:
    """Return a white material: Lambertian, or GGX that reflects all."""
    if roughness is None:
        return {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    return {
        "type": "roughconductor",
        "material": "none",
        "distribution": "ggx",
        "alpha": roughness**2,
    }


if __name__ == "__main__":
    main(sys.argv[1])
