# SPDX-License-Identifier: Apache-2.0
"""Whether the brute force that judges balls agrees with Mitsuba 3.

    python -m dcc.ball_truth

Three lobes, one in each channel: what a channel shows is that lobe alone. Mitsuba is given their
radiance at the directions at which it reads texels, so that no image is between the two but linear
interpolation over 0.18 degrees. `asglight/shading/brute_force.py` integrates the lobes themselves.

Smith's term is the product of both sides in Mitsuba and height-correlated in asglight. So the brute
force is run with both: with Mitsuba's it has to agree within Mitsuba's noise; what is left with
ours is the difference of the two models.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import torch

from asglight.lobes import Lobes
from asglight.shading import brute_force, ggx
from dcc import renderers, rows, scene, truth
from dcc.quadrature import separable_visibility
from dcc.truth import SHARPNESS, mitsuba_balls, three_lobes

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
    usual = truth.Asked(Path("dcc-output/ball_truth"), 16, 4096, renderers.PYTHON)
    return truth.command(argv, __doc__, usual, agreements, table)


def agreements(asked: truth.Asked) -> Iterator[Agreement]:
    """Render the balls and hold them against the brute force."""
    lobes, size = three_lobes(), asked.size
    pictures = mitsuba_balls(asked, [*MATERIALS.values()], "points", SEEDS)
    pictures = pictures[..., scene.judged(size), :]
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
