# SPDX-License-Identifier: Apache-2.0
"""Split and merge: a lobe that is hardly needed goes where one lobe stands for two.

Steps go downhill, so a fit keeps the share of lobes that its start gave to each lamp. A trial takes
away the lobe whose loss would cost least and halves the one that fits its own place worst; it is
kept if J is lower after some steps, in the spirit of split-and-merge EM [Ueda et al. 2000].

What a lobe's absence costs, with all others free to make up for it, is read off the Gauss-Newton
matrix: for its amplitudes a, a^T [(H^-1)_aa]^-1 a / 2 [Hassibi and Stork 1993].
"""

import math

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective
from asglight.fitting.coordinates import BROAD, UNKNOWNS
from asglight.lobes import Form, Lobes
from asglight.lobes.frames import orthonormal

OFFSET = 0.6
"""Of a half's centre from the whole's, in sigmas: what they lack in width they have in distance."""

HALF_LIGHT = 0.5 / math.sqrt(1 - OFFSET**2)
"""Amplitude of a half, of the whole's: it is narrower, and the two keep the flux."""

FIRST_STEPS, STEPS = 4, 10
"""Steps of a trial, and of one that looks well after the first."""

HOPEFUL = 1.15
"""J after the first steps, over that of the lobes as they were, up to which a trial goes on."""

GAIN = 1e-3
"""Share of J that a trial must gain: less is what more steps would bring as well."""

RIDGE = 1e-3
"""Of the unit diagonal of H, which is near singular where lobes stand in for each other."""


def regroup(
    start: newton.Outcome, frame: objective.Target, trials: int, width_min: float
) -> newton.Outcome:
    """Try splits, the worst lobe first, until all fail or the trials are used up.

    Args:
        start: A fit on the frame's grid.
        frame: The map and its weights.
        trials: At most.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    if start.lobes.count < 2:
        return start
    best = newton.minimise(start.lobes, frame, 2 * STEPS, width_min=width_min)
    order, spare = _order(best.lobes, frame)
    for _ in range(trials):
        if not order:
            break
        lobe, axis = order.pop(0)
        gone = min((cost, index) for index, cost in enumerate(spare) if index != lobe)[1]
        tried = light.relight(halved(best.lobes, lobe, gone, axis), frame)
        found = newton.minimise(tried, frame, FIRST_STEPS, width_min=width_min)
        if found.value < HOPEFUL * best.value:
            found = newton.minimise(
                found.lobes, frame, STEPS, damping=found.damping, width_min=width_min
            )
        if found.value < (1 - GAIN) * best.value:
            best = found
            order, spare = _order(best.lobes, frame)
    return best


def _order(lobes: Lobes, frame: objective.Target) -> tuple[list[tuple[int, int]], list[float]]:
    """Return the splits to try, lobe and axis, and what each lobe's absence costs."""
    shown = lobe_images.images(lobes, frame.grid)
    error = objective.phi(shown.radiance - frame.radiance, frame.env_corner) - frame.env_corner
    sent = shown.values * lobes.amplitude.sum(-1, keepdim=True)
    taken = sent / sent.sum(0).clamp(min=torch.finfo(torch.float32).tiny)
    own = taken @ (frame.grid.share * error)
    axes = 1 if lobes.form is Form.SG else 2
    worst_first = own.argsort(descending=True).tolist()
    splits = [(lobe, axis) for lobe in worst_first for axis in range(axes)]
    return splits, absence_costs(shown, frame).tolist()


def absence_costs(shown: lobe_images.Images, frame: objective.Target) -> Tensor:
    """Return how much J grows, to second order, when a lobe is taken away.  [N]."""
    hessian, _ = newton.normal_equations(shown, frame)
    count = shown.lobes.count
    diagonal = torch.diagonal(hessian)
    scale = diagonal.clamp(min=1e-12 * float(diagonal.max())).rsqrt()
    scaled = hessian * scale[:, None] * scale + RIDGE * torch.eye(len(scale)).to(hessian)
    inverse = torch.linalg.inv(scaled) * scale[:, None] * scale
    blocks = inverse.reshape(count, UNKNOWNS, count, UNKNOWNS)
    own = torch.stack([blocks[i, 5:, i, 5:] for i in range(count)])  # [N, 3, 3]
    amplitude = shown.lobes.amplitude.double()[..., None]
    return 0.5 * (amplitude.mT @ torch.linalg.solve(own, amplitude)).flatten()


def halved(lobes: Lobes, lobe: int, gone: int, axis: int) -> Lobes:
    """Replace one lobe by two halves side by side, the second in the place of another lobe.

    Args:
        lobes: The lobes.  [N, .]
        lobe: Index of the lobe that is halved.
        gone: Index of the lobe that goes.
        axis: 0 or 1, the axis along which the halves lie.
    """
    axes, sharpness = lobes.axes.clone(), lobes.sharpness.clone()
    amplitude = lobes.amplitude.clone()
    factor = 1.0 if lobes.form is Form.SG else 2.0
    sigma = min(1 / math.sqrt(factor * float(lobes.sharpness[lobe, axis])), 1.0)
    narrower = (lobes.sharpness[lobe, axis] + BROAD) / (1 - OFFSET**2) - BROAD
    for index, side in ((lobe, 1.0), (gone, -1.0)):
        frame = lobes.axes[lobe].clone()
        frame[2] += side * OFFSET * sigma * lobes.axes[lobe, axis]
        axes[index] = orthonormal(frame)
        sharpness[index] = lobes.sharpness[lobe]
        sharpness[index, axis] = narrower
        if lobes.form is Form.SG:
            sharpness[index] = narrower
        amplitude[index] = HALF_LIGHT * lobes.amplitude[lobe]
    return Lobes(axes, sharpness, amplitude, lobes.form)
