# SPDX-License-Identifier: Apache-2.0
"""A fit to be watched: frames in order with the `live` preset, nothing kept on disk."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.lobes import Lobes
from asglight.shots.reading import ahead


def live_fits(
    read: Callable[[int], Tensor], frames: Sequence[int], lobes: int | None = None
) -> Iterator[tuple[int, Lobes]]:
    """Fit frames one after the other, each from the ones before, as `fit_frames` does.

    Args:
        read: Returns the repaired radiance of a frame, [H, 2 H, 3]; called in threads.
        frames: Frame numbers.
        lobes: Number of lobes; None for that of `FitOptions`.

    Yields:
        Frame number and lobes, [N, .]; a frame with the pixels of the one before has its lobes.

    Raises:
        InputError: A frame cannot be read.
    """
    options = FitOptions(lobes, Preset.LIVE, moving=len(frames) > 1)
    before: list[Lobes] = []
    last: Tensor | None = None
    with contextlib.closing(ahead(read, list(frames))) as images:
        for frame, radiance in zip(frames, images, strict=True):
            if last is None or not torch.equal(radiance, last):
                earlier = before[-2] if len(before) > 1 else None
                previous = before[-1] if before else None
                fit = fit_frame(radiance, options, previous, earlier)
                before = [*before[-1:], fit.lobes]
            last = radiance
            yield frame, before[-1]
