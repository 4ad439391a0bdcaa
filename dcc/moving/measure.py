# SPDX-License-Identifier: Apache-2.0
"""Render shots through the Blender extension and hold a matte ball against the lobes' integral.

Each shot is rendered at its first, middle and last frame and half-way between two, through File >
Import > USD (the hook) and through the extension's own importer. The lobes are those of the stage
at that time (`asglight.lobes.motion`), integrated in float64. The exit status is 1 where a row is
above its limit, 2 where something is missing.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from asglight.errors import InputError
from asglight.lobes import motion
from asglight.usd import read_usd, write_usd
from dcc import lobe_light, quadrature, renderers, rows, scene, shots, usdlux
from dcc.rows import Array
from dcc.shots import Shot

LIMIT = 0.015
"""Of a matte ball's relative RMS error."""

SEEDS = [1, 2]

DOME_ROWS = 256

AS_SUNS = "distant"
"""Held against the suns as UsdLux defines them: broad lobes are something else as suns."""

AS_CARDS, AS_DOME = {"representation": "cards"}, {"representation": "dome"}

KIN = {
    "usdz": {"representations": ("cards",)},
    "z-up": {"representations": ("cards",), "up_axis": "Z", "meters_per_unit": 0.01},
    "acescg": {"representations": ("dome", "cards"), "colorspace": "ACEScg"},
    AS_SUNS: {"representations": ("distant",)},
}
"""Stages of the built-in sky with other options: each is imported in both ways."""


PLACES = ("first", "middle", "last", "half frame")
"""Of times in a shot."""


@dataclass(frozen=True)
class Row:
    """A ball at a time.

    Attributes:
        shot: Of which shot.
        way: How it came into Blender, and as what.
        time: Frame, or half-way between two.
        error: Relative RMS error against the lobes' integral.
        level: Sum of the picture over that of the integral.
        noise: Relative RMS noise of the picture.
    """

    shot: str
    way: str
    time: float
    error: float
    level: float
    noise: float

    @property
    def agrees(self) -> bool:
        """Whether the error is what it may be."""
        return self.error <= LIMIT


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, write and print; return the exit status."""
    options = shots.extension_parser("dcc.moving", __doc__, "dcc-output/moving").parse_args(argv)
    torch.set_num_threads(1)  # the renderer has the cores
    try:
        found = run(options)
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2
    listed = {"version": found[0], "rows": [asdict(row) for row in found[1]]}
    (options.output / "moving.json").write_text(json.dumps(listed, indent=1) + "\n")
    print(f"Blender {found[0]}\n\n{table(found[1])}")
    return 0 if all(row.agrees for row in found[1]) else 1


def run(options: argparse.Namespace) -> tuple[str, list[Row]]:
    """Render as the options say; return Blender's version and the rows."""
    output = options.output.resolve()
    (output / "renders").mkdir(parents=True, exist_ok=True)
    chosen = [shots.built_in(output)]
    if not options.short:
        chosen = shots.from_sequences(options.sequences, 3, output)
        chosen.append(shots.built_in(output))
    jobs = [job for shot in chosen for job in _jobs(shot, options, output)]
    renderers.run("dcc.moving.render", jobs, output, options.python)
    found = [row for job in jobs for row in _rows(job)]
    return str(np.load(jobs[0]["out"])["version"]), found


def _jobs(shot: Shot, options: argparse.Namespace, output: Path) -> Iterator[dict[str, Any]]:
    frames = shot.tracks.frames
    times = [*shot.frames, frames[len(frames) // 2] + 0.5]
    if len(shot.frames) == 1:
        times = [frames[0], frames[1] - 0.5, frames[-1]]
    common = {
        "shot": shot.name,
        "times": times,
        "size": options.size,
        "samples": options.samples,
        "seeds": SEEDS,
        "rows": DOME_ROWS,
        "zip": str(options.zip.resolve()),
        "settings": {},
    }

    def job(stage: Path, way: str, what: str, **settings: str) -> dict[str, Any]:
        out = output / "renders" / f"{shot.name}-{stage.stem}-{way}-{what}.npz"
        named = {"stage": str(stage.resolve()), "way": way, "what": what, "out": str(out)}
        return {**common, **named, "settings": settings}

    stage = shot.stages["Y"]
    yield job(stage, "hook", "cards")
    yield job(stage, "importer", "cards", **AS_CARDS)
    yield job(stage, "importer", "dome", **AS_DOME)
    if shot.name != "sky":
        return
    for name, written in KIN.items():
        suffix = ".usdz" if name == "usdz" else ".usda"
        path = output / f"{shot.name}-{name}{suffix}"
        write_usd(shot.tracks, path, **written)
        for way in ("hook", "importer"):
            yield job(path, way, name)


def _rows(job: dict[str, Any]) -> Iterator[Row]:
    pictures = np.load(job["out"])["balls"].astype(np.float64)
    pixels = scene.judged(job["size"])
    way = f"{job['way']}, {job['what']}"
    for time, picture in zip(job["times"], pictures, strict=True):
        expected = _expected(Path(job["stage"]), time, job["size"], as_suns=job["what"] == AS_SUNS)
        seen = picture[:, :, 0][:, :, pixels]
        mean = seen.mean(0)
        yield Row(
            job["shot"],
            way,
            time,
            rows.relative_rms(mean, expected),
            float(mean.sum() / expected.sum()),
            rows.noise(seen),
        )


@lru_cache(maxsize=16)
def _expected(stage: Path, time: float, size: int, *, as_suns: bool) -> Array:
    """Return what matte balls show under a stage; kept, for a stage is rendered in several ways.

    Args:
        stage: The stage.
        time: Frame, or between two.
        size: Pixels across a ball.
        as_suns: Integrate its distant lights, and not its lobes.

    Returns:
        Radiance of both views at the judged pixels.  [view, P, 3]
    """
    if as_suns:
        light = usdlux.light_of(stage, time)
    else:
        light = lobe_light.light_of(motion.at(read_usd(stage), [time])[0])
    views = [
        quadrature.shown([light], torch.from_numpy(scene.normals(size, view)), _to(view), None)
        for view in scene.VIEWS
    ]
    return torch.stack(views, dim=1)[0].numpy()


def _to(view: str) -> torch.Tensor:
    return torch.tensor(scene.VIEWS[view], dtype=torch.float64)


def table(found: Sequence[Row]) -> str:
    """Return the errors as Markdown, percent: a line for each shot and way, a column for a time."""
    columns = ["shot", "through", *PLACES, "noise"]
    lines = [f"| {' | '.join(columns)} |", "| --- | --- |" + " ---: |" * (len(PLACES) + 1)]
    for (shot, way), group in itertools.groupby(found, lambda row: (row.shot, row.way)):
        rows = sorted(group, key=lambda row: row.time)
        at_frames = [row for row in rows if row.time == int(row.time)]
        between = [row for row in rows if row.time != int(row.time)]
        middle = at_frames[1:-1]
        cells = [_cell(some) for some in (at_frames[:1], middle, at_frames[-1:], between)]
        noise = f"{100 * max(row.noise for row in rows):.2f}"
        lines.append(f"| {shot} | {way} | {' | '.join(cells)} | {noise} |")
    return "\n".join(lines)


def _cell(rows: Sequence[Row]) -> str:
    """Return the largest error of some rows."""
    if not rows:
        return "–"
    worst = max(rows, key=lambda row: row.error)
    return f"{100 * worst.error:.2f}" + ("" if worst.agrees else " ABOVE")


if __name__ == "__main__":
    sys.exit(main())
