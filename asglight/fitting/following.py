# SPDX-License-Identifier: Apache-2.0
"""Every next frame: a few steps from the frame before, the temporal term on.

A lobe keeps its identity: it moves only as the map moves it. A lobe that has gone dark is free, and
goes to where it is needed (sending.py).
"""

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting import light, lobe_images, newton, objective, temporal
from asglight.fitting.coordinates import Leash, pulled_back
from asglight.fitting.first_frame import (
    FrameFit,
    Level,
    exposed,
    fit_first_frame,
    narrowest,
    with_flux_of,
)
from asglight.fitting.objective import Corners
from asglight.fitting.rearranging import rearranged
from asglight.fitting.resending import WORTH, Resent, resent
from asglight.fitting.sending import SENDING, Sending, is_free, lit_where_worth
from asglight.fitting.tracking import claims, drawn, found_again
from asglight.fitting.trials import Effort
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import align, parallel_transport
from asglight.lobes.matching import matched


@dataclass(frozen=True)
class Pursuit:
    """How much is spent on a next frame.

    Attributes:
        coarse: Steps on the grid on which starts compete, a quarter of the cells.
        whole: Steps on the whole map.
        changing: Steps on the whole map where lobes are free, which then may be lit elsewhere and
            have further to go; if empty, those of `whole`.
        sending: What is spent where lobes are free (sending.py), the more the higher the loss that
            a frame starts from. The steps that the others take there stand for the coarse ones.
        anew: Whether a frame is fitted from nothing where rearranging lobes gains too little.
    """

    coarse: tuple[Level, ...]
    whole: tuple[Level, ...]
    changing: tuple[Level, ...] = ()
    sending: tuple[Sending, ...] = (SENDING,)
    anew: bool = True

    def sending_at(self, loss: float) -> Sending | None:
        """Return what is spent on free lobes in a frame that starts from a loss; None if nothing.

        Args:
            loss: J of the lobes of the frame before, moved on and lit.
        """
        return next((each for each in reversed(self.sending) if loss >= each.loss), None)


LIVE = Pursuit(
    coarse=(Level(2, Corners(0.1, 0.005)),),
    whole=(Level(2, Corners(0.1, 0.005)), Level(2, Corners(0.1, 0.002))),
    changing=(Level(4, Corners(0.1, 0.005)), Level(4, Corners(0.1, 0.002))),
    sending=(
        Sending(before=2, trial=Effort(steps=2, companions=2), loss=WORTH),
        Sending(before=4, trial=Effort(steps=3, companions=3), loss=0.12),
    ),
    anew=False,
)
"""Coarse steps bring most of the way, for less; more of them than of the whole map's
lead away from what that asks for. In a tunnel half of r0.5 stands in the four frames in ten whose
lobes start far from the lamps: these get the trials and most of the steps. Of three and three to
six and six there chance decides more than their number."""

FAST = Pursuit((), (Level(4, Corners(0.3, 0.02)), Level(8, Corners(0.1, 0.005))))
"""With six and ten, r0.5 of slow shots is 0 to 2 % smaller for a fifth more time."""

BEST = Pursuit(
    (),
    (
        Level(8, Corners(0.3, 0.02)),
        Level(16, Corners(0.1, 0.01)),
        Level(24, Corners(0.1, 0.002)),
    ),
)

RESTING = (Level(2, Corners(0.1, 0.005)),)
"""Steps of the others where a lobe that the frame can spare goes dark (resending.py)."""

FORETELL_DEG = 20.0
"""A lobe that moved further went dark and was sent elsewhere; that foretells nothing."""

DAMPING_START = 0.05
"""More than a first frame's: the steps are few, and with 1e-3 the first one often fails."""

LEASH_DEG = 9.9
"""From frame to frame a lit lobe turns by less than this: beyond 10 degrees it would be a jump."""

UNLIKE, UNLIKE_LOSS = 4.0, 1 / 3
"""Loss of the lobes as they were, and of the fit, from which a frame is fitted afresh as well.
Where lamps rush through a tunnel the one comes to 4, and under a sun that moves by its widths to
10, but there the other stays low."""

SUSPECT_LOSS = 1.0
"""Loss from which a frame gets the steps of `FAST` on top, and if that is not enough, is fitted
afresh as well: far above that of any of ten real maps, each fitted by itself."""

DOUBT_LOSS = 0.5
"""Loss from which lobes are rearranged: they may jump then. Where lamps rush past, less comes and
goes: with 0.25 `live` would let lobes jump in a tunnel, and with 0.4 `fast` where one lamp passes
overhead."""

