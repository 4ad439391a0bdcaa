# SPDX-License-Identifier: Apache-2.0
"""Lobes that are lost: after a cut, or where many lamps changed at once, they show too little.

Steps go downhill from where lobes were, and relocation takes few of them elsewhere. So J is held
against a yardstick: the seeds of a first frame (seeding.py), which took no steps, and which a fit
from nothing is far ahead of. What no lobes can show, such as noise, counts against both.
"""

from torch import Tensor

from asglight.fitting.first_frame import seeding
from asglight.fitting.loss import lobe_images, objective
from asglight.lobes import Form

CUT = 0.75
"""J of the lobes as they were, up to which a frame is much like the one before. Of a camera in the
hand it is at most 0.5, of all lamps that change at once 1 to 5."""

LOST = 0.1
"""J up to which lobes that follow are never lost: irr of made-up shots is then about 0.002, and the
yardstick takes a quarter of the time of a `live` frame."""

BEHIND = 1.2
"""J over that of the yardstick from which lobes are lost. A few lobes of the form asg are no better
than their seeds: with 1, three lobes on `day` are fitted from nothing in 22 of 24 frames, and no
such fit is taken."""


def is_lost(
    loss: float,
    unlike: float,
    reference: Tensor,
    frame: objective.Target,
    exposure: float,
    count: int,
    form: Form,
) -> bool:
    """Tell whether lobes that followed are behind the seeds of a first frame.

    Args:
        loss: J of the lobes.
        unlike: J of the lobes as they were.
        reference: Repaired radiance.  [H, 2 H, 3]
        frame: The map.
        exposure: Its mean radiance.
        count: Lobes lit at most.
        form: Theirs.
    """
    if loss <= LOST or unlike <= CUT:
        return False
    yardstick = seeding.seed_lobes(seeding.cells(reference / exposure), count, form, None)
    shown = lobe_images.images(yardstick[None], frame.places)
    return loss > BEHIND * float(objective.value(shown.radiance, frame))
