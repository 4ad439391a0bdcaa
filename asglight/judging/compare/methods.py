# SPDX-License-Identifier: Apache-2.0
"""The methods that `asglight compare` sets side by side, each with its source and its effort."""

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.sequence import fit_frame
from asglight.judging import keyed
from asglight.lobes import Form
from asglight.peers import (
    adam_sg,
    cut_lights,
    fixed_axes,
    l2_lobes,
    spherical_harmonics,
    vmf_em,
    wavelets,
)
from asglight.peers.approximation import LOBE_FLOATS, Approximation, free_lobes
from asglight.threads import one_thread


@dataclass(frozen=True)
class Task:
    """What a method is asked for.

    Attributes:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        floats: Budget.
        steps: Of a method of many steps, how many.
        on_step: Called after each of them.
    """

    reference: Tensor
    floats: int
    steps: int
    on_step: Callable[[], None]


@dataclass(frozen=True)
class Method:
    """One method.

    Attributes:
        title: What is printed: method and source.
        fit: The method.
        steps: Gradient steps that its source takes, where those are hours or minutes; 0 otherwise.
        share: Of these steps, what is taken unless all are asked for, as one in so many.
    """

    title: str
    fit: Callable[[Task], Approximation]
    steps: int = 0
    share: int = 1


QUICK_SHARE = 10
"""A quick comparison takes one in ten of the steps that an ordinary one takes."""


def steps_of(method: Method, *, full: bool, quick: bool) -> int:
    """Return the gradient steps that a method takes; 0 where it counts none."""
    if full or not method.steps:
        return method.steps
    return method.steps // method.share // (QUICK_SHARE if quick else 1)


def run(method: Method, task: Task) -> Approximation:
    """Fit on one thread, so that processor time is comparable."""
    with one_thread():
        return method.fit(task)


def warm_up(reference: Tensor, lobes: int) -> None:
    """Pay before the clock runs what the first fits of a process pay: unmeasured, thrown away.

    Args:
        reference: Repaired radiance, with some light in it.  [H, W, 3]
        lobes: Of the fits to come.
    """
    with one_thread():
        fit_frame(reference, FitOptions(lobes), None)  # a first fit prepares its grids
        # torch loads parts of itself at the first step
        fit_frame(reference, FitOptions(1, Preset.PAPER, paper_steps=(1, 1)), None)


def _ours(preset: Preset) -> Callable[[Task], Approximation]:
    def fit(task: Task) -> Approximation:
        options = FitOptions(lobes=task.floats // LOBE_FLOATS[Form.ASG], preset=preset)
        return free_lobes(fit_frame(task.reference, options, None).lobes)

    return fit


def _paper(task: Task) -> Approximation:
    options = FitOptions(
        lobes=task.floats // LOBE_FLOATS[Form.ASG],
        preset=Preset.PAPER,
        paper_steps=(task.steps, task.steps),
    )

    def on_step(step: int, steps: int, loss: float) -> None:
        task.on_step()

    return free_lobes(fit_frame(task.reference, options, None, on_step=on_step).lobes)


def _em(task: Task) -> Approximation:
    return free_lobes(vmf_em.fit(task.reference, task.floats // LOBE_FLOATS[Form.SG]))


def _adam_sg(task: Task) -> Approximation:
    return adam_sg.fit(
        task.reference, task.floats, steps=task.steps, on_step=lambda step: task.on_step()
    )


METHODS: dict[str, Method] = {
    "best": Method("asglight, best", _ours(Preset.BEST)),
    "fast": Method("asglight, fast", _ours(Preset.FAST)),
    "paper": Method("Clausen et al. 2024", _paper, paper.FIRST_FRAME_STEPS, 10),
    "asg-l2": Method(
        "ASG by least squares (Xu et al. 2013)",
        lambda task: l2_lobes.least_squares(task.reference, task.floats, Form.ASG),
    ),
    "sg-l2": Method(
        "SG by least squares (Xu et al. 2013)",
        lambda task: l2_lobes.least_squares(task.reference, task.floats, Form.SG),
    ),
    "srbf": Method(
        "Scattered SRBF (Tsai and Shih 2006)",
        lambda task: l2_lobes.scattered_srbf(task.reference, task.floats),
    ),
    "em": Method("vMF EM (Banerjee et al. 2005)", _em),
    "physg": Method("SG by Adam (PhySG, Zhang et al. 2021)", _adam_sg, adam_sg.STEPS, 50),
    "mjp": Method(
        "SG on fixed axes, NNLS (Pettineo 2016)",
        lambda task: fixed_axes.fit(task.reference, task.floats),
    ),
    "wavelets": Method(
        "Haar wavelets (Ng et al. 2003)", lambda task: wavelets.fit(task.reference, task.floats)
    ),
    "sh": Method(
        "Harmonics (Ramamoorthi, Hanrahan 2001)",
        lambda task: spherical_harmonics.fit(task.reference, task.floats),
    ),
    "variance-cut": Method(
        "Variance cut (Viriyothai, Debevec 2009)",
        lambda task: cut_lights.variance_cut(task.reference, task.floats),
    ),
    "median-cut": Method(
        "Median cut (Debevec 2005)",
        lambda task: cut_lights.median_cut(task.reference, task.floats),
    ),
}
"""By the name that --methods takes, in the order of the table."""

KEYED: dict[str, Method] = {
    "keys": Method("asglight, keys", lambda task: keyed.cut(task.reference, textured=False)),
    "keys-texture": Method(
        "asglight, keys + texture", lambda task: keyed.cut(task.reference, textured=True)
    ),
}
"""Those that keep an image, and to no budget: keys and the rest."""

COMPARED = METHODS | KEYED
"""All that `asglight compare` knows."""
