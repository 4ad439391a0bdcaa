# SPDX-License-Identifier: Apache-2.0
"""Lobes for a map that is sampled at texel centres: none narrower than a texel can hold."""

import math
from dataclasses import replace

from asglight.lobes import Form, Lobes, asg, flat

SIGMA_TEXELS = 0.5
"""Standard deviation, in texels, of the blur: sums over samples of a Gaussian this wide are within
2 % of its integral, wherever it lies between them."""


def widened(lobes: Lobes, rows: int) -> Lobes:
    """Blur lobes by half a texel at the equator, each with its flux kept.

    Variances add: `1 / (2 s') = 1 / (2 s) + sigma^2`, and `1 / s' = 1 / s + sigma^2` for the sg
    form, whose exponent near the axis is `-s/2` times the squared angle. Of the flat form the
    narrowest term becomes as wide as a lobe of the others: an edge needs samples too.

    Args:
        lobes: N lobes.  [N, .]
        rows: Rows of the map.
    """
    variance = (SIGMA_TEXELS * math.pi / rows) ** 2
    factor = asg.per_variance(lobes.form)
    if lobes.form is Form.FLAT:
        factor = asg.per_variance(Form.ASG) * max(multiple for multiple, _ in flat.TERMS)
    sharpness = 1 / (1 / lobes.sharpness + factor * variance)
    wide = replace(lobes, sharpness=sharpness)
    share = asg.integral(lobes) / asg.integral(wide)
    return replace(wide, amplitude=lobes.amplitude * share[:, None])
