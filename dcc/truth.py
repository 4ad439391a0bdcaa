# SPDX-License-Identifier: Apache-2.0
"""What the two checks against Mitsuba share: three lobes, balls under them, the command."""

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images.exr_writer import write_exr
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import axes_from_quaternion
from dcc import renderers, rows

IMAGE_ROWS = 1024
"""Of the image: a lobe of sharpness 400 is 11 texels wide (standard deviation), which linear
interpolation widens by 1 / (12 11^2) of it, 0.07 %."""

SHARPNESS = ((2.0, 1.0), (40.0, 10.0), (400.0, 100.0))
"""Of the lobes in red, green and blue: as wide as a sky, a window, a lamp."""

QUATERNIONS = ((0.8, -0.6, 0.1, 0.2), (0.9, -0.2, 0.5, 0.3), (0.3, 0.2, 0.9, -0.4))
"""Of the lobes: one from above, one in front, one from behind, all rolled."""


class Verdict(Protocol):
    """A row of the table: a dataclass that knows whether it agrees."""

    @property
    def agrees(self) -> bool:
        """Whether the error is what it may be."""
        ...


_Row = TypeVar("_Row", bound=Verdict)


@dataclass(frozen=True)
class Asked:
    """How balls are rendered.

    Attributes:
        folder: For what is written on the way.
        size: Pixels across a ball.
        samples: Of a pixel and seed.
        python: An interpreter that has Mitsuba.
    """

    folder: Path
    size: int
    samples: int
    python: Path


def command(
    argv: Sequence[str] | None,
    about: str | None,
    usual: Asked,
    found_for: Callable[[Asked], Iterable[_Row]],
    table: Callable[[Sequence[_Row]], str],
) -> int:
    """Render, compare, print a table and write it as JSON.

    Args:
        argv: The command line; None for that of the process.
        about: What the check is.
        usual: What is asked where the command line says nothing; the file is named as the folder.
        found_for: Makes the rows.
        table: Prints them.

    Returns:
        0 where all agree, 1 where one does not, 2 where nothing can be rendered.
    """
    parser = argparse.ArgumentParser(description=about)
    add = parser.add_argument
    add("--size", type=int, default=usual.size, metavar="S", help="pixels across (%(default)s)")
    samples = "of a pixel and seed (%(default)s)"
    add("--samples", type=int, default=usual.samples, metavar="N", help=samples)
    add("--python", type=Path, default=usual.python, help="an interpreter that has Mitsuba")
    add("-o", "--output", type=Path, default=usual.folder, metavar="DIR", help="(%(default)s)")
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    try:
        found = list(
            found_for(Asked(options.output, options.size, options.samples, options.python))
        )
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2
    listed = [vars(row) for row in found]
    (options.output / f"{usual.folder.name}.json").write_text(json.dumps(listed, indent=1) + "\n")
    print(table(found))
    return 0 if all(row.agrees for row in found) else 1


def mitsuba_balls(
    asked: Asked, materials: Sequence[float | None], pixels: str, seeds: Sequence[int]
) -> rows.Array:
    """Render balls under the three lobes in Mitsuba.

    Args:
        asked: Size and samples.
        materials: Roughness of each ball; None for a matte one.
        pixels: `points` at their centres or `means` over them.
        seeds: One rendering each.

    Returns:
        [seed, view, material, S, S, 3]
    """
    image, out = asked.folder / "lobes.exr", asked.folder / "lobes.npz"
    write_image(image, three_lobes())
    job = {
        "image": str(image.resolve()),
        "out": str(out.resolve()),
        "size": asked.size,
        "materials": list(materials),
        "pixels": pixels,
        "samples": asked.samples,
        "seeds": list(seeds),
    }
    renderers.run("dcc.mitsuba_render", [job], asked.folder, asked.python)
    return np.load(out)["balls"].astype(float)


def three_lobes() -> Lobes:
    """Return a lobe in each channel, of one flux each so that Mitsuba samples them alike."""
    unit = Lobes(
        axes_from_quaternion(torch.tensor(QUATERNIONS, dtype=torch.float64)),
        torch.tensor(SHARPNESS, dtype=torch.float64),
        torch.eye(3, dtype=torch.float64),
    )
    return replace(unit, amplitude=unit.amplitude / asg.integral(unit)[:, None])


def write_image(path: Path, lobes: Lobes) -> None:
    """Write the lobes' radiance where Mitsuba has texels."""
    write_exr(path, asg.evaluate(lobes, mitsuba_directions()).view(IMAGE_ROWS, -1, 3), half=False)


def mitsuba_directions() -> Tensor:
    """Return where Mitsuba has texels: the first and last row are on the poles.  [T, 3]."""
    v = torch.linspace(0, 1, IMAGE_ROWS, dtype=torch.float64)[:, None] * math.pi
    width = 2 * IMAGE_ROWS
    longitude = math.pi - 2 * math.pi * (torch.arange(width, dtype=torch.float64) + 0.5) / width
    x, z = v.sin() * longitude.sin(), v.sin() * longitude.cos()
    return torch.stack([x, v.cos().expand_as(x), z], dim=-1).view(-1, 3)
