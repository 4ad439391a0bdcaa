# SPDX-License-Identifier: Apache-2.0
"""Where the lobes of a frame begin: as they were, moved on, turned with the camera, pulled in."""

import torch
from torch import Tensor

from asglight.fitting.following.camera import turned_with_it
from asglight.fitting.following.pull_in import pulled_in, re_detected, responsibilities, seen
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes
from asglight.lobes.frames import parallel_transport
from asglight.lobes.identity.near import onward

DAMPING_START = 0.05
"""More than a first frame's: the steps are few, and with 1e-3 the first one often fails."""


TOGETHER_GAIN = 0.02
"""Share of J by which lobes that turn together must do better than others: by less, the rotation is
that of one lamp which moves by itself, and the others only follow it."""


def initial_guess(
    before: Lobes, earlier: Lobes | None, frame: objective.Target, width_min: float
) -> tuple[newton.Outcome, float]:
    """Return the best of the lobes as they were, and turned in three ways.

    They are turned on as they moved, all together as a camera turns, and each to the lamp that it
    lost. Each of these competes, and each pulled in by the lamps from there.

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
    as_it_was, own = still.lobes[:1], taken[:1]
    found = re_detected(as_it_was, own, frame)
    if found is not None:
        still, taken = _with(still, taken, found, frame)
    still, taken = _with(still, taken, _with_the_camera(as_it_was, own, frame), frame)
    count = len(taken)
    after = pulled_in(still.lobes, taken, frame.repeated(count), width_min)
    onwards = lobe_images.images(after, frame.places)
    radiance = torch.cat([still.radiance, onwards.radiance])
    value = objective.value(radiance, frame.repeated(2 * count))
    judged = value.view(2, -1).clone()
    enough = (1 - TOGETHER_GAIN) * judged[:, :-1].min()
    judged[:, -1][judged[:, -1] >= enough] = torch.inf
    still_best, after_best = judged.argmin(-1, keepdim=True)
    pair = lobe_images.joined(still[still_best], onwards[after_best])
    lit = light.solve_amplitudes(pair, frame.repeated(2))
    loss_before = float(value[0])
    value = objective.value(lit.radiance, frame.repeated(2))
    damping = torch.full_like(value, DAMPING_START)
    return newton.Outcome(lit.lobes, value, damping, lit).best(), loss_before


def _with_the_camera(lobes: Lobes, taken: Tensor, frame: objective.Target) -> Lobes:
    """Turn lobes together, twice: the second time they see what the first brought into sight."""
    turned = turned_with_it(lobes, *seen(lobes, taken, frame))
    seeing = lobe_images.images(turned, frame.places)
    return turned_with_it(turned, *seen(turned, responsibilities(seeing), frame))


def _with(
    shown: lobe_images.Images, taken: Tensor, lobes: Lobes, frame: objective.Target
) -> tuple[lobe_images.Images, Tensor]:
    """Add lobes to those that compete."""
    seeing = lobe_images.images(lobes, frame.places)
    return lobe_images.joined(shown, seeing), torch.cat([taken, responsibilities(seeing)])


def _at(lobes: Lobes, axis_z: Tensor) -> Lobes:
    """Turn lobes the shortest way.  axis_z: [..., N, 3]; result [..., N, .]."""
    batch = axis_z.shape[:-2]
    return Lobes(
        parallel_transport(lobes.axes.expand(*batch, *lobes.axes.shape), axis_z),
        lobes.sharpness.expand(*batch, *lobes.sharpness.shape),
        lobes.amplitude.expand(*batch, *lobes.amplitude.shape),
        lobes.form,
    )
