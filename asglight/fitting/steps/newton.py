# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt steps on all lobes of a frame at once, and on many frames side by side.

A step solves damped equations (equations.py) [Marquardt 1963]; one that does not lower J is not
taken, and the next is damped more. 15 lobes are 120 unknowns: the cost is in the images of the
lobes, not in the solve. Of many lobes it would be, so these take steps in parts (neighbours.py),
and what a fit costs grows with their number.

Frames do not see each other. On the processor C takes the steps (compiled/), for which those here
are the reference. On a GPU no step waits for the processor: what a frame whose step
failed keeps is chosen there, and all that a step does is started at once (captured.py).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from asglight.fitting import compiled
from asglight.fitting.compiled import layout
from asglight.fitting.loss import lobe_images, objective, temporal
from asglight.fitting.loss.coordinates import advance
from asglight.fitting.loss.lobe_images import Images
from asglight.fitting.loss.objective import LossTerms
from asglight.fitting.loss.probes import tables
from asglight.fitting.steps import equations, neighbours
from asglight.fitting.steps.captured import Replays
from asglight.lobes import Lobes

OnStep = Callable[[Lobes], None]
"""Called with the lobes [F, N, .] after a step."""

DAMPING_START, DAMPING_MIN, DAMPING_MAX = 1e-2, 1e-6, 1e6
DAMPING_UP, DAMPING_DOWN = 5.0, 0.3

TOLERANCE = 1e-4
"""A step that lowers J by a smaller share of it is the last."""

TOGETHER = 64
"""Lobes that take steps together, at most; of more, parts do. With 60 in two parts a fit takes two
thirds of the time, and its env is 3 % larger in the mean of ten maps."""

PART = 32
"""Lobes of a part, at most. With 120 in parts J ends a tenth lower than with all together, for one
damping held back all of them, in a seventh of the time."""

TURN_STEPS = 2
"""Steps of a part before it is the turn of the next: with one, a fit takes a fifth longer."""


@dataclass(frozen=True)
class Outcome:
    """Lobes after some steps, with the state that continues them.

    Attributes:
        lobes: The lobes.  [F, N, .]
        value: J with the temporal terms.  [F]
        damping: The damping of the next step.  [F]
        shown: The lobes on the frame's adaptive cells, where they are known.
    """

    lobes: Lobes
    value: Tensor
    damping: Tensor
    shown: Images | None = None

    def __getitem__(self, index: Tensor) -> "Outcome":
        """Pick frames by index or mask."""
        shown = None if self.shown is None else self.shown[index]
        return Outcome(self.lobes[index], self.value[index], self.damping[index], shown)

    def best(self) -> "Outcome":
        """Return the frame with the least J, for frames that are the same.  F = 1."""
        return self[self.value.argmin(keepdim=True)]


@dataclass(frozen=True)
class _State:
    """Lobes on their adaptive cells, J there, and J with the temporal terms.

    J's slope is taken where a step starts, not where one was tried: many steps are not taken.
    """

    shown: Images
    sizes: LossTerms
    value: Tensor


@dataclass(frozen=True)
class Setting:
    """What the steps of one call have in common; see `minimise`."""

    frame: objective.Target
    priors: tuple[temporal.Prior, ...]
    width_min: float
    still: Tensor | None = None
    tolerance: float = TOLERANCE


_Progress = tuple[_State, Tensor]
"""Where a step starts, and its damping [F]."""

REPLAYS = Replays()
"""The steps on GPUs."""

REPLAYED_FRAMES = 32
"""Frames side by side, at most, whose steps are recorded. Of more a step computes for longer than
it takes to start, by estimate, and each kind would keep the memory of a step: 60 MB a frame."""


