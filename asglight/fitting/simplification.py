# SPDX-License-Identifier: Apache-2.0
"""What a shot's lobes can do without: lobes, second sharpnesses, motion that nobody sees.

Three simplifications, each for a lobe in all frames of the shot:

    unneeded   the lobe is taken away
    round      it becomes isotropic, its flux as it was
    static     it has the same values in every frame

What one changes is measured on what the fit's probes show of the lobes (probes.py: mean radiance,
Lambert, GGX 0.5 and 0.25): mean |change| / mean |view| over RGB and directions, for each probe in
each frame. The changes of single lobes add up to no less than the change of all together, so a sum
below the budget keeps the whole below it. No map is needed.

The flux that a simplification takes from a frame goes to the lobes that still change, channel by
channel, so each change counts with that of the flux added to it.

Dimension letters: F frames, N lobes, K probes, D views of a probe.
"""

import math
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from asglight.fitting.loss import lobe_images
from asglight.fitting.loss.adaptive_cells import BASE_ROWS
from asglight.fitting.loss.coordinates import BROAD
from asglight.fitting.loss.measures import even_cells
from asglight.fitting.loss.probes import PROBES, probe, shares, split
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.data import chosen
from asglight.lobes.frames import orthonormal, transported
from asglight.threads import side_by_side

BUDGET = 1e-3
"""Change of a frame by all simplifications together, on each probe. On ten maps and three sequences
fitted with 15 lobes, whose r0.5 is 0.003 to 0.018, it raises no frame's irr or r0.5 by more than
2e-5; a budget of 1e-2 raises them by up to 2e-3."""

FLUX_TOLERANCE = 1e-4
"""By which the flux of a frame may change: a tenth of the budget, for the sum of light is what a
render shows first."""

TAKEN_MAX = 2.0
"""Factor, up or down, on the light of the lobes that take over flux: where they hold so little that
it would be more, the flux is not theirs to mend."""

STRIDES = (64, 8, 1)
"""Frames from one to the next that is looked at: most lobes fail in the first hundredth of a shot
that is long, and those that do not cost no more."""

CHUNK = 8
"""Frames side by side: 8 x 15 lobes on 64 x 128 cells are 4 MB."""


def leave_out(lobes: Lobes, budget: Tensor, threads: int = 1) -> Lobes:
    """Return the lobes of a shot that it needs, as simple as they may be.  [F, N', .].

    Args:
        lobes: Continuous in time (lobes.frames.continuous).  [F, N, .]
        budget: Largest change of each frame, on each probe.  [F]
        threads: How many chunks of frames are looked at side by side; the result does not depend
            on it.
    """
    flux = asg.flux(lobes.to(torch.float64)).sum(1)  # [F, 3]
    left = budget[:, None].to(torch.float64)  # [F, K]
    black = replace(lobes, amplitude=torch.zeros_like(lobes.amplitude))
    unneeded, left = _simplified(lobes, black, left, flux, threads, taken_by_all=True)
    needed = ~unneeded
    if not bool(needed.any()):  # a black shot
        needed[0] = True
    result = with_flux(lobes.select(needed), flux, torch.ones(int(needed.sum()), dtype=torch.bool))
    if lobes.form is not Form.SG:
        rounded = rounded_off(result)
        is_round, left = _simplified(result, rounded, left, flux, threads, taken_by_all=True)
        if bool(is_round.any()):
            rounded = replace(rounded, axes=transported(rounded.axes))
            result = chosen(is_round[None], rounded, result)
    held = held_still(result)
    static, _ = _simplified(result, held, left, flux, threads, taken_by_all=False)
    return with_flux(chosen(static[None], held, result), flux, ~static)


def changes(before: Lobes, after: Lobes, whole: Tensor, threads: int = 1) -> Tensor:
    """Return how much of what the probes show changes where one lobe is replaced by another.

    Args:
        before: Some lobes of a shot.  [F, N, .]
        after: What stands for each of them.  [F, N, .]
        whole: Flux of each frame, RGB summed. Every probe's mean is this over 4 pi.  [F]
        threads: As of `leave_out`.

    Returns:
        For each lobe by itself, mean |change| over the mean of what the frame shows.  [F, N, K]
    """
    chunks = [slice(first, first + CHUNK) for first in range(0, len(before.axes), CHUNK)]
    calls = [partial(_changes, before[one], after[one], whole[one]) for one in chunks]
    return torch.cat(list(side_by_side(calls, threads))).to(torch.float64)


