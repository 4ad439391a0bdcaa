# SPDX-License-Identifier: Apache-2.0
"""Render keyed stages in Blender through the extension and hold them against their HDRIs as World.

Balls: matte, of roughness 0.5 and 0.25, and a mirror, at the first, the middle and the last frame
of each shot. Boards: the shadow of a post under the strongest key of a still. The exit status is 1
where something is above its limit, 2 where something is missing.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from asglight.errors import InputError
from dcc import renderers, rows, scene, shots, stages
from dcc.keyed import board, cases
from dcc.keyed.board import Shadow
from dcc.keyed.cases import Case
from dcc.rows import Array

LIMITS = {"matte": 0.005, "r0.5": 0.005, "r0.25": 0.025}
"""Of a ball's relative RMS error, beyond the noise of both pictures. Squares weigh grazing
highlights of lamps that are uneven, whose cards are even."""

MEAN_LIMIT = 0.02
"""Of the mean absolute error at r0.25, which is that of `asglight eval`. Noise is in it."""

DIRECTION_LIMIT_DEG = 0.5
"""Between the shadows: a hundredth of the length of the post."""

SOFTNESS_LIMIT = 0.1
"""Of the softness, between the shadows: nobody sees a tenth of a penumbra."""

SOFTNESS_TEXELS = 0.5
"""Of the image, before its texels are repeated, which the softness may differ by in any case: a
lamp of a texel or two has edges as blurred as its texels, and its card has none."""

GLOSSY, MIRROR = "r0.25", "mirror"

ORIGINAL, KEYED = "HDRI", "keys and rest"

SEEDS = list(range(1, 9))
"""With four the noise of `handheld` is .9 % at r0.5, more than is judged."""

SIZE, SAMPLES = 32, 512
"""Pixels across a ball, and samples of a pixel and seed: in a ball of 16 one pixel of a grazing
highlight has four fifths of all error. Noise is taken off, so pixels may have few samples."""

MIRROR_SIZE, MIRROR_SAMPLES = 96, 16
"""Pixels across, and samples of a pixel, which all see the same."""

BOARD_COLUMNS, BOARD_SAMPLES = 240, 64
"""Pixels, and samples of each and of a seed: many pixels are taken together."""


@dataclass(frozen=True)
class Row:
    """A frame of a shot.

    Attributes:
        shot: Of which shot.
        frame: Which.
        errors: Of each ball, relative RMS error of keys and rest against the HDRI.
        noise: Of each ball, of both pictures together.
        glossy: Of the ball of r0.25, sum of the absolute errors over that of the HDRI.
        mirror: Of the mirror, likewise.
        level: Of the matte ball, its sum over that under the HDRI.
    """

    shot: str
    frame: int
    errors: dict[str, float]
    noise: dict[str, float]
    glossy: float
    mirror: float
    level: float

    def beyond_noise(self, material: str) -> float:
        """Return what of an error is not noise: mean squares add."""
        square = self.errors[material] ** 2 - self.noise.get(material, 0.0) ** 2
        return float(np.sqrt(max(square, 0.0)))


@dataclass(frozen=True)
class Shadows:
    """Shadows of one post.

    Attributes:
        shot: Of which shot.
        texel_deg: Of the HDRI.
        original: Under the HDRI.
        keyed: Under keys and rest.
    """

    shot: str
    texel_deg: float
    original: Shadow
    keyed: Shadow


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write and print; return the exit status."""
    parser = shots.extension_parser("dcc.keyed", __doc__, "dcc-output/keyed")
    parser.set_defaults(size=SIZE, samples=SAMPLES)
    stills = "images with a lamp: their balls, and the shadow of a post"
    parser.add_argument("--stills", type=Path, nargs="*", default=[], metavar="IMAGE", help=stills)
    options = parser.parse_args(argv)
    torch.set_num_threads(1)  # the renderer has the cores
    try:
        version, found, shadows = run(options)
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2
    document = {
        "version": version,
        "rows": [asdict(row) for row in found],
        "shadows": [asdict(one) for one in shadows],
    }
    (options.output / "keyed.json").write_text(json.dumps(document, indent=1) + "\n")
    print(f"Blender {version}\n\n{table(found)}\n\n{shadow_table(shadows)}")
    failed = failures(found, shadows)
    for line in failed:
        print(f"dcc: {line}", file=sys.stderr)
    return 1 if failed else 0


