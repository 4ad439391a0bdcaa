# SPDX-License-Identifier: Apache-2.0
"""The first reading of a shot: every frame in order, each from the ones before."""

import contextlib
import time
from collections.abc import Iterator

import torch

from asglight.fitting.options import FitOptions
from asglight.fitting.sequence import fit_frame
from asglight.images import Sequence
from asglight.lobes import Lobes
from asglight.shots.events import FrameDone, OnProgress, StepDone
from asglight.shots.reading import ReadFrame, read_ahead
from asglight.shots.records import FrameRecord

RECENT_FRAMES = 8
"""Frames whose mean time foretells the rest: enough to smooth, few enough to follow a change."""


def fit_frames(
    sequence: Sequence, options: FitOptions, done: list[FrameRecord], on_progress: OnProgress
) -> Iterator[FrameRecord]:
    """Fit the frames that follow those that are done."""
    before = [record.lobes for record in done[-2:]]
    frames = list(sequence.frames[len(done) :])
    with contextlib.closing(read_ahead(sequence, frames)) as images:
        for frame in frames:
            begin = time.perf_counter()
            record = _fit_one(frame, next(images), options, before, on_progress, begin)
            before = [*before[-1:], record.lobes]
            yield record


def _fit_one(
    frame: int,
    read: ReadFrame,
    options: FitOptions,
    before: list[Lobes],
    on_progress: OnProgress,
    begin: float,
) -> FrameRecord:
    """Fit one frame; what the next one starts from is exactly what a checkpoint keeps."""
    there = [lobes.to(options.device) for lobes in before]
    fit = fit_frame(
        read.image.radiance.to(options.device),
        options,
        there[-1] if there else None,
        there[-2] if len(there) > 1 else None,
        lambda step, steps, loss: on_progress(StepDone(frame, step, steps, loss)),
    )
    lobes = fit.lobes.to("cpu", torch.float32)
    numbers = torch.cat(
        [lobes.axes.flatten(), lobes.sharpness.flatten(), lobes.amplitude.flatten()]
    )
    if not bool(torch.isfinite(numbers).all()):
        raise RuntimeError(f"frame {frame}: the fit has values that are not finite")
    return FrameRecord(
        frame=frame,
        lobes=lobes,
        loss=float(fit.loss),
        flux_error=float(fit.flux_error),
        repair=read.image.repair,
        stamp=read.stamp,
        seconds=time.perf_counter() - begin,
    )


def frame_done(records: list[FrameRecord], resumed: int, frames: int) -> FrameDone:
    """Return the event of the last record."""
    last = records[-1]
    recent = records[resumed:][-RECENT_FRAMES:]
    # A shot's first frame is fitted from nothing and takes several times longer than the others.
    if len(recent) > 1 and recent[0] is records[0]:
        recent = recent[1:]
    mean = sum(record.seconds for record in recent) / len(recent)
    left = mean * (frames - len(records))
    return FrameDone(
        last.frame,
        len(records),
        frames,
        last.loss,
        last.flux_error,
        last.seconds,
        left,
        last.repair,
    )