def minimise(
    lobes: Lobes,
    frame: objective.Target,
    steps: int,
    *,
    priors: Sequence[temporal.Prior] = (),
    damping: Tensor | float = DAMPING_START,
    width_min: float = 0.0,
    still: Tensor | None = None,
    tolerance: float = TOLERANCE,
    on_step: OnStep | None = None,
    shown: Images | None = None,
    moving: Tensor | None = None,
) -> Outcome:
    """Take at most `steps` steps, fewer where no frame gains any more.

    More lobes than `TOGETHER` take them in parts, each part as many.

    Args:
        lobes: Where to start.  [F, N, .]
        frame: The maps and their weights.
        steps: Steps tried, taken or not.
        priors: The temporal terms, added to J: one for each neighbouring frame.
        damping: First damping.  [F]
        width_min: Sigma of the narrowest lobe allowed, radians.
        still: Which lobes stay as they are.  [F, N]
        tolerance: Stop when the step of each frame lowers J by less than this share of it.
        on_step: Called with the lobes after each step.
        shown: The lobes on the frame's adaptive cells, where they are known.
        moving: The lobes of each frame that take steps; the light of all others is held. All if
            None.  [F, K]
    """
    given = Setting(frame, tuple(priors), width_min, still, tolerance)
    shown = shown or lobe_images.images(lobes, frame.places)
    damping = torch.as_tensor(damping, dtype=torch.float64, device=lobes.axes.device)
    damping = damping.expand(len(lobes.axes))
    if moving is not None or lobes.count > TOGETHER:
        return _in_parts(shown, moving, damping, given, steps, on_step)
    if compiled.serves(lobes, frame.places):
        return _compiled(shown, damping, given, steps, on_step)
    state = _judged(shown, frame, given.priors)
    if lobes.axes.is_cuda:
        state, damping = _on_device(state, damping, given, steps, on_step)
        return Outcome(state.shown.lobes, state.value, damping, state.shown)
    system: tuple[Tensor, Tensor] | None = None
    for _ in range(steps):
        system = system or _equations(state, given)
        tried = _tried(state, system, damping, given)
        better = tried.value < state.value
        finished = better & (state.value - tried.value < given.tolerance * state.value)
        damping = _next_damping(damping, better)
        if bool(better.any()):
            state = tried if bool(better.all()) else _chosen(better, tried, state)
            system = None
        if on_step is not None:
            on_step(state.shown.lobes)
        if bool((finished | (damping >= DAMPING_MAX)).all()):
            break
    return Outcome(state.shown.lobes, state.value, damping, state.shown)


def _in_parts(
    shown: Images,
    moving: Tensor | None,
    damping: Tensor,
    given: Setting,
    steps: int,
    on_step: OnStep | None,
) -> Outcome:
    """Take steps with some lobes, or with all of them part by part."""
    frame, value = given.frame, _value(shown, given)
    for turn in range(1 if moving is not None else math.ceil(steps / TURN_STEPS)):
        lobes, radiance, before = shown.lobes, shown.radiance, value
        if moving is not None:
            parts, together = [moving], steps
        else:
            # where parts meet lobes wait for each other: each turn cuts elsewhere
            parts = neighbours.parts(lobes.axis_z, PART, turn)
            together = min(TURN_STEPS, steps - turn * TURN_STEPS)
        for part in parts:
            lobes, radiance, damping = _some(lobes, radiance, part, damping, given, together)
        shown = lobe_images.images(lobes, frame.places)
        value = _value(shown, given)
        if on_step is not None:
            on_step(lobes.clone())
        # not asked on a GPU, which would have to be waited for
        if not lobes.axes.is_cuda and bool((before - value < given.tolerance * before).all()):
            break
    return Outcome(shown.lobes, value, damping, shown)


def _some(
    lobes: Lobes, radiance: Tensor, index: Tensor, damping: Tensor, given: Setting, steps: int
) -> tuple[Lobes, Tensor, Tensor]:
    """Take steps with some lobes of each frame: J is that of these against what others leave.

    Args:
        lobes: All of them.  [F, N, .]
        radiance: What they show on the adaptive cells.  [F, 3, P]
        index: Which take steps.  [F, K]
        damping: First damping.  [F]
        given: Of all lobes.
        steps: How many.

    Returns:
        All lobes, what they show, and the damping of the next step.
    """
    own = lobe_images.images(neighbours.some(lobes, index), given.frame.places)
    rest = radiance - own.radiance
    found = minimise(
        own.lobes,
        objective.less(given.frame, rest),
        steps,
        priors=[neighbours.prior(each, index) for each in given.priors],
        damping=damping,
        width_min=given.width_min,
        still=None if given.still is None else neighbours.pick(given.still, index),
        tolerance=given.tolerance,
        shown=own,
    )
    assert found.shown is not None  # of lobes that took steps
    return neighbours.put(lobes, index, found.lobes), rest + found.shown.radiance, found.damping