CHANGED = 1.2
"""Loss of the lobes as they were, over that of the fit, from which a frame counts as changed: where
lobes are far too few for the map every loss is high, and nothing is in doubt."""

JUMP_GAIN = 2 / 3
"""Share of the loss below which lobes may have jumped for it."""


def fit_next_frame(
    reference: Tensor,
    previous: Lobes,
    earlier: Lobes | None = None,
    effort: Pursuit = FAST,
    threads: int = 1,
) -> FrameFit:
    """Fit a frame that follows another.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        previous: The lobes of the frame before.  [N, .]
        earlier: The lobes of the frame before that, from which the motion is foretold.  [N, .]
        effort: How much is spent.
        threads: Of a fit from nothing, as in `fit_first_frame`.
    """
    frame = exposed(reference)
    if frame.exposure <= 0:
        return FrameFit(_scaled(previous, 0.0), 0.0, 0.0)
    if float(previous.amplitude.max()) <= 0:
        return fit_first_frame(reference, previous.count, previous.form, threads=threads)
    before = _scaled(previous, 1 / _within_reach(frame.exposure, previous))
    free = is_free(before, earlier)
    cosine = torch.where(free, -1.0, math.cos(math.radians(LEASH_DEG)))
    leash = Leash(before.axis_z, cosine.to(before.axis_z))
    whole = objective.target(frame.radiance)
    coarse = objective.trial_target(frame.radiance, effort.whole[0].corners)
    width_min = narrowest(frame.height)
    outcome, unlike = start_of(before, earlier, coarse, leash, width_min)
    worth = effort.sending_at(float(outcome.value))
    sending = worth if bool(free.any()) else None
    levels = effort.changing if sending is not None and effort.changing else effort.whole
    competing = replace(coarse, corners=levels[-1].corners)
    if sending is not None:
        lit = lit_where_worth(outcome, free, competing, leash, width_min, sending)
        outcome = replace(outcome, lobes=lit[None])
    held = temporal.prior(outcome.lobes)
    if sending is None:
        outcome = stepped(outcome, coarse, effort.coarse, held, leash, width_min)
    outcome = replace(outcome, shown=None)  # now on the leaves of the whole map
    outcome = stepped(outcome, whole, levels, held, leash, width_min)
    if float(outcome.value) > SUSPECT_LOSS:
        outcome = stepped(outcome, whole, FAST.whole, held, leash, width_min)
    loss = float(outcome.value)
    changed = unlike > CHANGED * loss
    starts_anew = loss > SUSPECT_LOSS or (loss > UNLIKE_LOSS and unlike > UNLIKE)
    if changed and not starts_anew and loss > DOUBT_LOSS:
        there = _where_light_is(outcome, whole, competing, leash, width_min)
        if there is not None:
            outcome, leash = there
        starts_anew = there is None and effort.anew
    if changed and starts_anew:
        fresh = _anew(reference, previous, threads)
        if fresh.loss < JUMP_GAIN * loss:
            return fresh
    lit = align(light.relit(outcome, whole).lobes[0], before)
    waits = bool((free & temporal.is_dark(lit)).any())  # one is on its way already
    going = None
    if worth is not None and not waits:
        going = resent(lit, before, competing, loss, width_min, worth.trial)
    if going is not None:
        lit = _without(lit, going, whole, leash, width_min)
    return with_flux_of(lit, frame, float(outcome.value))


def _without(
    lobes: Lobes,
    going: Resent,
    frame: objective.Target,
    leash: Leash,
    width_min: float,
) -> Lobes:
    """Return the lobes with one dark and where it goes, the others fitted without it.  [N, .]."""
    rest = torch.tensor([index for index in range(lobes.count) if index != going.index])
    others = lobes.select(rest)[None]
    held = Leash(leash.axis_z[rest], leash.cosine[rest])
    outcome = _afresh(others, frame, RESTING, held, width_min)
    lit = lobes.replaced(rest, light.relit(outcome, frame).lobes[0])
    return lit.replaced(torch.tensor([going.index]), going.lobe)


def _where_light_is(
    outcome: newton.Outcome,
    frame: objective.Target,
    coarse: objective.Target,
    leash: Leash,
    width_min: float,
) -> tuple[newton.Outcome, Leash] | None:
    """Rearrange lobes; return them and what then holds them, or None where that gains too little.

    Args:
        outcome: The lobes after their steps.  F = 1
        frame: The map.
        coarse: The same on few leaves.
        leash: How far each lobe may go that stays.
        width_min: Sigma of the narrowest lobe allowed, radians.
    """
    there = rearranged(outcome.lobes[0], coarse, leash, width_min)
    if there is None:
        return None
    found = _afresh(there.lobes, frame, FAST.whole, there.leash, width_min)
    if float(found.value) > JUMP_GAIN * float(outcome.value):
        return None
    return found, there.leash