def _changes(before: Lobes, after: Lobes, whole: Tensor) -> Tensor:
    """Return `changes` of a few frames, in float32."""
    unit = (whole / (4 * math.pi)).clamp(min=1e-37)[:, None, None]
    light, changed = ((lobes.amplitude / unit)[..., None].float() for lobes in (before, after))
    change = light * _views(before)[:, :, None]
    if bool(changed.any()):
        change -= changed * _views(after)[:, :, None]
    change = change.abs().sum(2) * shares(BASE_ROWS, str(light.device))
    return torch.stack([each.sum(-1) for each in split(change, BASE_ROWS)], dim=-1)


def _views(lobes: Lobes) -> Tensor:
    """Return what the probes show of each lobe of amplitude 1.  [F, N, D].

    The images have the lobes' exact integrals: changes far below a percent are asked for, by which
    a sum over cells may err.
    """
    cells = even_cells(BASE_ROWS, str(lobes.axes.device))
    values = lobe_images.images(lobes, cells).values
    found = 4 * math.pi * (values @ cells.share[..., None])
    return probe(values * (asg.integral(lobes)[..., None] / found), BASE_ROWS)


def rounded_off(lobes: Lobes) -> Lobes:
    """Return isotropic lobes of the same flux and, nearly, the same mean square of the width.

    1 / (s + 1/2) is the mean of that of both axes: the square of the width of a narrow lobe, and
    bounded for a broad one.  [..., N, .]
    """
    shifted = 2 / (1 / (lobes.sharpness.double() + BROAD)).sum(-1, keepdim=True)
    sharpness = (shifted - BROAD).clamp(min=asg.SHARPNESS_MIN).expand_as(lobes.sharpness)
    one = replace(lobes.to(torch.float64), sharpness=sharpness)
    factor = asg.integral(lobes.to(torch.float64)) / asg.integral(one)
    amplitude = one.amplitude * factor[..., None]
    same = lobes.sharpness[..., :1] == lobes.sharpness[..., 1:]
    return replace(
        lobes,
        sharpness=torch.where(same, lobes.sharpness, sharpness.to(lobes.sharpness)),
        amplitude=torch.where(same, lobes.amplitude, amplitude.to(lobes.amplitude)),
    )


def held_still(lobes: Lobes) -> Lobes:
    """Return lobes that keep their mean direction, width and flux in every frame.

    Directions and widths are weighted by the lobe's flux.  [F, N, .]
    """
    exact = lobes.to(torch.float64)
    flux = asg.flux(exact)  # [F, N, 3]
    weight = flux.sum(-1)
    weight = torch.where(weight.sum(0) > 0, weight, torch.ones_like(weight))
    weight = weight / weight.sum(0)  # [F, N]
    axes = orthonormal((weight[..., None, None] * exact.axes).sum(0))
    sharpness = (weight[..., None] * (exact.sharpness + BROAD).log()).sum(0).exp() - BROAD
    one = replace(exact[0], axes=axes, sharpness=sharpness.clamp(min=asg.SHARPNESS_MIN))
    amplitude = flux.mean(0) / asg.integral(one)[..., None]
    still = replace(one, amplitude=amplitude).to(lobes.axes)
    return Lobes(
        still.axes.expand_as(lobes.axes),
        still.sharpness.expand_as(lobes.sharpness),
        still.amplitude.expand_as(lobes.amplitude),
        lobes.form,
    )


