# SPDX-License-Identifier: Apache-2.0
"""Where the lobes of a frame begin: as they were, moved on, turned to a lost lamp, pulled in."""

import torch

from asglight.fitting.following.pull_in import pulled_in, re_detected, responsibilities
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes
from asglight.lobes.frames import parallel_transport
from asglight.lobes.identity.near import onward

DAMPING_START = 0.05
"""More than a first frame's: the steps are few, and with 1e-3 the first one often fails."""


def initial_guess(
    before: Lobes, earlier: Lobes | None, frame: objective.Target, width_min: float
) -> tuple[newton.Outcome, float]:
    """Return the best of the lobes as they were, moved on as they moved, turned to a lost lamp.

    Each of these competes, and each pulled in by the lamps from there.

    Args:
        before: The frame before, in the exposure of this one.  [N, .]
        earlier: The frame before that.  [N, .]
        frame: This frame.
        width_min: Sigma of the narrowest lobe allowed, radians.

    Returns:
        The best of these, and the loss of the lobes as they were, with the light that they had.
    """
    places = [before.axis_z]
    if earlier is not None:
        places.append(onward(before, earlier, ~temporal.is_dark(earlier)))
    still = lobe_images.images(_at(before, torch.stack(places)), frame.places)
    taken = responsibilities(still)
    found = re_detected(still.lobes[:1], taken[:1], frame)
    if found is not None:
        seeing = lobe_images.images(found, frame.places)
        still, taken = (
            lobe_images.joined(still, seeing),
            torch.cat([taken, responsibilities(seeing)]),
        )
    count = len(taken)
    after = pulled_in(still.lobes, taken, frame.repeated(count), width_min)
    onwards = lobe_images.images(after, frame.places)
    radiance = torch.cat([still.radiance, onwards.radiance])
    value = objective.value(radiance, frame.repeated(2 * count))
    still_best, after_best = value.view(2, -1).argmin(-1, keepdim=True)
    pair = lobe_images.joined(still[still_best], onwards[after_best])
    lit = light.solve_amplitudes(pair, frame.repeated(2))
    as_it_was = float(value[0])
    value = objective.value(lit.radiance, frame.repeated(2))
    damping = torch.full_like(value, DAMPING_START)
    return newton.Outcome(lit.lobes, value, damping, lit).best(), as_it_was


def _at(lobes: Lobes, axis_z: torch.Tensor) -> Lobes:
    """Turn lobes the shortest way.  axis_z: [..., N, 3]; result [..., N, .]."""
    batch = axis_z.shape[:-2]
    return Lobes(
        parallel_transport(lobes.axes.expand(*batch, *lobes.axes.shape), axis_z),
        lobes.sharpness.expand(*batch, *lobes.sharpness.shape),
        lobes.amplitude.expand(*batch, *lobes.amplitude.shape),
        lobes.form,
    )
