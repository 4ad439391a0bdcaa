# SPDX-License-Identifier: Apache-2.0
"""The first frame of `fast` for many maps at once.

One map leaves most of a GPU idle: a step is hundreds of operations on a few megabytes. Here maps
that have nothing to do with each other take each step together. What is done with each is what
first_frame.py does with one; maps whose steps gain nothing any more wait for the others, and may
gain a little by it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from asglight.fitting.first_frame import fit as first_frame
from asglight.fitting.first_frame import multi_start, reweighting, seeding
from asglight.fitting.first_frame.fit import Exposed, FrameFit
from asglight.fitting.loss import objective
from asglight.fitting.steps import light, newton
from asglight.fitting.stills.frames import chosen
from asglight.fitting.stills.reweighting import balanced_each
from asglight.fitting.stills.splitting import split_and_merge_each
from asglight.fitting.stills.starting import seeds_of_each
from asglight.lobes import Form, Lobes
from asglight.lobes.frames import canonical
from asglight.threads import frames_on, one_thread

AT_ONCE = 128
"""Maps side by side: by estimate enough that a step computes for longer than it takes to start, and
8 GB of 60 MB each, which all GPUs have on which one would do this."""

SETTINGS = first_frame.FAST

OnDone = Callable[[int], None]
"""Called with the number of maps that are done."""


@dataclass(frozen=True)
class _Batch:
    """Maps of one size that are not black.

    Attributes:
        frames: Each map.
        whole: All of them on their adaptive cells.
        coarse: The same on few adaptive cells.
        last: The same on the adaptive cells of the last steps.
        cells: The cells of each.
    """

    frames: list[Exposed]
    whole: objective.Target
    coarse: objective.Target
    last: objective.Target
    cells: list[seeding.Cells]

    @property
    def width_min(self) -> float:
        """Sigma of the narrowest lobe allowed, radians."""
        return first_frame.narrowest(self.frames[0].height)


def fit_stills(
    references: Sequence[Tensor],
    count: int,
    form: Form = Form.ASG,
    device: str = "cpu",
    at_once: int = AT_ONCE,
    on_done: OnDone = lambda done: None,
) -> list[FrameFit]:
    """Fit each of many maps from nothing, as `fit_frame` does with `fast`.

    On the processor it gains nothing over one map after the other.

    Args:
        references: Repaired radiance, all of one size.  [H, 2 H, 3] each
        count: N.
        form: Lobe function, but for flat, of which starts are chosen map by map.
        device: Where torch computes.
        at_once: Maps side by side; they bound the memory.
        on_done: Progress.

    Returns:
        Of each map, its lobes on the host.

    Raises:
        ValueError: Maps differ in size.
    """
    sizes = {tuple(reference.shape) for reference in references}
    if len(sizes) > 1:
        raise ValueError(f"references: of sizes {sorted(sizes)}; expected one size")
    found: list[FrameFit] = []
    threads = torch.get_num_threads()
    with one_thread(), frames_on(threads), torch.inference_mode():
        for first in range(0, len(references), at_once):
            maps = [each.to(device) for each in references[first : first + at_once]]
            found.extend(_some(maps, count, form))
            on_done(len(found))
    # a tensor of inference mode cannot be changed
    return [replace(fit, lobes=fit.lobes.clone()) for fit in found]


def _some(references: list[Tensor], count: int, form: Form) -> Iterator[FrameFit]:
    """Fit maps side by side; black ones need no steps."""
    frames = [first_frame.exposed(reference) for reference in references]
    lit = [index for index, frame in enumerate(frames) if frame.exposure > 0]
    fits: Iterator[FrameFit] = iter(())
    if lit:
        batch = _batch([references[k] for k in lit], [frames[k] for k in lit])
        fits = iter(_fitted(batch, count, form))
    for reference, frame in zip(references, frames, strict=True):
        if frame.exposure > 0:
            yield next(fits)
        else:
            dark = first_frame.dark_lobes(count, form, reference.cpu())
            yield FrameFit(canonical(dark), 0.0, 0.0)


def _batch(references: list[Tensor], frames: list[Exposed]) -> _Batch:
    radiance = torch.cat([frame.radiance for frame in frames])
    joined = replace(frames[0], radiance=radiance)
    cells = [
        seeding.cells(reference / frame.exposure)
        for reference, frame in zip(references, frames, strict=True)
    ]
    return _Batch(
        frames,
        objective.target(radiance),
        objective.trial_target(radiance),
        first_frame.on_fine_cells(joined),
        cells,
    )


def _fitted(batch: _Batch, count: int, form: Form) -> list[FrameFit]:
    """Return the fit of each map."""
    yardstick = seeds_of_each(batch.cells, count, Form.SG, None)
    aims = reweighting.aims_of_each(yardstick, batch.last, SETTINGS.left)
    found = _best_end(batch, count, form, aims)
    found = balanced_each(found, batch.last, aims, batch.width_min)
    lit = light.last_by_texel_means(light.with_amplitudes(found, batch.last), batch.last)
    lobes = canonical(lit.lobes.to("cpu"))
    return [
        first_frame.with_flux_of(own, replace(frame, flux=frame.flux.cpu()), loss)
        for own, frame, loss in zip(_each(lobes), batch.frames, found.value.tolist(), strict=True)
    ]


def _best_end(batch: _Batch, count: int, form: Form, aims: Tensor) -> newton.Outcome:
    """Follow each initial guess to its end; return of each map the one that `End` puts first."""
    best: tuple[newton.Outcome, Tensor, Tensor] | None = None
    for spread in SETTINGS.spreads_deg:
        seeds = seeds_of_each(batch.cells, count, form, spread)
        found = _finished(batch, seeds)
        lit = light.with_amplitudes(found, batch.last)
        lags = reweighting.errors(lit.radiance, batch.last) / aims
        behind = lags[:, 1:].amax(-1).clamp(min=1.0)
        wrong = multi_start.lit_wrong(lit, batch.last)
        if best is not None:
            ahead = (behind < best[1]) | ((behind == best[1]) & (wrong < best[2]))
            found = chosen(ahead, found, best[0])
            behind, wrong = (
                torch.where(ahead, new, old) for new, old in ((behind, best[1]), (wrong, best[2]))
            )
        best = found, behind, wrong
    assert best is not None  # every setting has an initial guess
    return best[0]


def _finished(batch: _Batch, seeds: Lobes) -> newton.Outcome:
    """Return where starts come to, on the adaptive cells on which ends are compared."""
    found = first_frame.descend(
        seeds,
        batch.whole,
        batch.coarse,
        SETTINGS.levels,
        batch.width_min,
        splitting=split_and_merge_each,
    )
    return newton.minimise(found.lobes, batch.last, SETTINGS.finishing, width_min=batch.width_min)


def _each(lobes: Lobes) -> Iterator[Lobes]:
    """Yield the lobes of each frame.  [F, N, .]."""
    return (lobes[index] for index in range(len(lobes.axes)))
