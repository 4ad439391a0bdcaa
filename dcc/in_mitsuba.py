# SPDX-License-Identifier: Apache-2.0
"""What Mitsuba makes of the dome's images and of the originals, as rows."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from asglight.images import read_latlong
from asglight.usd import Representation
from dcc import images, lobe_light, quadrature, renderers, rows, scene
from dcc.in_blender import ORIGINAL, SEEDS, Task
from dcc.quadrature import Light
from dcc.rows import Array, Row
from dcc.shots import Shot

SAMPLES_TIMES = 32
"""As many samples as Cycles: its sensors of one ray draw independent ones, which are noisier."""


def render(task: Task) -> None:
    """Render the middle frame of each shot, the dome's image and the original."""
    jobs = []
    for shot in task.shots:
        for kind, image in _images(shot).items():
            out = _out(task, shot, kind)
            paths = {"image": str(image.resolve()), "out": str(out.resolve())}
            common = {"size": task.size, "samples": SAMPLES_TIMES * task.samples, "seeds": SEEDS}
            what = {"materials": [*scene.MATERIALS.values()], "pixels": "points"}
            jobs.append({**paths, **common, **what})
    renderers.run("dcc.mitsuba_render", jobs, task.output)


def judged(task: Task) -> list[Row]:
    """Hold what was rendered against the integrals."""
    return [row for shot in task.shots for row in _rows(task, shot)]


def version(task: Task) -> str:
    """Return the version that rendered."""
    return str(np.load(_out(task, task.shots[0], ORIGINAL))["version"])


def _frame(shot: Shot) -> int:
    return shot.frames[len(shot.frames) // 2]


def _images(shot: Shot) -> dict[str, Path]:
    frame = _frame(shot)
    stage = shot.stages["Y"]
    dome = stage.parent / f"{stage.stem}_dome" / f"{stage.stem}.{frame:04d}.exr"
    return {ORIGINAL: shot.images[shot.frames.index(frame)], Representation.DOME: dome}


def _out(task: Task, shot: Shot, kind: str) -> Path:
    return task.out(shot.name, _frame(shot), "mitsuba", kind)


def _rows(task: Task, shot: Shot) -> Iterator[Row]:
    frame, paths = _frame(shot), _images(shot)
    original, image = (read_latlong(path).radiance for path in paths.values())
    lights = [
        quadrature.broad(quadrature.at_rows(original)),
        lobe_light.light_of(shot.lobes(frame)),
        images.as_read(original, on_poles=True),
        images.as_read(image, on_poles=True),
    ]
    pixels = scene.judged(task.size)
    rendered = {kind: np.load(_out(task, shot, kind))["balls"].astype(float) for kind in paths}
    for index, (material, roughness) in enumerate(scene.MATERIALS.items()):
        of_original, lobes, *as_read = _integrals(lights, task.size, roughness)
        reference = rendered[ORIGINAL][:, :, index][:, :, pixels].mean(0)
        for (kind, picture), reading in zip(rendered.items(), as_read, strict=True):
            is_original = kind == ORIGINAL
            seeds = picture[:, :, index][:, :, pixels]
            found = seeds.mean(0)
            expected = of_original if is_original else lobes
            yield Row(
                "Mitsuba",
                shot.name,
                frame,
                "Y",
                str(kind),
                material,
                None if is_original else rows.relative_rms(lobes, of_original),
                rows.relative_rms(found, expected),
                rows.relative_mean(found, expected),
                rows.relative_rms(found, reading),
                None if is_original else rows.relative_rms(found, reference),
                rows.noise(seeds),
            )


def _integrals(lights: list[Light], size: int, roughness: float | None) -> Array:
    """Integrate lights at the judged pixels.  [K, view, P, 3]."""
    views = []
    for name, towards in scene.VIEWS.items():
        normals = torch.from_numpy(scene.normals(size, name))
        view = torch.tensor(towards, dtype=torch.float64)
        separable = quadrature.separable_visibility
        views.append(quadrature.shown(lights, normals, view, roughness, separable))
    return torch.stack(views, dim=1).numpy()