def run(options: argparse.Namespace) -> tuple[str, list[Row], list[Shadows]]:
    """Render as the options say; return Blender's version, the balls and the shadows."""
    output = options.output.resolve()
    (output / "renders").mkdir(parents=True, exist_ok=True)
    if options.short:
        chosen = stills = [cases.built_in(output)]
    else:
        stills = [cases.case(path, output) for path in options.stills]
        chosen = [*cases.of_sequences(options.sequences, shots.SEQUENCES, output), *stills]
    jobs = [job for one in chosen for job in _ball_jobs(one, options, output)]
    jobs += [job for one in stills for job in _board_jobs(one, options, output)]
    renderers.run("dcc.keyed.render", jobs, output, options.python)
    found = [row for one in chosen for row in _rows(one, options.size, output)]
    shadows = [_shadows(one, output) for one in stills]
    return str(np.load(jobs[0]["out"])["version"]), found, shadows


def _out(output: Path, *words: object) -> Path:
    return output / "renders" / f"{'-'.join(map(str, words))}.npz"


def _shown(one: Case, output: Path) -> Iterator[tuple[str, Path, tuple[int, ...], int, str]]:
    """Give what is imported: which light, a stage, its frames, rows of its world, and a name."""
    yield KEYED, one.stage, one.frames, shots.rows_of(one.images[0]), "keyed"
    for frame, image in zip(one.frames, one.images, strict=True):
        stage = stages.original(image, output / "renders" / f"{one.name}-{frame}.usda")
        yield ORIGINAL, stage, (frame,), shots.rows_of(image), f"original-{frame}"


def _job(options: argparse.Namespace, stage: Path, rows_of_world: int) -> dict[str, Any]:
    return {
        "stage": str(stage.resolve()),
        "zip": str(options.zip.resolve()),
        "rows": rows_of_world,
        "samples": options.samples,
        "seeds": SEEDS,
        "settings": {},
    }


def _ball_jobs(one: Case, options: argparse.Namespace, output: Path) -> Iterator[dict[str, Any]]:
    for _, stage, frames, rows_of_world, name in _shown(one, output):
        common = {**_job(options, stage, rows_of_world), "times": list(frames)}
        yield {
            **common,
            "roughnesses": list(scene.MATERIALS.values()),
            "size": options.size,
            "out": str(_out(output, one.name, name)),
        }
        yield {
            **common,
            "roughnesses": [0.0],
            "size": MIRROR_SIZE,
            "samples": MIRROR_SAMPLES,
            "seeds": SEEDS[:1],
            "out": str(_out(output, one.name, name, MIRROR)),
        }


def _board_jobs(one: Case, options: argparse.Namespace, output: Path) -> Iterator[dict[str, Any]]:
    for _, stage, frames, rows_of_world, name in _shown(one, output):
        if one.frames[0] in frames:
            yield {
                **_job(options, stage, rows_of_world),
                "times": [one.frames[0]],
                "samples": BOARD_SAMPLES,
                "seeds": SEEDS[:2],
                "board": board.frame(one.key).tolist(),
                "columns": BOARD_COLUMNS,
                "out": str(_out(output, one.name, name, "board")),
            }


