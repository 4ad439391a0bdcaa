# SPDX-License-Identifier: Apache-2.0
"""Whether lobes of another form show a map better than asg lobes.

Soft boxes, windows and ceiling lamps have a top and an edge, as flat lobes have. And an asg lobe
ends at its hemisphere: light from all around takes several of them, and one sg lobe. A trial of
a few steps tells: the asg fit's lobes become others of the same flux and variances, and both take
them. Only where J falls are lobes of the other form fitted from the start, and only where J ends
lower are they kept (docs/method/fewer-lobes.md).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from asglight.fitting.first_frame.reweighting import Measured
from asglight.fitting.loss import lobe_images, objective
from asglight.fitting.loss.objective import Corners
from asglight.fitting.steps import light, newton
from asglight.lobes import Form, Lobes, flat
from asglight.lobes.isotropic import as_sg

GAIN = 0.03
"""Share of J that other lobes must gain, in the trial and in the end. On ten maps and frames of
`tunnel` the trial of flat lobes gains 6 to 20 % on those it chooses, and 0 % or less on the others.
With 8 lobes that of sg lobes loses 8 % or more on ten maps of 64 rows."""

STEPS = 4
"""Of a trial, each way."""

CORNERS = Corners(0.3, 0.03)
"""phi's corners of a trial: those of the last soft level, under which few steps do much."""


def promising(
    lobes: Lobes, yardstick: Lobes, frame: objective.Target, width_min: float
) -> Iterator[Form]:
    """Give the forms as which a few steps lower J below as many steps as asg lobes.

    Args:
        lobes: An asg fit.  [1, N, .]
        yardstick: As many sg lobes that took no steps: three and more asg lobes share out a room
            that one of these stands for, and steps do not gather them again.  [N, .]
        frame: The map.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    softened = replace(frame, corners=CORNERS)
    before = newton.minimise(lobes, softened, STEPS, width_min=width_min)

    def promises(start: Lobes) -> bool:
        shown = lobe_images.images(start, softened.places)
        lit = light.solve_amplitudes(shown, softened).lobes
        return gains(newton.minimise(lit, softened, STEPS, width_min=width_min), before)

    if promises(flat.as_flat(before.lobes)):
        yield Form.FLAT
    if promises(as_sg(before.lobes)) or promises(yardstick[None]):
        yield Form.SG


def best_of(plain: Measured, others: Iterable[Measured]) -> Measured:
    """Return the fit of the lowest J; the asg fit unless another gains enough.

    Args:
        plain: The asg fit.
        others: Those of the forms that promise to gain.
    """
    least = min(others, key=lambda each: float(each.found.value), default=plain)
    return least if gains(least.found, plain.found) else plain


def gains(found: newton.Outcome, other: newton.Outcome) -> bool:
    """Tell whether one outcome's J is lower than another's by the share of `GAIN`.  F = 1."""
    return float(found.value) < (1 - GAIN) * float(other.value)
