# SPDX-License-Identifier: Apache-2.0
"""Lobes that are lost: after a cut, or where many lamps changed at once, they show too little.

Steps go downhill from where lobes were, and relocation takes few of them elsewhere. So J is held
against the yardstick of first frames (reweighting.py): a mixture of isotropic lobes that took no
steps, and that a fit from nothing is far ahead of. What no lobes can show, such as noise, counts
against both.
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


def is_lost(
    loss: float,
    unlike: float,
    reference: Tensor,
    frame: objective.Target,
    exposure: float,
    count: int,
) -> bool:
    """Tell whether lobes that followed are behind the yardstick of first frames (reweighting.py).

    Args:
        loss: J of the lobes.
        unlike: J of the lobes as they were.
        reference: Repaired radiance.  [H, 2 H, 3]
        frame: The map.
        exposure: Its mean radiance.
        count: Lobes lit at most.
    """
    if loss <= LOST or unlike <= CUT:
        return False
    yardstick = seeding.seed_lobes(seeding.cells(reference / exposure), count, Form.SG, None)
    shown = lobe_images.images(yardstick[None], frame.places)
    return loss > float(objective.value(shown.radiance, frame))