def _rows(one: Case, size: int, output: Path) -> Iterator[Row]:
    def balls(*words: object) -> Array:
        return np.load(_out(output, one.name, *words))["balls"].astype(np.float64)

    keyed, mirrors = balls("keyed"), balls("keyed", MIRROR)
    pixels, in_mirror = scene.judged(size), scene.judged(MIRROR_SIZE)
    for place, frame in enumerate(one.frames):
        original = balls(f"original-{frame}")[0]
        errors, noise = {}, {}
        level, glossy = 1.0, 0.0
        for index, material in enumerate(scene.MATERIALS):
            seen, truth = (of[:, :, index][:, :, pixels] for of in (keyed[place], original))
            errors[material] = rows.relative_rms(seen.mean(0), truth.mean(0))
            noise[material] = float(np.hypot(rows.noise(seen), rows.noise(truth)))
            if not index:
                level = float(seen.mean(0).sum() / truth.mean(0).sum())
            if material == GLOSSY:
                glossy = rows.relative_mean(seen.mean(0), truth.mean(0))
        seen, truth = (
            of[0, :, 0][:, in_mirror]
            for of in (mirrors[place], balls(f"original-{frame}", MIRROR)[0])
        )
        mirror = rows.relative_mean(seen, truth)
        yield Row(one.name, frame, errors, noise, glossy, mirror, level)


def _shadows(one: Case, output: Path) -> Shadows:
    original, keyed = (
        board.measured(*np.load(_out(output, one.name, name, "board"))["boards"].astype(float))
        for name in (f"original-{one.frames[0]}", "keyed")
    )
    return Shadows(one.name, 180 / one.rows, original, keyed)


def failures(found: Sequence[Row], shadows: Sequence[Shadows]) -> list[str]:
    """Return what is above its limit, one line each."""
    lines = []
    for row in found:
        for material, most in LIMITS.items():
            if row.beyond_noise(material) > most:
                error = f"{row.beyond_noise(material):.2%}, above {most:.1%}"
                lines.append(f"{row.shot} {row.frame} {material}: {error}")
        if row.glossy > MEAN_LIMIT:
            error = f"{row.glossy:.2%}, above {MEAN_LIMIT:.1%}"
            lines.append(f"{row.shot} {row.frame} {GLOSSY}, mean: {error}")
    for one in shadows:
        turn = abs(one.keyed.direction_deg - one.original.direction_deg)
        if turn > DIRECTION_LIMIT_DEG:
            lines.append(f"{one.shot}: shadow turned by {turn:.2f} degrees")
        soft, wanted = one.keyed.softness_deg, one.original.softness_deg
        if abs(soft - wanted) > max(SOFTNESS_LIMIT * wanted, SOFTNESS_TEXELS * one.texel_deg):
            lines.append(
                f"{one.shot}: edges of the shadow {soft:.2f}, of the HDRI {wanted:.2f} degrees"
            )
    return lines


def table(found: Sequence[Row]) -> str:
    """Return the balls as Markdown, percent."""
    names = list(LIMITS)
    columns = ["shot", "frame", *names, f"{GLOSSY} mean", MIRROR, "level"]
    columns += [f"noise {name}" for name in names]
    lines = [f"| {' | '.join(columns)} |", "| --- |" + " ---: |" * (len(columns) - 1)]
    for row in found:
        cells = [row.shot, str(row.frame)]
        cells += [f"{100 * row.errors[name]:.2f}" for name in names]
        cells += [f"{100 * row.glossy:.2f}", f"{100 * row.mirror:.1f}", f"{row.level:.4f}"]
        cells += [f"{100 * row.noise[name]:.2f}" for name in names]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def shadow_table(shadows: Sequence[Shadows]) -> str:
    """Return the shadows as Markdown."""
    columns = ["still", "under", "direction", "softness", "depth %"]
    lines = [f"| {' | '.join(columns)} |", "| --- | --- |" + " ---: |" * 3]
    for one in shadows:
        for name, seen in ((ORIGINAL, one.original), (KEYED, one.keyed)):
            numbers = f"{seen.direction_deg:+.2f}° | {seen.softness_deg:.2f}° | "
            lines.append(f"| {one.shot} | {name} | {numbers}{100 * seen.depth:.1f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
