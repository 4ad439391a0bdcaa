# SPDX-License-Identifier: Apache-2.0
"""Whether a map is shown better by flat lobes than by asg lobes, eight numbers each.

Soft boxes, windows and ceiling lamps have a top and an edge, skies and rooms do not. A trial tells
in a twentieth of the time of a first frame: the asg fit's lobes become flat ones of the same flux
and variances, and both take some steps. Only where J falls are flat lobes fitted from the start,
and only where J ends lower are they kept (docs/method/fewer-lobes.md).
"""

from dataclasses import replace

from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes, flat

GAIN = 0.03
"""Share of J that flat lobes must gain, in the trial and in the end. On ten maps and frames of
`tunnel` the trial gains 6 to 20 % on those it chooses, and 0 % or less on the others."""

STEPS = 4
"""Of the trial, each way."""

CORNERS = Corners(0.3, 0.03)
"""phi's corners of the trial: those of the last soft level, under which few steps do much."""


def promises(lobes: Lobes, frame: objective.Target, width_min: float) -> bool:
    """Tell whether a few steps as flat lobes lower J below as many as asg lobes.

    Args:
        lobes: An asg fit.  [1, N, .]
        frame: The map.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    softened = replace(frame, corners=CORNERS)
    before = newton.minimise(lobes, softened, STEPS, width_min=width_min)
    shown = lobe_images.images(flat.as_flat(before.lobes), softened.places)
    start = light.solve_amplitudes(shown, softened).lobes
    return gains(newton.minimise(start, softened, STEPS, width_min=width_min), before)


def gains(found: newton.Outcome, other: newton.Outcome) -> bool:
    """Tell whether one outcome's J is lower than another's by the share of `GAIN`.  F = 1."""
    return float(found.value) < (1 - GAIN) * float(other.value)