def _anew(reference: Tensor, previous: Lobes, threads: int) -> FrameFit:
    """Fit a frame from nothing; lobes that stand for the same lamps keep their places."""
    fresh = fit_first_frame(reference, previous.count, previous.form, threads=threads)
    ordered = matched(fresh.lobes, previous, math.radians(LEASH_DEG))
    return replace(fresh, lobes=align(ordered, previous))


def _afresh(
    lobes: Lobes,
    frame: objective.Target,
    levels: tuple[Level, ...],
    leash: Leash,
    width_min: float,
) -> newton.Outcome:
    """Take the steps of each level from lobes of which some went elsewhere.  [1, N, .]."""
    shown = lobe_images.images(lobes, frame.places)
    start = newton.Outcome(lobes, torch.empty(0), torch.tensor([DAMPING_START]), shown)
    return stepped(start, frame, levels, temporal.prior(lobes), leash, width_min)


def stepped(
    outcome: newton.Outcome,
    frame: objective.Target,
    levels: tuple[Level, ...],
    held: temporal.Prior,
    leash: Leash,
    width_min: float,
) -> newton.Outcome:
    """Take the steps of each level in turn, the temporal term on.

    What the outcome shows, if anything, is on the frame's leaves.
    """
    for level in levels:
        outcome = newton.minimise(
            outcome.lobes,
            replace(frame, corners=level.corners),
            level.steps,
            priors=[held],
            damping=outcome.damping,
            width_min=width_min,
            leash=leash,
            shown=outcome.shown,
        )
    return outcome


def start_of(
    before: Lobes,
    earlier: Lobes | None,
    frame: objective.Target,
    leash: Leash,
    width_min: float,
) -> tuple[newton.Outcome, float]:
    """Return the lobes as they were, or moved on as they moved last, or turned to a lost lamp.

    Each of these competes, and each drawn after the lamps from there.

    Args:
        before: The frame before, in the exposure of this one.  [N, .]
        earlier: The frame before that.  [N, .]
        frame: This frame.
        leash: How far each lobe may go.
        width_min: Sigma of the narrowest lobe allowed, radians.

    Returns:
        The best of these, and the loss of the lobes as they were, with the light that they had.
    """
    places = [before.axis_z]
    if earlier is not None:
        onward = _mirrored(earlier.axis_z, before.axis_z)
        steady = (before.axis_z * earlier.axis_z).sum(-1) > math.cos(math.radians(FORETELL_DEG))
        places.append(torch.where(steady[:, None], onward, before.axis_z))
    still = lobe_images.images(_at(before, leash.hold(torch.stack(places))), frame.places)
    taken = claims(still)
    found = found_again(still.lobes[:1], taken[:1], frame)
    if found is not None:
        seeing = lobe_images.images(pulled_back(found, leash), frame.places)
        still, taken = lobe_images.joined(still, seeing), torch.cat([taken, claims(seeing)])
    count = len(taken)
    after = drawn(still.lobes, taken, frame.repeated(count), width_min)
    onwards = lobe_images.images(pulled_back(after, leash), frame.places)
    radiance = torch.cat([still.radiance, onwards.radiance])
    value = objective.value(radiance, frame.repeated(2 * count))
    still_best, after_best = value.view(2, -1).argmin(-1, keepdim=True)
    pair = lobe_images.joined(still[still_best], onwards[after_best])
    lit = light.relight(pair, frame.repeated(2))
    as_it_was = float(value[0])
    value = objective.value(lit.radiance, frame.repeated(2))
    damping = torch.full_like(value, DAMPING_START)
    return newton.Outcome(lit.lobes, value, damping, lit).best(), as_it_was


def _at(lobes: Lobes, axis_z: Tensor) -> Lobes:
    """Turn lobes the shortest way.  axis_z: [..., N, 3]; result [..., N, .]."""
    batch = axis_z.shape[:-2]
    return Lobes(
        parallel_transport(lobes.axes.expand(*batch, *lobes.axes.shape), axis_z),
        lobes.sharpness.expand(*batch, *lobes.sharpness.shape),
        lobes.amplitude.expand(*batch, *lobes.amplitude.shape),
        lobes.form,
    )


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
