# SPDX-License-Identifier: Apache-2.0
"""Whether the balls that pictures and comparisons are judged by agree with Mitsuba 3.

    python -m dcc.drawn_truth

`asglight/shading/balls.py` draws balls from texels; a pixel is the mean over its area, and so it is
in Mitsuba here. The light is that of `dcc.ball_truth`, one lobe a channel: Mitsuba reads it from an
image of 1,024 rows, `render_balls` from texel means of 512. Both show all of the ball, edge
included, from both sides, and with the same Smith term, Mitsuba's. Rough balls are compared in
blocks of pixels, over which they hardly change and Mitsuba's noise does.
"""

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np
import torch

from asglight.lobes import Lobes, texels
from asglight.shading import ggx
from asglight.shading.balls import ROUGHNESS, render_balls
from dcc import renderers, rows, scene, truth
from dcc.quadrature import separable_visibility
from dcc.truth import SHARPNESS, mitsuba_balls, three_lobes

MAP_ROWS = 512
"""Of the map that is drawn from: the finest grid of `render_balls`."""

SEEDS = tuple(range(4))

BLOCK = {0.05: 1, 0.1: 1, 0.25: 4, 0.5: 8, 1.0: 8}
"""Pixels along an edge of what is compared, by roughness."""

LIMITS = {0.05: 0.01, 0.1: 0.01, 0.25: 0.02, 0.5: 0.005, 1.0: 0.005}
"""By roughness: what `render_balls` itself may be off by, relative, summed over a ball. Under a
lamp its points are noise of their own on sharp balls, and its layers do not meet exactly at 0.25;
on rough ones texel centres stand for texels."""


@dataclass(frozen=True)
class Drawn:
    """How near a drawn ball is to Mitsuba's under one lobe.

    Attributes:
        sharpness: Of the lobe.
        roughness: Of the ball.
        error: Sum of absolute differences over the sum of Mitsuba's, all pixels of both sides.
        noise: What of that Mitsuba's noise makes, from the spread of its seeds.
        energy: Sum of the drawn pixels over Mitsuba's.
        correlated: The error of the ball as it is drawn, with asglight's Smith term.
    """

    sharpness: tuple[float, float]
    roughness: float
    error: float
    noise: float
    energy: float
    correlated: float

    @property
    def agrees(self) -> bool:
        """Whether the error is noise, or below what is stated."""
        return self.error <= self.noise + LIMITS[self.roughness]


def main(argv: Sequence[str] | None = None) -> int:
    """Render, draw, print a table; 0 where all agree."""
    usual = truth.Asked(Path("dcc-output/drawn_truth"), 64, 1024, renderers.PYTHON)
    return truth.command(argv, __doc__, usual, agreements, table)


def agreements(asked: truth.Asked) -> Iterator[Drawn]:
    """Render balls in Mitsuba and hold the drawn ones against them."""
    lobes, size = three_lobes(), asked.size
    rendered = mitsuba_balls(asked, ROUGHNESS, "means", SEEDS)  # [seed, view, R, S, S, 3]
    ours = drawn(lobes, size)
    with mock.patch.object(ggx, "visibility", separable_visibility):
        as_mitsuba = drawn(lobes, size)
    for place, roughness in enumerate(ROUGHNESS):
        seeds, found, correlated = (
            block_means(balls, BLOCK[roughness])
            for balls in (rendered[:, :, place], as_mitsuba[:, place], ours[:, place])
        )
        mean = seeds.mean(0)
        for index, sharpness in enumerate(SHARPNESS):
            yield Drawn(
                sharpness,
                roughness,
                rows.relative_mean(found[..., index], mean[..., index]),
                absolute_noise(seeds[..., index]),
                float(found[..., index].sum() / mean[..., index].sum()),
                rows.relative_mean(correlated[..., index], mean[..., index]),
            )


def drawn(lobes: Lobes, size: int) -> rows.Array:
    """Draw the balls of both views from texel means.  [view, R, S, S, 3]."""
    means = texels.texel_means(lobes.to(torch.float32), MAP_ROWS, 2 * MAP_ROWS)[None]
    views = [
        render_balls(means, ROUGHNESS, size=size, view=view)[0] for view in scene.VIEWS.values()
    ]
    return torch.stack(views).double().numpy()


def block_means(balls: rows.Array, edge: int) -> rows.Array:
    """Average blocks of pixels.  [..., S, S, 3] -> [..., S / edge, S / edge, 3]."""
    *leading, size, _, channels = balls.shape
    count = size // edge
    return balls.reshape(*leading, count, edge, count, edge, channels).mean((-4, -2))


def absolute_noise(seeds: rows.Array) -> float:
    """Return the relative absolute error that the noise of S renders' mean amounts to.  [S, ...].

    Of a normal distribution the mean absolute deviation is sqrt(2 / pi) of the standard one, and
    the root of the variance of n draws is on average c4(n) of it: 0.92 for four, which many pixels
    do not average out.
    """
    count = len(seeds)
    c4 = math.sqrt(2 / (count - 1)) * math.gamma(count / 2) / math.gamma((count - 1) / 2)
    deviation = np.sqrt(seeds.var(0, ddof=1) / count) / c4
    return float(math.sqrt(2 / math.pi) * deviation.sum() / seeds.mean(0).sum())


def table(found: Sequence[Drawn]) -> str:
    """Return the agreements as Markdown, errors in percent."""
    head = "| roughness | sharpness | error | noise | energy | error with our Smith term | |"
    lines = [head, "| --- " * 7 + "|"]
    for one in found:
        sharpness = " x ".join(f"{value:g}" for value in one.sharpness)
        errors = [f"{100 * value:.2f}" for value in (one.error, one.noise)]
        cells = [f"{one.roughness:g}", sharpness, *errors, f"{one.energy:.4f}"]
        cells += [f"{100 * one.correlated:.2f}", "agrees" if one.agrees else "DIFFERS"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
