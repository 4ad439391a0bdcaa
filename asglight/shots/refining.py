# SPDX-License-Identifier: Apache-2.0
"""The second reading of a shot: every frame once more, between both its neighbours.

What the checkpoint keeps is the result of the first reading, so an interrupted run comes to the
same bytes.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.first_frame.fit import Exposed, exposed
from asglight.fitting.following.whole_shot import CHUNK, refine_shot
from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import REFINEMENT
from asglight.images import Sequence
from asglight.images.message import shown
from asglight.lobes.data import stack
from asglight.shots.events import OnProgress, Refined
from asglight.shots.kept.kept_frames import KeptFrames
from asglight.shots.kept.records import FrameRecord, own_frames, places_of
from asglight.threads import one_thread


def refined(
    records: list[FrameRecord],
    sequence: Sequence,
    kept: KeptFrames,
    options: FitOptions,
    on_progress: OnProgress,
) -> list[FrameRecord]:
    """Refine the frames of a shot between their neighbours, if the preset asks for it.

    Frames that repeat another count once.

    Args:
        records: Every frame as fitted after the one before.
        sequence: Where they came from.
        kept: Their images.
        options: Settings of the fit.
        on_progress: Called with each event.

    Raises:
        InputError: A frame has changed since it was fitted, or cannot be read any more.
    """
    own = own_frames(records)
    return refined_by(records, lambda: _unchanged(own, sequence, kept), options, on_progress)


def refined_by(
    records: list[FrameRecord],
    again: Callable[[], Iterator[Tensor]],
    options: FitOptions,
    on_progress: OnProgress,
) -> list[FrameRecord]:
    """Refine the frames of a shot, as `refined`.

    Args:
        records: Every frame as fitted after the one before.
        again: Returns the radiance of those that repeat no other, [H, 2 H, 3] each, in order.
        options: Settings of the fit.
        on_progress: Called with each event.
    """
    own = own_frames(records)
    if not is_refined(options) or len(own) < 2:
        return records
    threads = torch.get_num_threads()
    with one_thread():
        lobes, losses = refine_shot(
            stack([record.lobes for record in own]),
            lambda: _chunks(again(), len(own), options),
            REFINEMENT[options.preset],
            threads=threads,
            on_chunk=lambda done, count: on_progress(Refined(done, count)),
        )
    return [
        replace(record, lobes=lobes[place], loss=losses[place])
        for record, place in zip(records, places_of(records), strict=True)
    ]


def is_refined(options: FitOptions) -> bool:
    """Tell whether the preset reads a shot again."""
    return options.preset in REFINEMENT


def _chunks(images: Iterator[Tensor], count: int, options: FitOptions) -> Iterator[list[Exposed]]:
    """Take the frames once more, a few at a time."""
    chunk: list[Exposed] = []
    for place, radiance in enumerate(images, 1):
        chunk.append(exposed(radiance.to(options.device)))
        if len(chunk) == CHUNK or place == count:
            yield chunk
            chunk = []


def _unchanged(
    records: list[FrameRecord], sequence: Sequence, kept: KeptFrames
) -> Iterator[Tensor]:
    """Read the frames once more."""
    with contextlib.closing(kept.again([record.frame for record in records])) as images:
        for record, read in zip(records, images, strict=True):
            if read.stamp != record.stamp:
                raise InputError(
                    f"{shown(sequence.path(record.frame))}: has changed since frame "
                    f"{record.frame} was fitted; expected the same image. Start afresh."
                )
            yield read.radiance
