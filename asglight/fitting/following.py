# SPDX-License-Identifier: Apache-2.0
"""Every next frame of the `fast` preset: a few steps from the frame before, the temporal term on.

A lobe keeps its identity: it moves only as the map moves it. A lobe that has gone dark is free, and
is sent to where the map has most light that the fit lacks.
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, temporal
from asglight.fitting.coordinates import Leash
from asglight.fitting.first_frame import (
    LIGHT,
    FrameFit,
    Level,
    fit_first_frame,
    levels_for,
    mean_radiance,
    narrowest,
    with_flux_of,
)
from asglight.fitting.objective import Corners
from asglight.fitting.probes import PROBES, directions, probe, probe_rows
from asglight.fitting.tracking import find_moved_lamps
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import align, axes_around, parallel_transport
from asglight.sphere import latlong

FAST = (
    Level(64, 6, Corners(0.3, 0.02)),
    Level(128, 5, Corners(0.1, 0.01)),
    Level(256, 2, Corners(0.1, 0.005)),
)
"""The levels of a next frame."""

BEST = (
    Level(64, 8, Corners(0.3, 0.02)),
    Level(128, 12, Corners(0.1, 0.01)),
    Level(256, 12, Corners(0.05, 0.005)),
)

FORETELL_ROWS = 32
"""Rows of the grid on which the foretold motion is tried."""

FORETELL_DEG = 20.0
"""A lobe that moved further went dark and was sent elsewhere; that foretells nothing."""

DAMPING_START = 1e-3

LEASH_DEG = 9.9
"""From frame to frame a lit lobe turns by less than this: beyond 10 degrees it would be a jump."""

LACKING_SHARE = 5e-3
"""Filtered radiance lacking at a place, over the largest there is, that is worth a free lobe."""

SUSPECT_LOSS = 1.0
"""Loss from which a frame is fitted afresh as well: twice that of the hardest of ten real maps."""

CUT_GAIN = 0.5
"""A fresh fit with less than this share of the loss means a cut: the lobes start anew."""

FREE_LOBE_SHARPNESS = 60.0
"""Width of a lobe newly sent: sigma = 5 degrees, about the probe that found the place."""


def fit_next_frame(
    reference: Tensor,
    previous: Lobes,
    earlier: Lobes | None = None,
    levels: tuple[Level, ...] = FAST,
) -> FrameFit:
    """Fit a frame that follows another.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        previous: The lobes of the frame before.  [N, .]
        earlier: The lobes of the frame before that, from which the motion is foretold.  [N, .]
        levels: From coarse to fine.
    """
    exposure = mean_radiance(reference)
    if exposure <= 0:
        return FrameFit(_scaled(previous, 0.0), 0.0, 0.0)
    if float(previous.amplitude.max()) <= 0:
        return fit_first_frame(reference, previous.count, previous.form)
    scaled = reference / exposure
    before = _scaled(previous, 1 / _within_reach(exposure, previous))
    height = reference.shape[0]
    start = _foretold(before, earlier, scaled)
    lobes, leash = _send_free_lobes(find_moved_lamps(start, scaled), scaled, before, earlier)
    held, loss = temporal.prior(lobes), math.inf
    for level in levels_for(levels, height):
        frame = objective.target(latlong.reduce(scaled, level.rows, 2 * level.rows), level.corners)
        outcome = newton.minimise(
            light.relight(lobes, frame) if math.isinf(loss) else lobes,
            frame,
            level.steps,
            priors=[held],
            damping=DAMPING_START,
            width_min=narrowest(height),
            leash=leash,
        )
        lobes, loss = outcome.lobes, outcome.value
    if loss > SUSPECT_LOSS:
        fresh = fit_first_frame(reference, previous.count, previous.form)
        if fresh.loss < CUT_GAIN * loss:
            return fresh
    lobes = light.relight(align(lobes, before), objective.target(scaled, LIGHT), passes=1)
    return with_flux_of(lobes, scaled, exposure, loss)


def _foretold(before: Lobes, earlier: Lobes | None, scaled: Tensor) -> Lobes:
    """Return the lobes as they were, or moved on as they moved last, whichever fits better.

    Args:
        before: The frame before, in the exposure of this one.  [N, .]
        earlier: The frame before that.  [N, .]
        scaled: This frame.  [H, 2 H, 3]
    """
    if earlier is None:
        return before
    rows = min(FORETELL_ROWS, scaled.shape[0])
    frame = objective.target(latlong.reduce(scaled, rows, 2 * rows), FAST[0].corners)
    onward = _mirrored(earlier.axis_z, before.axis_z)
    steady = (before.axis_z * earlier.axis_z).sum(-1) > math.cos(math.radians(FORETELL_DEG))
    onward = torch.where(steady[:, None], onward, before.axis_z)
    moved = parallel_transport(before.axes, onward)
    candidates = (before, replace(before, axes=moved))
    lit = [light.relight(candidate, frame, passes=1) for candidate in candidates]
    values = [
        float(objective.value(lobe_images.images(one, frame.grid).radiance, frame)) for one in lit
    ]
    return candidates[values[1] < values[0]]


def _mirrored(direction: Tensor, about: Tensor) -> Tensor:
    """Return a direction as far beyond another as it was before it.  [N, 3]."""
    return 2 * (direction * about).sum(-1, keepdim=True) * about - direction


def _within_reach(exposure: float, previous: Lobes) -> float:
    """Return the unit of the frame's radiance for the lobes before it.

    After a jump of more than ten stops they are taken in units of their own flux instead: they say
    where the light was, not how much, and float32 squares stay finite.
    """
    own = float(asg.flux(previous).sum()) / (12 * math.pi)
    return exposure if 2**-10 < own / exposure < 2**10 else own


def _scaled(lobes: Lobes, factor: float) -> Lobes:
    return Lobes(lobes.axes, lobes.sharpness, lobes.amplitude * factor, lobes.form)


def _send_free_lobes(
    lobes: Lobes, scaled: Tensor, before: Lobes, earlier: Lobes | None
) -> tuple[Lobes, Leash]:
    """Send each free lobe to the place where the sharpest probe lacks most light.

    A lobe is free when it was dark in both frames before, so that it can move while it is dark. All
    others are held within reach of where they were.
    """
    dark = (
        temporal.is_dark(before)
        if earlier is None
        else temporal.is_dark(before) & temporal.is_dark(earlier)
    )
    reach = torch.where(dark, -1.0, math.cos(math.radians(LEASH_DEG)))
    leash = Leash(before.axis_z, reach)
    held = parallel_transport(lobes.axes, leash.hold(lobes.axis_z))
    lobes = replace(lobes, axes=held)
    free = torch.nonzero(dark).flatten().tolist()
    if not free:
        return lobes, leash
    sharpest = PROBES[-1]
    rows = min(sharpest.height, scaled.shape[0])
    frame = objective.target(latlong.reduce(scaled, rows, 2 * rows))
    brightest = float(probe(frame.radiance, rows)[-1].sum(0).max())
    places = directions(sharpest, probe_rows(sharpest, rows)).to(scaled)
    axes, sharpness, amplitude = (
        lobes.axes.clone(),
        lobes.sharpness.clone(),
        lobes.amplitude.clone(),
    )
    for index in free:
        current = Lobes(axes, sharpness, amplitude, lobes.form)
        shown = lobe_images.images(current, frame.grid).radiance
        lacking = probe(frame.radiance - shown, rows)[-1].mT  # [D, 3]
        place = int(lacking.sum(-1).argmax())
        if float(lacking[place].sum()) < LACKING_SHARE * brightest:
            break
        axes[index] = axes_around(places[place])
        sharpness[index] = FREE_LOBE_SHARPNESS
        amplitude[index] = lacking[place].clamp(min=0)
    return Lobes(axes, sharpness, amplitude, lobes.form), leash
