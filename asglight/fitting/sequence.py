# SPDX-License-Identifier: Apache-2.0
"""One frame of a sequence, started from the one before, with the preset that was asked for."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from asglight.fitting.first_frame.fit import FrameFit, fit_first_frame, mean_radiance
from asglight.fitting.following import next_frame as following
from asglight.fitting.following import slots, whole_shot
from asglight.fitting.following.next_frame import fit_next_frame
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.paper import fit as paper
from asglight.fitting.paper import losses as paper_losses
from asglight.lobes import Form, Lobes, asg
from asglight.lobes.frames import canonical
from asglight.threads import frames_on, one_thread

_SETTINGS = {
    Preset.LIVE: following.LIVE,
    Preset.FAST: following.FAST,
    Preset.BEST: following.BEST,
}

REFINEMENT = {Preset.FAST: whole_shot.Refinement(), Preset.BEST: whole_shot.Refinement()}
"""How a shot is refined, by presets that do: `live` has no time, and `paper` is as published."""

StepCallback = Callable[[int, int, float], None]
"""Called with the step, the number of steps and the loss, where a frame takes long."""


def fit_frame(
    reference: Tensor,
    options: FitOptions,
    previous: Lobes | None,
    earlier: Lobes | None = None,
    on_step: StepCallback | None = None,
) -> FrameFit:
    """Fit one frame.

    Every step of a frame is computed on one thread, so that its bits are the same everywhere;
    starts of a fit from nothing, and trials, run side by side on as many as torch may use
    (OMP_NUM_THREADS).

    Args:
        reference: Repaired radiance.  [H, W, 3]
        options: Settings.
        previous: The lobes of the frame before; None starts afresh.  [N, .]
        earlier: Those of the frame before that, if there is one.  [N, .]
        on_step: Progress within the frame (`paper` only).
    """
    if options.preset is Preset.PAPER:
        return _paper_frame(reference, options, previous, on_step)
    threads = torch.get_num_threads()
    # no record for derivatives: 7 % of a live frame
    with one_thread(), frames_on(threads), torch.inference_mode():
        settings = _SETTINGS[options.preset]
        if previous is None:
            form = options.form
            if form is None and options.preset is Preset.LIVE:
                form = Form.ASG
            fit = fit_first_frame(
                reference,
                options.count,
                form,
                settings.afresh,
                threads=threads,
                in_shot=options.has_spare_tracks,
            )
            fit = replace(fit, lobes=canonical(fit.lobes))
            if options.has_spare_tracks:
                fit = replace(fit, lobes=slots.with_spare_tracks(fit.lobes))
        else:
            fit = fit_next_frame(reference, previous, earlier, settings, threads, options.count)
    return replace(fit, lobes=fit.lobes.clone())  # a tensor of inference mode cannot be changed


class Following:
    """Fits frames one after the other, each from the two before it.

    Nothing is looked ahead for: what a frame comes to depends on it and on those before.

    Attributes:
        last: The newest fit; None before the first frame.
    """

    def __init__(
        self,
        options: FitOptions,
        before: Sequence[Lobes] = (),
        last: FrameFit | None = None,
        seen: Tensor | None = None,
        *,
        is_settled: bool = False,
    ) -> None:
        """Begin before the first frame, or where an earlier run ended.

        Args:
            options: Settings, as `FitOptions.settled` returns them.
            before: Lobes of up to two fits before.
            last: The newest of these.
            seen: The image that it shows.  [H, 2 H, 3]
            is_settled: Whether another fit of that image was no better.
        """
        self.last = last
        self._options = options
        self._before = list(before)
        self._seen = seen
        self._is_settled = is_settled

    def take(self, radiance: Tensor, on_step: StepCallback | None = None) -> bool:
        """Fit the next frame; one with the pixels of the one before may keep its fit.

        It does unless lobes that follow on from that fit show it better, which is tried until they
        do not. A first frame is fitted from nothing, and not tried again. The `paper` preset fits
        every frame, as published.

        Args:
            radiance: Repaired.  [H, 2 H, 3]
            on_step: Progress within the frame (`paper` only).

        Returns:
            Whether the frame has a fit of its own.
        """
        repeated = self.last if self._is_repeat(radiance) else None
        if repeated is not None and self._is_settled:
            return False
        earlier, previous = [None, None, *self._before][-2:]
        fit = fit_frame(radiance, self._options, previous, earlier, on_step)
        if repeated is not None and following.CHANGED * fit.loss >= repeated.loss:
            self._is_settled = True
            return False
        self._is_settled = previous is None
        self._before = [*self._before[-1:], fit.lobes]
        self.last, self._seen = fit, radiance
        return True

    def _is_repeat(self, radiance: Tensor) -> bool:
        """Tell whether an image has the pixels of the one before."""
        may_repeat = self._options.preset is not Preset.PAPER
        return may_repeat and self._seen is not None and torch.equal(radiance, self._seen)


def _paper_frame(
    reference: Tensor, options: FitOptions, previous: Lobes | None, on_step: StepCallback | None
) -> FrameFit:
    form = options.form or Form.ASG
    start = previous or paper.start(reference, options.count, form, options.seed)
    steps = options.paper_steps[0 if previous is None else 1]
    report = None if on_step is None else (lambda step, loss: on_step(step, steps, loss))
    lobes = paper.fit_frame(reference, start, steps=steps, previous=previous, on_step=report)
    loss = float(paper_losses.frame_loss(lobes, paper_losses.target(reference)))
    wanted = mean_radiance(reference)
    found = float(asg.flux(lobes).sum()) / (12 * math.pi)
    return FrameFit(lobes, loss, found / wanted - 1 if wanted > 0 else 0.0)
