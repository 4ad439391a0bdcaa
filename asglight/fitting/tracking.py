# SPDX-License-Identifier: Apache-2.0
"""Finding lamps that moved further than their own width.

A gradient sees no lamp beyond the lobe's own reach: a sun of one texel that has moved by two is
gone from it. Before the steps of a next frame each narrow lobe therefore looks at what the others
leave of the map around it, and goes to the mean of that flux under a window that narrows: mean
shift [Comaniciu and Meer 2002]. It goes only if that lowers the loss.
"""

import math

import torch
from torch import Tensor

from asglight.fitting import objective
from asglight.lobes import Lobes, asg, texels
from asglight.lobes.frames import parallel_transport
from asglight.sphere import latlong

WINDOWS_DEG = (5.0, 4.0, 3.0, 2.0)
"""Sigma of the window, one mean shift each, wide enough to see a lamp `REACH_DEG` away."""

REACH_DEG = 9.0
"""A lamp further away than this is another lamp: beyond 10 degrees a lit lobe's way is a jump."""

NARROW_DEG = 5.0
"""Sigma of a lobe up to which it is looked for; a broader one overlaps its next place."""

LIT_SHARE = 1e-3
"""Share of the flux from which a lobe is worth looking for."""


def find_moved_lamps(lobes: Lobes, scaled: Tensor) -> Lobes:
    """Send narrow lobes to where their lamps went.

    Args:
        lobes: The lobes of the frame before, in the exposure of this one.  [N, .]
        scaled: This frame.  [H, 2 H, 3]
    """
    flux = asg.flux(lobes).sum(-1)
    narrow = texels.lobe_width(lobes) < math.radians(NARROW_DEG)
    candidates = torch.nonzero(narrow & (flux > LIT_SHARE * flux.sum())).flatten().tolist()
    if not candidates:
        return lobes
    candidates.sort(key=lambda index: -float(flux[index]))
    height, width, _ = scaled.shape
    frame = objective.target(scaled)
    power = latlong.texel_solid_angles(height, width, device=scaled.device).reshape(-1, 1)
    values = texels.unit_texel_means(lobes, height, width)  # [N, P]
    radiance = values.mT @ lobes.amplitude
    loss = objective.value(radiance, frame)
    for index in candidates:
        own = values[index][:, None] * lobes.amplitude[index]
        left = (power * (frame.radiance - radiance + own).clamp(min=0)).sum(-1)
        place = _mean_shift(lobes.axis_z[index], left, frame.directions)
        if float(place @ lobes.axis_z[index]) < math.cos(math.radians(REACH_DEG)):
            continue
        moved = _turned_to(lobes, index, place)
        lobe = moved.select(torch.tensor([index], device=scaled.device))
        value = texels.unit_texel_means(lobe, height, width)[0]
        changed = radiance - own + value[:, None] * lobes.amplitude[index]
        reached = objective.value(changed, frame)
        if reached < loss:
            lobes, radiance, loss = moved, changed, reached
            values[index] = value
    return lobes


def _mean_shift(place: Tensor, flux: Tensor, directions: Tensor) -> Tensor:
    """Move a direction to the flux-weighted mean around it, under narrowing windows."""
    for sigma in WINDOWS_DEG:
        cosine = directions @ place
        window = torch.exp((cosine - 1) / math.radians(sigma) ** 2)
        mean = (flux * window) @ directions
        if float(mean.norm()) > 0:
            place = torch.nn.functional.normalize(mean, dim=0)
    return place


def _turned_to(lobes: Lobes, index: int, axis_z: Tensor) -> Lobes:
    """Tilt one lobe to a new axis_z, its frame turned the shortest way."""
    axes = lobes.axes.clone()
    axes[index] = parallel_transport(axes[index], axis_z)
    return Lobes(axes, lobes.sharpness, lobes.amplitude, lobes.form)
