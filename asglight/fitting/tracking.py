# SPDX-License-Identifier: Apache-2.0
"""Finding lamps that moved further than their own width, or that grew narrow.

A gradient sees no lamp beyond the lobe's own reach: a sun of one texel that has moved by two is
gone from it. And a lobe that has spread over a sun finds no slope back: the map's L1 error stays
about twice the flux until the lobe is nearly as narrow as the sun. Before the steps of a next frame
each narrow lobe therefore looks at what the others leave of the map around it. It goes to the mean
of that flux under a window that narrows (mean shift [Comaniciu and Meer 2002]), and may take the
width and the light that it finds there. It does so only if that lowers the loss.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting import lobe_images, objective
from asglight.fitting.seeding import WIDTH_MIN_TEXELS
from asglight.lobes import Form, Lobes, asg, texels
from asglight.lobes.frames import parallel_transport
from asglight.sphere import latlong

WINDOWS_DEG = (5.0, 4.0, 3.0, 2.0)
"""Sigma of the window, one mean shift each, wide enough to see a lamp `REACH_DEG` away."""

REACH_DEG = 9.0
"""A lamp further away than this is another lamp: beyond 10 degrees a lit lobe's way is a jump."""

NARROW_DEG = 9.0
"""Sigma of a lobe up to which it is looked for; a broader one overlaps its next place."""

WORTH_WIDTHS, WORTH_FACTOR = 0.25, 1.5
"""A lamp nearer than that to its lobe, and no narrower than that, is within reach of a step."""

LIT_SHARE = 1e-3
"""Share of the flux from which a lobe is worth looking for."""

ROWS_MAX = 128
"""Rows of the grid on which lamps are looked for: a texel of 1.4 degrees."""


@dataclass
class _Search:
    """One frame and the lobes found so far, with their images."""

    frame: objective.Target
    lobes: Lobes
    values: Tensor  # unit texel means  [N, P]
    radiance: Tensor  # [3, P]
    loss: float

    def offer(self, index: int, lobes: Lobes) -> None:
        """Take a changed lobe if the loss falls."""
        lobe = lobes.select(torch.tensor([index], device=lobes.axes.device))
        value = lobe_images.images(lobe, self.frame.grid).values[0]
        own = self.lobes.amplitude[index][:, None] * self.values[index]
        radiance = self.radiance - own + lobes.amplitude[index][:, None] * value
        loss = float(objective.value(radiance, self.frame))
        if loss < self.loss:
            self.lobes, self.radiance, self.loss = lobes, radiance, loss
            self.values[index] = value

    def left_for(self, index: int) -> Tensor:
        """Return the flux that the other lobes leave in each texel, over 4 pi.  [3, P]."""
        own = self.lobes.amplitude[index][:, None] * self.values[index]
        left = (self.frame.radiance - self.radiance + own).clamp(min=0)
        return self.frame.grid.share * left


def find_moved_lamps(lobes: Lobes, scaled: Tensor) -> Lobes:
    """Send narrow lobes to where their lamps went.

    Args:
        lobes: The lobes of the frame before, in the exposure of this one.  [N, .]
        scaled: This frame.  [H, 2 H, 3]
    """
    flux = asg.flux(lobes).sum(-1)
    narrow = texels.lobe_width(lobes) < math.radians(NARROW_DEG)
    candidates = torch.nonzero(narrow & (flux > LIT_SHARE * flux.sum())).flatten().tolist()
    candidates.sort(key=lambda index: -float(flux[index]))
    if not candidates:
        return lobes
    search = _search(lobes, scaled)
    for index in candidates:
        left = search.left_for(index)
        place = _mean_shift(lobes.axis_z[index], left.sum(0), search.frame.grid.directions)
        if float(place @ lobes.axis_z[index]) < math.cos(math.radians(REACH_DEG)):
            continue
        found = _as_found(search.lobes, index, place, left, search.frame)
        own = search.lobes.select(torch.tensor([index]))
        moved = math.acos(min(1.0, float(place @ lobes.axis_z[index])))
        narrower = float(found.sharpness[index, 0] / own.sharpness.amax())
        if moved > WORTH_WIDTHS * float(texels.lobe_width(own)):
            search.offer(index, _turned_to(search.lobes, index, place))
        elif narrower < WORTH_FACTOR:
            continue
        search.offer(index, found)
    return search.lobes


def _search(lobes: Lobes, scaled: Tensor) -> _Search:
    rows = min(ROWS_MAX, scaled.shape[0])
    frame = objective.target(latlong.reduce(scaled, rows, 2 * rows))
    shown = lobe_images.images(lobes, frame.grid)
    loss = float(objective.value(shown.radiance, frame))
    return _Search(frame, lobes, shown.values, shown.radiance, loss)


def _window(place: Tensor, directions: Tensor, sigma_deg: float) -> Tensor:
    return torch.exp((directions @ place - 1) / math.radians(sigma_deg) ** 2)


def _mean_shift(place: Tensor, flux: Tensor, directions: Tensor) -> Tensor:
    """Move a direction to the flux-weighted mean around it, under narrowing windows."""
    for sigma in WINDOWS_DEG:
        mean = (flux * _window(place, directions, sigma)) @ directions
        if float(mean.norm()) > 0:
            place = torch.nn.functional.normalize(mean, dim=0)
    return place


def _turned_to(lobes: Lobes, index: int, axis_z: Tensor) -> Lobes:
    """Tilt one lobe to a new axis_z, its frame turned the shortest way."""
    axes = lobes.axes.clone()
    axes[index] = parallel_transport(axes[index], axis_z)
    return Lobes(axes, lobes.sharpness, lobes.amplitude, lobes.form)


def _as_found(
    lobes: Lobes, index: int, place: Tensor, left: Tensor, frame: objective.Target
) -> Lobes:
    """Give one lobe the place, the width and the light of the flux under the last window.

    Under a Gaussian window of variance w a Gaussian of variance v shows the variance
    1 / (1 / v + 1 / w), which is solved for v.
    """
    window = WINDOWS_DEG[-1]
    directions = frame.grid.directions
    seen = left * _window(place, directions, window)  # [3, P]
    across = (1 - (directions @ place).square()) / 2  # x^2, averaged over the azimuth
    total = seen.sum().clamp(min=1e-30)
    shown = float((seen.sum(0) * across).sum() / total)
    own = max(1 / shown - 1 / math.radians(window) ** 2, 1.0) if shown > 0 else math.inf
    least = (WIDTH_MIN_TEXELS * math.pi / frame.height) ** 2
    sharpness = lobes.sharpness.clone()
    sharpness[index] = min(own, 1 / least) * (1.0 if lobes.form is Form.SG else 0.5)
    moved = _turned_to(Lobes(lobes.axes, sharpness, lobes.amplitude, lobes.form), index, place)
    amplitude = lobes.amplitude.clone()
    amplitude[index] = 4 * math.pi * seen.sum(1) / asg.integral(moved)[index]
    return Lobes(moved.axes, sharpness, amplitude, lobes.form)
