# SPDX-License-Identifier: Apache-2.0
"""The first reading of a shot: every frame in order, each from the ones before."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import fit_frame
from asglight.images import Sequence
from asglight.images.message import shown
from asglight.lobes import Lobes
from asglight.shots.events import FrameDone, OnProgress, StepDone
from asglight.shots.kept.kept_frames import KeptFrames
from asglight.shots.kept.records import FrameRecord, own_frames, repeated_by
from asglight.shots.reading import ReadFrame, read_ahead

RADIANCE_MAX = 1e36
"""A texel of it may become a lobe of four times its radiance, whose lights `write_usd` still takes.
The largest number of float32, 3.4e38, stands for nothing or for infinity in many files."""

RECENT_FRAMES = 8
"""Frames whose mean time foretells the rest: enough to smooth, few enough to follow a change."""


OnImage = Callable[[int, Tensor], None]
"""Called with the number and the radiance [H, 2 H, 3] of each frame that repeats no other."""


def no_image(frame: int, radiance: Tensor) -> None:
    """Take an image and do nothing with it."""


def fit_frames(
    sequence: Sequence,
    options: FitOptions,
    done: list[FrameRecord],
    on_progress: OnProgress,
    on_image: OnImage = no_image,
    start: list[Lobes] | None = None,
    images: KeptFrames | None = None,
) -> Iterator[FrameRecord]:
    """Fit the frames that follow those that are done.

    A frame whose pixels equal those of the frame before takes its lobes; what the next frame starts
    from are the last two frames that differ. The `paper` preset fits every frame, as published.

    Args:
        sequence: The frames.
        options: Settings of the fit.
        done: Frames of an earlier run.
        on_progress: Called with each event.
        on_image: Called with each image that is fitted.
        start: Lobes of up to two frames before the first one; without them it begins from nothing.
        images: What is known of the images, and keeps those that are read; None to read each once.
    """
    before = [*(start or []), *(record.lobes for record in own_frames(done))][-2:]
    last = done[-1] if done else None
    frames = list(sequence.frames[len(done) :])
    previous: Tensor | None = None
    if last is not None and frames and options.preset is not Preset.PAPER:
        previous = sequence.read_or_fill(last.frame).radiance
    reads = read_ahead(sequence, frames) if images is None else images.first(frames)
    with contextlib.closing(reads):
        for frame in frames:
            begin = time.perf_counter()
            read = next(reads)
            if (
                last is not None
                and previous is not None
                and torch.equal(read.image.radiance, previous)
            ):
                record = _repeated(frame, read, last, begin)
            else:
                on_image(frame, read.image.radiance)
                record = _fit_one(frame, read, options, before, on_progress, begin)
                before = [*before[-1:], record.lobes]
            last = record
            previous = None if options.preset is Preset.PAPER else read.image.radiance
            yield record


def _repeated(frame: int, read: ReadFrame, last: FrameRecord, begin: float) -> FrameRecord:
    """Return a frame that shows what the one before shows."""
    return replace(
        last,
        frame=frame,
        repair=read.image.repair,
        stamp=read.stamp,
        seconds=time.perf_counter() - begin,
        repeats=repeated_by(last),
    )


def _fit_one(
    frame: int,
    read: ReadFrame,
    options: FitOptions,
    before: list[Lobes],
    on_progress: OnProgress,
    begin: float,
) -> FrameRecord:
    """Fit one frame; what the next one starts from is exactly what a checkpoint keeps.

    Raises:
        InputError: It is brighter than lights can be.
    """
    brightest = float(read.image.radiance.max())
    if brightest > RADIANCE_MAX:
        raise InputError(
            f"{shown(read.image.path)}: has a radiance of {brightest:.2g}; expected at most "
            f"{RADIANCE_MAX:g}, so that lights can have numbers. Mask what stands for no light, or "
            "divide the images by a constant."
        )
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
        last.repeats,
    )
