# SPDX-License-Identifier: Apache-2.0
"""Every next frame of the `fast` preset: a few steps from the frame before, the temporal term on.

A lobe keeps its identity: it moves only as the map moves it. A lobe that has gone dark is free, and
is sent to where the map has most light that the fit lacks.
"""

import math

import torch
from torch import Tensor

from asglight.fitting import newton, objective, temporal
from asglight.fitting.first_frame import (
    FrameFit,
    fit_first_frame,
    mean_radiance,
    narrowest,
    with_flux_of,
)
from asglight.fitting.tracking import find_moved_lamps
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import align, axes_around
from asglight.sphere import latlong
from asglight.sphere.quadrature import fibonacci_directions

LEVELS = ((64, 4), (128, 4), (256, 2))
"""Rows and steps. A map with fewer rows than a level is followed on its own rows."""

DAMPING_START = 1e-3

DARK_SHARE = 1e-4
"""Share of the flux below which a lobe counts as dark: nobody sees it move."""

LACKING_SHARE = 5e-3
"""Filtered radiance lacking at a place, over the largest there is, that is worth a free lobe."""

SUSPECT_LOSS = 1.0
"""Loss from which a frame is fitted afresh as well: twice that of the hardest of ten real maps."""

CUT_GAIN = 0.5
"""A fresh fit with less than this share of the loss means a cut: the lobes start anew."""

FREE_LOBE_SHARPNESS = 60.0
"""Width of a lobe newly sent: sigma = 5 degrees, about the probe that found the place."""


def fit_next_frame(reference: Tensor, previous: Lobes) -> FrameFit:
    """Fit a frame that follows another.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        previous: The lobes of the frame before.  [N, .]
    """
    exposure = mean_radiance(reference)
    if exposure <= 0:
        return FrameFit(_scaled(previous, 0.0), 0.0, 0.0)
    if float(previous.amplitude.max()) <= 0:
        return fit_first_frame(reference, previous.count, previous.form)
    scaled = reference / exposure
    before = _scaled(previous, 1 / _within_reach(exposure, previous))
    height = reference.shape[0]
    lobes, loss = _send_free_lobes(find_moved_lamps(before, scaled), scaled), 0.0
    held = temporal.prior(lobes)
    for rows, steps in _levels(height):
        frame = objective.target(latlong.reduce(scaled, rows, 2 * rows))
        outcome = newton.minimise(
            newton.relight(lobes, frame),
            frame,
            steps,
            prior=held,
            damping=DAMPING_START,
            width_min=narrowest(height),
        )
        lobes, loss = outcome.lobes, outcome.value
    if loss > SUSPECT_LOSS:
        fresh = fit_first_frame(reference, previous.count, previous.form)
        if fresh.loss < CUT_GAIN * loss:
            return fresh
    return with_flux_of(align(lobes, before), scaled, exposure, loss)


def _within_reach(exposure: float, previous: Lobes) -> float:
    """Return the unit of the frame's radiance for the lobes before it.

    After a jump of more than ten stops they are taken in units of their own flux instead: they say
    where the light was, not how much, and float32 squares stay finite.
    """
    own = float(asg.flux(previous).sum()) / (12 * math.pi)
    return exposure if 2**-10 < own / exposure < 2**10 else own


def _levels(height: int) -> list[tuple[int, int]]:
    coarser = [level for level in LEVELS if level[0] < height]
    return coarser if len(coarser) == len(LEVELS) else [*coarser, (height, LEVELS[len(coarser)][1])]


def _scaled(lobes: Lobes, factor: float) -> Lobes:
    return Lobes(lobes.axes, lobes.sharpness, lobes.amplitude * factor, lobes.form)


def _send_free_lobes(lobes: Lobes, scaled: Tensor) -> Lobes:
    """Send each dark lobe to the place where the sharpest probe lacks most light."""
    flux = asg.flux(lobes).sum(-1)
    free = torch.nonzero(flux < DARK_SHARE * flux.sum()).flatten().tolist()
    if not free:
        return lobes
    sharpest = len(objective.PROBES) - 1
    rows = min(objective.PROBES[sharpest].height, scaled.shape[0])
    frame = objective.target(latlong.reduce(scaled, rows, 2 * rows))
    places = fibonacci_directions(objective.PROBES[sharpest].directions).to(scaled)
    axes, sharpness, amplitude = (
        lobes.axes.clone(),
        lobes.sharpness.clone(),
        lobes.amplitude.clone(),
    )
    for index in free:
        current = Lobes(axes, sharpness, amplitude, lobes.form)
        shown = objective.probe(newton.texel_radiance(current, frame).mT, rows)[sharpest].mT
        lacking = frame.probed[sharpest] - shown  # [D, 3]
        place = int(lacking.sum(-1).argmax())
        if float(lacking[place].sum()) < LACKING_SHARE * float(
            frame.probed[sharpest].sum(-1).max()
        ):
            break
        axes[index] = axes_around(places[place])
        sharpness[index] = FREE_LOBE_SHARPNESS
        amplitude[index] = lacking[place].clamp(min=0)
    return Lobes(axes, sharpness, amplitude, lobes.form)