def with_flux(lobes: Lobes, flux: Tensor, takes: Tensor) -> Lobes:
    """Let some lobes take over what a shot lacks of its flux, frame by frame, channel by channel.

    Args:
        lobes: A shot.  [F, N, .]
        flux: What each frame should have.  [F, 3]
        takes: Which lobes may change their light, by `TAKEN_MAX` at most.  [N]
    """
    own = asg.flux(lobes.to(torch.float64))
    theirs = own[:, takes].sum(1)  # [F, 3]
    wanted = flux - own[:, ~takes].sum(1)
    factor = torch.where(theirs > 0, wanted / theirs.clamp(min=1e-300), 1.0)
    factor = factor.clamp(1 / TAKEN_MAX, TAKEN_MAX)[:, None]
    amplitude = (lobes.amplitude.double() * factor).to(lobes.amplitude)
    return replace(lobes, amplitude=torch.where(takes[:, None], amplitude, lobes.amplitude))


def flux_change(lobes: Lobes, flux: Tensor) -> float:
    """Return the largest difference of a frame's flux from what it was, summed over RGB, of it.

    Args:
        lobes: A shot.  [F, N, .]
        flux: What each frame had.  [F, 3]
    """
    found = asg.flux(lobes.to(torch.float64)).sum(1)
    return float(((found - flux).abs().sum(-1) / flux.sum(-1).clamp(min=1e-300)).max())


def _simplified(
    lobes: Lobes,
    simpler: Lobes,
    left: Tensor,
    flux: Tensor,
    threads: int,
    *,
    taken_by_all: bool,
) -> tuple[Tensor, Tensor]:
    """Choose the lobes that a budget lets become simpler, the cheapest first.

    A choice that the other lobes cannot keep the flux for, as where all of a flickering shot would
    be static or all light be taken away, gives back its dearest lobes one by one.

    Args:
        lobes: As they are.  [F, N, .]
        simpler: As they would be.  [F, N, .]
        left: Budget of each frame and probe.  [F, K] or [F, 1]
        flux: What each frame should have.  [F, 3]
        threads: As of `leave_out`.
        taken_by_all: The flux goes to every lobe; else to those that do not become simpler.

    Returns:
        Which become simpler [N], and the budget left for others [F, K].
    """
    affordable, cost = _affordable(lobes, simpler, left, flux.sum(-1), threads)
    while affordable:
        marked = torch.zeros(lobes.count, dtype=torch.bool)
        marked[affordable] = True
        takes = torch.ones_like(marked) if taken_by_all else ~marked
        tried = with_flux(chosen(marked[None], simpler, lobes), flux, takes)
        if flux_change(tried, flux) <= FLUX_TOLERANCE:
            return marked, left - cost[:, affordable].sum(1)
        affordable.pop()
    return torch.zeros(lobes.count, dtype=torch.bool), left


def _affordable(
    lobes: Lobes, simpler: Lobes, left: Tensor, whole: Tensor, threads: int
) -> tuple[list[int], Tensor]:
    """Return the lobes whose costs together stay within the budget, cheapest first, and all costs.

    Lobes that change too much flux, or too much of a frame, are not looked at any further: their
    cost is infinite.
    """
    lost = asg.flux(lobes.to(torch.float64)) - asg.flux(simpler.to(torch.float64))
    taken = lost.abs().sum(-1) / whole.clamp(min=1e-300)[:, None]  # [F, N]
    cost = torch.full((*taken.shape, len(PROBES)), torch.inf, dtype=torch.float64)
    near = torch.nonzero((taken <= left.amin(-1, keepdim=True)).all(0)).flatten()
    for part in _ever_closer(len(whole)):
        if len(near) and len(part):
            own, other = lobes[part].select(near), simpler[part].select(near)
            found = changes(own, other, whole[part], threads)
            cost[part[:, None], near] = found + taken[part][:, near, None]
            near = near[(cost[part][:, near] <= left[part, None]).all(-1).all(0)]
    affordable: list[int] = []
    for index in cost.amax((0, 2)).argsort(stable=True).tolist():
        if bool((cost[:, [*affordable, index]].sum(1) <= left).all()):
            affordable.append(index)
    return affordable, cost


def _ever_closer(count: int) -> list[Tensor]:
    """Return the numbers of so many frames in parts: the first, then ever more between them.

    What one frame does not bear no shot does, and frames far apart tell it soonest.
    """
    every = torch.arange(count)
    seen = torch.zeros(count, dtype=torch.bool)
    parts = []
    for stride in (count, *STRIDES):
        mine = every % stride == 0
        parts.append(every[mine & ~seen])
        seen |= mine
    return parts
