# SPDX-License-Identifier: Apache-2.0
"""Every next frame: predict, pull in, step, relocate.

Lobes are carried on as they moved, pulled to the lamps that they meet (pull_in.py), and take
steps with the temporal term. A lobe may turn as far as its lamp does. Where one is needed
elsewhere more than where it is, it is relocated (relocation.py). Which lobe is which light is said
in the end, by what they look like (slots.py).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.first_frame.fit import (
    FirstFrameSettings,
    FrameFit,
    Level,
    exposed,
    fit_first_frame,
    narrowest,
    with_flux_of,
)
from asglight.fitting.following import slots
from asglight.fitting.following.initial_guess import DAMPING_START, initial_guess
from asglight.fitting.following.lost import is_lost
from asglight.fitting.following.relocation import COST as RELOCATION_COST
from asglight.fitting.following.relocation import Relocation, relocated
from asglight.fitting.following.returning import lit_again
from asglight.fitting.following.trials import TrialSettings
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.objective import Corners
from asglight.fitting.options import TRACKS_PER_LOBE
from asglight.fitting.steps import light, newton
from asglight.lobes import Lobes, asg
from asglight.lobes.frames import align


@dataclass(frozen=True)
class FrameSettings:
    """How much is spent on a next frame.

    Attributes:
        coarse: Steps on few cells, before lobes are relocated.
        whole: Steps on the whole map.
        changed: Steps on the whole map where lobes were relocated; if empty, those of `whole`.
        relocation: What is spent on relocating lobes.
        afresh: What is spent on a frame that is fitted from nothing.
    """

    coarse: tuple[Level, ...]
    whole: tuple[Level, ...]
    changed: tuple[Level, ...]
    relocation: Relocation
    afresh: FirstFrameSettings


LIVE = FrameSettings(
    coarse=(Level(2, Corners(0.1, 0.005)),),
    whole=(Level(2, Corners(0.1, 0.005)), Level(2, Corners(0.1, 0.002))),
    changed=(Level(4, Corners(0.1, 0.005)), Level(4, Corners(0.1, 0.002))),
    relocation=Relocation(rounds=1, trial=TrialSettings(steps=2, companions=2)),
    afresh=first_frame.FAST,
)

FAST = FrameSettings(
    coarse=(Level(4, Corners(0.3, 0.02)),),
    whole=(Level(4, Corners(0.3, 0.02)), Level(8, Corners(0.1, 0.002))),
    changed=(),
    relocation=Relocation(rounds=2, trial=TrialSettings(4)),
    afresh=first_frame.FAST,
)
"""A trial only has to tell that J will be lower. With three companions, lamps in a tunnel are
followed in three quarters of the time, but flicker by a quarter more."""

BEST = FrameSettings(
    coarse=(Level(4, Corners(0.3, 0.02)),),
    whole=(
        Level(8, Corners(0.3, 0.02)),
        Level(16, Corners(0.1, 0.01)),
        Level(24, Corners(0.1, 0.002)),
    ),
    changed=(),
    relocation=Relocation(rounds=3, trial=TrialSettings(8), splits=4),
    afresh=first_frame.BEST,
)
"""With trials of four steps r0.5 of `tunnel` and `tunnel2x` is half as large again, in 8 % less
time: the others make up for the lobe that goes in more steps than that."""

CHANGED = 1.2
"""Loss of the lobes as they were, over that of the initial guess, from which a frame counts as
changed: where lobes are far too few for the map every loss is high, and nothing is in doubt. Of a
frame that is held, by how much another fit must be better (sequence.py)."""

RETURN_LOSS = 0.2
"""Loss of the guess from which dark tracks are asked for, which takes a tenth of a live frame. Of
lamps that chase each other it is 1.2 to 1.7; of `day`, `tunnel` and `handheld`, where none comes
back at once, at most a tenth."""

AFRESH_GAIN = 2 / 3
"""Share of the loss below which a fit from nothing, one from the frame before the last, or one with
dark tracks lit again takes the place of one that was followed."""


def fit_next_frame(
    reference: Tensor,
    previous: Lobes,
    earlier: Lobes | None = None,
    settings: FrameSettings = FAST,
    threads: int = 1,
    count: int | None = None,
) -> FrameFit:
    """Fit a frame that follows another.

    Args:
        reference: Repaired radiance.  [H, 2 H, 3]
        previous: The tracks of the frame before (slots.py).  [2 N, .]
        earlier: The tracks of the frame before that, from which the motion is predicted.  [2 N, .]
        settings: How much is spent.
        threads: Of a fit from nothing, as in `fit_first_frame`.
        count: Lobes lit at most; None for N.
    """
    frame = exposed(reference)
    count = previous.count // TRACKS_PER_LOBE if count is None else count
    if frame.exposure <= 0:
        return FrameFit(_scaled(previous, 0.0), 0.0, 0.0)
    free = slots.free_tracks(previous, earlier)
    if float(previous.amplitude.max()) <= 0:
        fresh = fit_first_frame(
            reference, count, previous.form, settings.afresh, threads=threads, in_shot=True
        )
        return _in_own_tracks(fresh, [-1] * fresh.lobes.count, previous, previous, free)
    whole = objective.target(frame.radiance)
    coarse = objective.trial_target(frame.radiance, settings.whole[0].corners)
    width_min = narrowest(frame.height)
    guess = _guess_from(previous, earlier, frame.exposure, coarse, width_min)
    if guess.unlike > CHANGED * float(guess.outcome.value):
        if earlier is not None:
            guess = _if_it_was_a_flash(guess, earlier, frame.exposure, coarse, width_min)
        if float(guess.outcome.value) > RETURN_LOSS:
            guess = _if_lights_come_back(guess, coarse, count)
    before, tracks, own = guess.before, guess.tracks, guess.own
    free = free & temporal.is_dark(before)
    outcome, unlike = guess.outcome, guess.unlike
    prior = temporal.prior(outcome.lobes)
    outcome = stepped(outcome, coarse, settings.coarse, prior, width_min)
    reached = outcome.lobes[0]
    levels, stays = settings.whole, torch.ones_like(tracks, dtype=torch.bool)
    if float(outcome.value) > RELOCATION_COST:  # a trial cannot lower it by more
        competing = replace(coarse, corners=levels[-1].corners)
        limits = count, int(free.sum()), width_min
        lobes, stays = relocated(outcome, own, competing, *limits, settings.relocation)
        if len(stays) > len(tracks):
            levels = settings.changed or levels
        outcome = replace(outcome, lobes=lobes.select(stays)[None])
    outcome = replace(outcome, shown=None)  # now on the cells of the whole map
    outcome = stepped(outcome, whole, levels, temporal.prior(outcome.lobes), width_min)
    loss = float(outcome.value)
    if is_lost(loss, unlike, reference, whole, frame.exposure, count, previous.form):
        from_nothing = partial(
            fit_first_frame, reference, count, previous.form, threads=threads, in_shot=True
        )
        fresh = _if_better(from_nothing, settings.afresh, AFRESH_GAIN * loss)
        if fresh is not None:
            return _in_own_tracks(fresh, [-1] * fresh.lobes.count, before, previous, free)
    fit = with_flux_of(
        temporal.blackened(light.with_amplitudes(outcome, whole).lobes[0]), frame, loss
    )
    return _followed(fit, guess, reached, stays, previous, free)


@dataclass(frozen=True)
class _Guess:
    """Where the steps of a frame begin.

    Attributes:
        before: The tracks that it follows, in the exposure of this frame.  [2 N, .]
        tracks: Those of them that are lit.  [K]
        own: Their lobes.  [K, .]
        outcome: The lobes to begin with.
        unlike: Loss of `own` as they were.
    """

    before: Lobes
    tracks: Tensor
    own: Lobes
    outcome: newton.Outcome
    unlike: float


def _guess_from(
    followed: Lobes,
    earlier: Lobes | None,
    exposure: float,
    frame: objective.Target,
    width_min: float,
) -> _Guess:
    """Return the initial guess from the tracks of one frame."""
    before = _scaled(followed, 1 / _within_reach(exposure, followed))
    tracks = torch.nonzero(~temporal.is_dark(before)).flatten()
    own = before.select(tracks)
    moved_from = None if earlier is None else earlier.select(tracks)
    return _Guess(before, tracks, own, *initial_guess(own, moved_from, frame, width_min))


def _if_it_was_a_flash(
    guess: _Guess, earlier: Lobes, exposure: float, frame: objective.Target, width_min: float
) -> _Guess:
    """Return the guess from the frame before the last, where this frame is as that one was.

    A flash of one frame takes the lobes from what it outshines. Relocation would bring them back
    one by one.
    """
    if float(earlier.amplitude.max()) <= 0:
        return guess
    as_it_was = _scaled(earlier, 1 / _within_reach(exposure, earlier))
    shown = lobe_images.images(as_it_was[None], frame.places).radiance
    if CHANGED * float(objective.value(shown, frame)) >= guess.unlike:
        return guess
    back = _guess_from(earlier, None, exposure, frame, width_min)
    return back if back.outcome.value < AFRESH_GAIN * guess.outcome.value else guess


def _if_lights_come_back(guess: _Guess, frame: objective.Target, count: int) -> _Guess:
    """Return the guess with dark tracks lit where they were, where that is the better one."""
    tracks, lit = lit_again(guess.before, frame, count)
    value = objective.value(lit.radiance, frame)
    if float(value) >= AFRESH_GAIN * float(guess.outcome.value):
        return guess
    own = lit.lobes[0]
    outcome = newton.Outcome(lit.lobes, value, torch.full_like(value, DAMPING_START), lit)
    return _Guess(guess.before.replaced(tracks, own), tracks, own, outcome, guess.unlike)


def _if_better(
    fitted: Callable[[FirstFrameSettings], FrameFit], settings: FirstFrameSettings, loss_max: float
) -> FrameFit | None:
    """Return a fit from nothing if its loss is below another; the cheapest one decides."""
    quick = fitted(first_frame.FAST)
    if quick.loss >= loss_max:
        return None
    return quick if settings is first_frame.FAST else fitted(settings)


def _followed(
    fit: FrameFit, guess: _Guess, reached: Lobes, stays: Tensor, previous: Lobes, free: Tensor
) -> FrameFit:
    """Write followed lobes into their tracks; new ones and other lights get tracks of their own.

    Args:
        fit: The lobes, new ones last.  [N', .]
        guess: Where they began, K of them.
        reached: Where these had come to before any was relocated.  [K, .]
        stays: Which of these, and of the new ones, have light.  [K + new], N' of them true
        previous: The tracks one frame before.  [2 N, .]
        free: Which are free.  [2 N]
    """
    begun = torch.arange(len(stays), device=stays.device)[stays]
    is_new = begun >= len(guess.tracks)
    start = torch.where(is_new, 0, begun)
    was = _shares(guess.own)
    is_other = ~is_new & slots.is_other(
        fit.lobes, guess.own.select(start), _shares(fit.lobes) / was[start]
    )
    if len(stays) == len(guess.tracks) and not bool(is_other.any()):
        lit = ~temporal.is_dark(fit.lobes)  # one that ends may have gone anywhere meanwhile
        own = guess.tracks[begun[lit]]
        return replace(fit, lobes=_in_tracks(fit.lobes.select(lit), own, previous))
    origin = torch.where(is_new | is_other, -1, guess.tracks[start])
    left = slots.is_other(reached, guess.own, _shares(reached) / was)
    left[start[is_other]] = True  # their tracks are as they were
    known = guess.before.replaced(guess.tracks, reached)
    known = known.replaced(guess.tracks[left], guess.own.select(left))
    return _in_own_tracks(fit, origin.tolist(), known, previous, free)


def _shares(lobes: Lobes) -> Tensor:
    """Return what part of the light of all each lobe has.  [N]."""
    flux = asg.flux(lobes).sum(-1)
    return flux / flux.sum()


def _in_tracks(lobes: Lobes, tracks: Tensor, previous: Lobes) -> Lobes:
    """Write lobes into their tracks, the others dark where they were.  [2 N, .]."""
    found = _scaled(previous, 0.0).replaced(tracks, lobes)
    return align(found, previous)


def _in_own_tracks(
    fit: FrameFit, origin: list[int], known: Lobes, previous: Lobes, free: Tensor
) -> FrameFit:
    """Write the lights of a frame into the tracks that they belong to (`slots.tracks_for`).

    Args:
        fit: The lobes.  [N, .]
        origin: The track that each comes from; -1 for none.  N
        known: The tracks, where they have come to.  [2 N, .]
        previous: The tracks one frame before.  [2 N, .]
        free: Which are free.  [2 N]
    """
    lobes = temporal.blackened(fit.lobes)
    lit = torch.nonzero(~temporal.is_dark(lobes)).flatten()
    origin = [origin[index] for index in lit.tolist()]
    tracks = slots.tracks_for(lobes.select(lit), origin, known, free)
    own = torch.tensor(tracks, dtype=torch.long, device=lit.device)
    return replace(fit, lobes=_in_tracks(lobes.select(lit), own, previous))


def stepped(
    outcome: newton.Outcome,
    frame: objective.Target,
    levels: tuple[Level, ...],
    prior: temporal.Prior,
    width_min: float,
) -> newton.Outcome:
    """Take the steps of each level in turn, the temporal term on.

    What the outcome shows, if anything, is on the frame's adaptive cells.
    """
    for level in levels:
        outcome = newton.minimise(
            outcome.lobes,
            replace(frame, corners=level.corners),
            level.steps,
            priors=[prior],
            damping=outcome.damping,
            width_min=width_min,
            shown=outcome.shown,
        )
    return outcome


def _within_reach(exposure: float, previous: Lobes) -> float:
    """Return the unit of the frame's radiance for the lobes before it.

    After a jump of more than ten stops they are taken in units of their own flux instead: they say
    where the light was, not how much, and float32 squares stay finite.
    """
    own = float(asg.flux(previous).sum()) / (12 * math.pi)
    return exposure if 2**-10 < own / exposure < 2**10 else own


def _scaled(lobes: Lobes, factor: float) -> Lobes:
    return Lobes(lobes.axes, lobes.sharpness, lobes.amplitude * factor, lobes.form)
