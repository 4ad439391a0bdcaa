# SPDX-License-Identifier: Apache-2.0
"""Renders balls under latlong EXR files in Mitsuba 3: runs where `import mitsuba` does.

    python -m dcc.mitsuba_render jobs.json

The file is a list of jobs, each with `image` (an EXR), `out` (an .npz), `size`, `samples` and
`seeds`; `out` gets float32 [seed, view, material, size, size, 3]. Mitsuba reads no USD: what is
checked is the dome's image, its orientation and its radiance. A pixel is the mean over its area.
"""

import json
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np

from dcc import scene as balls

mi.set_variant("scalar_rgb")


def main(path: str) -> None:
    """Do all jobs of a file, in order."""
    jobs = json.loads(Path(path).read_text())
    for index, job in enumerate(jobs):
        print(f"{index + 1}/{len(jobs)} {Path(job['out']).stem}", file=sys.stderr, flush=True)
        images = [
            [
                [ball(job, view, roughness, seed) for roughness in balls.MATERIALS.values()]
                for view in balls.VIEWS
            ]
            for seed in job["seeds"]
        ]
        np.savez(job["out"], version=mi.__version__, balls=np.array(images))


def ball(job: dict, view: str, roughness: float | None, seed: int) -> np.ndarray:
    """Render one ball.  [size, size, 3]."""
    towards = np.array(balls.VIEWS[view])
    up = [0.0, 1.0, 0.0]
    look = mi.ScalarTransform4f().look_at(origin=(4 * towards).tolist(), target=[0] * 3, up=up)
    size = job["size"]
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "light": {"type": "envmap", "filename": job["image"]},
            "ball": {"type": "sphere", "bsdf": surface(roughness)},
            "camera": {
                "type": "orthographic",
                "to_world": look,
                "sampler": {"type": "multijitter", "sample_count": job["samples"]},
                "film": {
                    "type": "hdrfilm",
                    "width": size,
                    "height": size,
                    "pixel_format": "rgb",
                    "rfilter": {"type": "box"},
                },
            },
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
