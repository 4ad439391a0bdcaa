# SPDX-License-Identifier: Apache-2.0
"""What Blender makes of the stages, as rows."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from asglight.images import read_latlong
from asglight.lobes import asg
from asglight.usd import Representation
from asglight.usd.lights import distant
from asglight.usd.options import OF_LOBES
from dcc import images, lobe_light, quadrature, renderers, rows, scene, stages, usdlux
from dcc.quadrature import Light
from dcc.rows import Array, FacingRow, Row
from dcc.shots import Shot, rows_of

ORIGINAL = "original"
"""Stands where a representation does: a dome of the image that was fitted."""

DISTANT_FACTOR = 4.0
"""Blender's importer multiplies the intensity of distant lights by 4, "approximately" as Karma does
by its source; it is divided out."""

SAMPLES_SHARE = {Representation.CARDS: 2, Representation.DISTANT: 8}
"""One of so many of the samples: the limit of cards is wider, and balls under distant lights have
none."""

SEEDS = [1, 2, 3, 4]
"""Renders whose mean is judged. With two, noise of a highlight that one pixel sees is found a tenth
of what it is every sixteenth time; with four hardly ever."""

FACING_SAMPLES = 64

ROUNDS = 4
"""Renders with too much noise are made again with twice the samples, so often at most."""


@dataclass(frozen=True)
class Task:
    """What to render, and how.

    Attributes:
        shots: Fitted and exported.
        output: Folder; the renders go to `renders` in it.
        size: Pixels across a ball.
        samples: Of each pixel and seed.
    """

    shots: list[Shot]
    output: Path
    size: int
    samples: int

    def frames(self) -> Iterator[tuple[Shot, int, Path]]:
        """Give each shot with each frame and its image."""
        for shot in self.shots:
            yield from ((shot, *pair) for pair in zip(shot.frames, shot.images, strict=True))

    def out(self, *words: object) -> Path:
        """Return where a render goes."""
        return self.output / "renders" / f"{'-'.join(map(str, words))}.npz"


def render(task: Task) -> None:
    """Render everything, and what is too noisy again with more samples."""
    (task.output / "renders").mkdir(parents=True, exist_ok=True)
    jobs = [job for shot, frame, image in task.frames() for job in _jobs(task, shot, frame, image)]
    for _ in range(ROUNDS):
        renderers.run("dcc.blender_render", jobs, task.output)
        jobs = [job | {"samples": 2 * job["samples"]} for job in jobs if is_noisy(job)]
        if not jobs:
            return


def is_noisy(job: dict[str, Any]) -> bool:
    """Tell whether what a job rendered has more noise than its limit bears."""
    if "noise" not in job:
        return False
    balls = np.load(job["out"])["balls"].astype(np.float64)
    seen = balls[..., scene.judged(job["size"]), :]
    return any(rows.noise(seen[:, :, index]) > job["noise"] for index in range(seen.shape[2]))


def judged(task: Task) -> tuple[list[Row], list[FacingRow]]:
    """Hold what was rendered against the integrals."""
    balls: list[Row] = []
    facing: list[FacingRow] = []
    for shot, frame, image in task.frames():
        balls += _ball_rows(task, shot, frame, image)
        facing += [_facing_row(task, shot, frame, axis) for axis in shot.stages]
    return balls, facing


def version(task: Task) -> str:
    """Return the version that rendered."""
    shot = task.shots[0]
    return str(np.load(task.out(shot.name, shot.frames[0], "Y", ORIGINAL))["version"])


def picture_of(task: Task, *words: object) -> Array:
    """Return a render, as bright as it should be.  [seed, view, material, S, S, 3]."""
    balls = np.load(task.out(*words))["balls"].astype(np.float64)
    return balls / DISTANT_FACTOR if words[-1] == Representation.DISTANT else balls


def integrals(lights: list[Light], size: int) -> list[dict[str, Array]]:
    """Integrate lights at the judged pixels.

    Returns:
        Of each light, material to radiance of both views.  [view, P, 3]
    """
    found: list[dict[str, Array]] = [{} for _ in lights]
    for material, roughness in scene.MATERIALS.items():
        views = [
            quadrature.shown(lights, _normals(size, name), _tensor(towards), roughness)
            for name, towards in scene.VIEWS.items()
        ]
        for values, both in zip(found, torch.stack(views, dim=1), strict=True):
            values[material] = both.numpy()
    return found


def _jobs(task: Task, shot: Shot, frame: int, image: Path) -> Iterator[dict[str, Any]]:
    """Give the jobs of one frame: the original, then every stage in every representation."""
    folder = task.output / "renders"
    common = {"size": task.size, "samples": task.samples, "seeds": SEEDS, "kind": "balls"}
    common["views"] = list(scene.VIEWS)

    def job(stage: Path, rows_of_image: int, *words: object) -> dict[str, Any]:
        out = task.out(shot.name, frame, *words)
        made = {"stage": str(stage), "out": str(out.resolve()), "rows": rows_of_image, **common}
        limit = rows.LIMITS.get(("Blender", str(words[-1])))
        return made if limit is None else made | {"noise": limit.most * rows.NOISE_SHARE}

    stage = stages.original(image, folder / f"{shot.name}-{frame}.usda")
    yield job(stage.resolve(), rows_of(image), "Y", ORIGINAL)
    for axis, exported in shot.stages.items():
        for representation in OF_LOBES:
            target = stage_of(task, shot, frame, axis, representation)
            stage = stages.at_frame(exported, frame, representation, target).resolve()
            made = job(stage, _dome_rows(exported), axis, representation)
            made["samples"] //= SAMPLES_SHARE.get(representation, 1)
            yield made
            if representation is Representation.DISTANT:
                out = task.out(shot.name, frame, axis, "facing")
                made = made | {"kind": "facing", "samples": FACING_SAMPLES}
                yield made | {"out": str(out.resolve())}


def stage_of(task: Task, shot: Shot, frame: int, axis: str, representation: str) -> Path:
    """Return the layer that shows a frame of a stage in a representation."""
    return task.output / "renders" / f"{shot.name}-{frame}-{axis}-{representation}.usda"


def _dome_rows(stage: Path) -> int:
    """Return the rows of a stage's dome images; those of the cards' fill are smaller."""
    return max(map(rows_of, (stage.parent / f"{stage.stem}_dome").glob("*.exr")))


def _ball_rows(task: Task, shot: Shot, frame: int, image: Path) -> Iterator[Row]:
    radiance = read_latlong(image).radiance
    kinds = [(axis, kind) for axis in shot.stages for kind in OF_LOBES]
    lights = [quadrature.broad(quadrature.at_rows(radiance)), images.as_read(radiance)]
    lights.append(lobe_light.light_of(shot.lobes(frame)))
    for axis, kind in kinds:
        path = stage_of(task, shot, frame, axis, kind)
        lights.append(usdlux.light_of(path, blender_distant=True))
    original, interpolated, lobes, *read = integrals(lights, task.size)
    of_original = picture_of(task, shot.name, frame, "Y", ORIGINAL)
    pixels = scene.judged(task.size)
    rendered = [("Y", ORIGINAL, of_original, original, interpolated)]
    for (axis, kind), values in zip(kinds, read, strict=True):
        picture = picture_of(task, shot.name, frame, axis, kind)
        rendered.append((axis, kind, picture, lobes, values))
    for axis, kind, picture, expected, as_read in rendered:
        is_original = kind == ORIGINAL
        for index, material in enumerate(scene.MATERIALS):
            seeds = picture[:, :, index][:, :, pixels]
            reference = of_original[:, :, index][:, :, pixels].mean(0)
            found = seeds.mean(0)
            yield Row(
                "Blender",
                shot.name,
                frame,
                axis,
                str(kind),
                material,
                None if is_original else rows.relative_rms(lobes[material], original[material]),
                rows.relative_rms(found, expected[material]),
                rows.relative_mean(found, expected[material]),
                rows.relative_rms(found, as_read[material]),
                None if is_original else rows.relative_rms(found, reference),
                rows.noise(seeds),
            )


def _facing_row(task: Task, shot: Shot, frame: int, axis: str) -> FacingRow:
    """Judge the distant lights one by one; dark ones have no irradiance to compare."""
    lobes = shot.lobes(frame)
    expected = asg.facing_irradiance(lobes).numpy()
    radius = torch.deg2rad(distant.angle_deg(lobes)).numpy()  # Blender's: the angle is doubled
    found = np.load(task.out(shot.name, frame, axis, "facing"))
    lit = expected.sum(-1) > 1e-6 * expected.sum()
    wide = radius > math.pi / 2
    factor = np.where(wide, DISTANT_FACTOR / np.sin(radius) ** 2, DISTANT_FACTOR)
    due = np.where(lit, factor * expected.sum(-1), 1.0)
    error = np.abs(found["irradiance"].sum(-1) / due - 1)
    cosine = (found["directions"] * lobes.axis_z.numpy()).sum(-1).clip(-1, 1)
    return FacingRow(
        "Blender",
        shot.name,
        frame,
        axis,
        int((lit & ~wide).sum()),
        int((lit & wide).sum()),
        float(error[lit & ~wide].max(initial=0)),
        float(error[lit & wide].max(initial=0)),
        float(np.degrees(np.arccos(cosine[lit])).max(initial=0)),
    )


def _normals(size: int, view: str) -> Tensor:
    return torch.from_numpy(scene.normals(size, view))


def _tensor(direction: tuple[float, float, float]) -> Tensor:
    return torch.tensor(direction, dtype=torch.float64)
