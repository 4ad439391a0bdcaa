# SPDX-License-Identifier: Apache-2.0
"""Whether the brute force that judges balls agrees with Mitsuba 3.

    python -m dcc.ball_truth -o dcc-output/truth

Three lobes, one in each channel: what a channel shows is that lobe alone. Mitsuba is given their
radiance at the directions at which it reads texels, so that no image is between the two but linear
interpolation over 0.18 degrees. `asglight/shading/brute_force.py` integrates the lobes themselves.

Smith's term is the product of both sides in Mitsuba and height-correlated in asglight. So the brute
force is run with both: with Mitsuba's it has to agree within Mitsuba's noise; what is left with
ours is the difference of the two models.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.images.exr_writer import write_exr
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import axes_from_quaternion
from asglight.shading import brute_force, ggx
from dcc import renderers, rows, scene
from dcc.quadrature import separable_visibility

IMAGE_ROWS = 1024
"""Of the image: a lobe of sharpness 400 is 11 texels wide (standard deviation), which linear
interpolation widens by 1 / (12 11^2) of it, 0.07 %."""

SHARPNESS = ((2.0, 1.0), (40.0, 10.0), (400.0, 100.0))
"""Of the lobes in red, green and blue: as wide as a sky, a window, a lamp."""

QUATERNIONS = ((0.8, -0.6, 0.1, 0.2), (0.9, -0.2, 0.5, 0.3), (0.3, 0.2, 0.9, -0.4))
"""Of the lobes: one from above, one in front, one from behind, all rolled."""

MATERIALS = {**scene.MATERIALS, "r1": 1.0}
"""Roughness 1 too, where Smith's two terms differ most."""

SEEDS = tuple(range(8))

NOISE_TIMES = 2.0
"""An error that is noise alone has the size of the noise, give or take a quarter: under the
narrowest lobe some ten bright pixels decide both. Twice that would be four such quarters off."""

FLOOR = 1e-3
"""Relative: what the brute force (0.02 to 0.07 %) and the interpolation are off by."""


@dataclass(frozen=True)
class Agreement:
    """How near Mitsuba is on one kind of ball under one lobe.

    Attributes:
        sharpness: Of the lobe.
        material: A key of `MATERIALS`.
        separable: Relative RMS error against the brute force with Mitsuba's Smith term.
        energy: Sum of Mitsuba's pixels over that of the same brute force.
        correlated: Relative RMS error against the brute force as it is.
        noise: Relative RMS noise of the render.
    """

    sharpness: tuple[float, float]
    material: str
    separable: float
    energy: float
    correlated: float
    noise: float

    @property
    def agrees(self) -> bool:
        """Whether the error is noise."""
        return self.separable <= math.hypot(NOISE_TIMES * self.noise, FLOOR)


def main(argv: Sequence[str] | None = None) -> int:
    """Render, integrate, print a table; 0 where all agree."""
    parser = argparse.ArgumentParser(prog="dcc.ball_truth", description=__doc__)
    add = parser.add_argument
    add("--size", type=int, default=16, metavar="S", help="pixels across a ball (16)")
    add("--samples", type=int, default=4096, metavar="N", help="of a pixel and seed (4096)")
    add("--python", type=Path, default=renderers.PYTHON, help="an interpreter that has Mitsuba")
    add("-o", "--output", type=Path, default=Path("dcc-output/truth"), metavar="DIR")
    options = parser.parse_args(argv)
    options.output.mkdir(parents=True, exist_ok=True)
    try:
        found = list(agreements(options.output, options.size, options.samples, options.python))
    except InputError as error:
        print(f"dcc: {error}", file=sys.stderr)
        return 2
    listed = [asdict(agreement) for agreement in found]
    (options.output / "ball_truth.json").write_text(json.dumps(listed, indent=1) + "\n")
    print(table(found))
    return 0 if all(agreement.agrees for agreement in found) else 1


def agreements(folder: Path, size: int, samples: int, python: Path) -> Iterator[Agreement]:
    """Render the balls and hold them against the brute force."""
    lobes = three_lobes()
    image, out = folder / "lobes.exr", folder / "lobes.npz"
    write_image(image, lobes)
    job = {"image": str(image.resolve()), "out": str(out.resolve()), "size": size}
    what = {"materials": [*MATERIALS.values()], "pixels": "points"}
    jobs = [{**job, **what, "samples": samples, "seeds": SEEDS}]
    renderers.run("dcc.mitsuba_render", jobs, folder, python)
    pictures = np.load(out)["balls"].astype(float)[..., scene.judged(size), :]
    for place, (material, roughness) in enumerate(MATERIALS.items()):
        ours = integrals(lobes, size, roughness)
        with mock.patch.object(ggx, "visibility", separable_visibility):
            as_mitsuba = integrals(lobes, size, roughness)
        for index, sharpness in enumerate(SHARPNESS):
            seeds = pictures[:, :, place, :, index]  # [S, view, P]
            mean = seeds.mean(0)
            yield Agreement(
                sharpness,
                material,
                rows.relative_rms(mean, as_mitsuba[..., index]),
                float(mean.sum() / as_mitsuba[..., index].sum()),
                rows.relative_rms(mean, ours[..., index]),
                rows.noise(seeds),
            )


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


def integrals(lobes: Lobes, size: int, roughness: float | None) -> rows.Array:
    """Integrate each lobe at the judged pixels of both views.  [view, P, N]."""
    views = []
    for name, towards in scene.VIEWS.items():
        normals = torch.from_numpy(scene.normals(size, name))
        if roughness is None:
            shown = brute_force.irradiance_over_pi(lobes, normals)
        else:
            view = torch.tensor(towards, dtype=torch.float64)
            # Fresnel reflectance 1: both parts of Schlick's term together
            shown = brute_force.reflected(lobes, normals, view, roughness).sum(-1)
        views.append(shown.mT * lobes.amplitude.sum(-1))
    return torch.stack(views).numpy()


def table(found: Sequence[Agreement]) -> str:
    """Return the agreements as Markdown, errors in percent."""
    head = "| sharpness | ball | error | noise | energy | error with our Smith term | |"
    lines = [head, "| --- " * 7 + "|"]
    for one in found:
        sharpness = " x ".join(f"{value:g}" for value in one.sharpness)
        errors = [f"{100 * value:.2f}" for value in (one.separable, one.noise)]
        cells = [sharpness, one.material, *errors, f"{one.energy:.4f}"]
        cells += [f"{100 * one.correlated:.2f}", "agrees" if one.agrees else "DIFFERS"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