def _value(shown: Images, given: Setting) -> Tensor:
    """Return J with the temporal terms.  [F]."""
    return _judged(shown, given.frame, given.priors).value


def _compiled(
    shown: Images, damping: Tensor, given: Setting, steps: int, on_step: OnStep | None
) -> Outcome:
    """Take all steps in C."""
    places, found = given.frame.places, lobe_images.empty_like(shown)
    cells = equations.summed_on(places)
    counts = shown.scale.shape[0], shown.scale.shape[1]
    rule = DAMPING_UP, DAMPING_DOWN, DAMPING_MIN, DAMPING_MAX
    laid = layout.steps(given, cells, (tables(places.rows), tables(cells.height)), rule, counts)

    def report() -> None:
        if on_step is not None:
            on_step(found.lobes.clone())

    done = compiled.minimise(shown, found, damping, steps, laid, on_step and report)
    return Outcome(found.lobes, *done, found)


def _on_device(
    state: _State, damping: Tensor, given: Setting, steps: int, on_step: OnStep | None
) -> _Progress:
    """Take all steps on a GPU, which would have to be waited for to know that one is the last."""

    def report(progress: _Progress) -> None:
        if on_step is not None:
            on_step(progress[0].shown.lobes.clone())

    if len(damping) > REPLAYED_FRAMES:
        progress = state, damping
        for _ in range(steps):
            progress = _step(progress, given)
            report(progress)
        return progress
    return REPLAYS.run(_step, (state, damping), given, steps, on_step and report)


def _step(progress: _Progress, given: Setting) -> _Progress:
    """Take a step in each frame where it lowers J, without asking what was found."""
    state, damping = progress
    tried = _tried(state, _equations(state, given), damping, given)
    better = tried.value < state.value
    return _chosen(better, tried, state), _next_damping(damping, better)


def _tried(state: _State, system: tuple[Tensor, Tensor], damping: Tensor, given: Setting) -> _State:
    lobes = state.shown.lobes
    step = equations.solve(*system, lobes, damping, given.still)
    ahead = advance(lobes, step, given.width_min)
    frame = given.frame
    return _judged(lobe_images.images(ahead, frame.places), frame, given.priors)


def _next_damping(damping: Tensor, better: Tensor) -> Tensor:
    return torch.where(
        better,
        (DAMPING_DOWN * damping).clamp(min=DAMPING_MIN),
        (DAMPING_UP * damping).clamp(max=DAMPING_MAX),
    )


def _judged(shown: Images, frame: objective.Target, priors: Sequence[temporal.Prior]) -> _State:
    found = objective.loss_terms(shown.radiance, frame)
    value = found.value
    for prior in priors:
        value = value + temporal.value(shown.lobes, prior)
    return _State(shown, found, value)


def _chosen(better: Tensor, tried: _State, before: _State) -> _State:
    """Return for each frame one state or the other."""

    def of(new: Tensor, old: Tensor) -> Tensor:
        return torch.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    new, old = tried.sizes, before.sizes
    found = LossTerms(
        of(new.value, old.value),
        of(new.parts, old.parts),
        of(new.texels, old.texels),
        of(new.views, old.views),
        of(new.seen, old.seen),
    )
    shown = lobe_images.chosen(better, tried.shown, before.shown)
    return _State(shown, found, of(tried.value, before.value))


def _equations(state: _State, given: Setting) -> tuple[Tensor, Tensor]:
    found = objective.loss_gradient(state.shown.radiance, given.frame, state.sizes)
    hessian, gradient = equations.normal_equations(state.shown, found, given.frame)
    for prior in given.priors:
        curvature, slope = temporal.slopes(state.shown.lobes, prior)
        torch.diagonal(hessian, dim1=-2, dim2=-1).add_(curvature)
        gradient = gradient + slope
    return hessian, gradient
