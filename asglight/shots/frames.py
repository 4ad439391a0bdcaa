# SPDX-License-Identifier: Apache-2.0
"""The first reading of a shot: every frame in order, each from the ones before."""

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial

import torch
from torch import Tensor

from asglight.errors import InputError
from asglight.fitting.first_frame.fit import FrameFit
from asglight.fitting.options import FitOptions, Preset
from asglight.fitting.sequence import Following
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

    A frame whose pixels equal those of the frame before takes its lobes, unless they can be
    followed to better ones (`Following.take`). The `paper` preset fits every frame, as published.

    Args:
        sequence: The frames.
        options: Settings of the fit.
        done: Frames of an earlier run.
        on_progress: Called with each event.
        on_image: Called with each image that is fitted.
        start: Lobes of up to two frames before the first one; without them it begins from nothing.
        images: What is known of the images, and keeps those that are read; None to read each once.
    """
    frames = list(sequence.frames[len(done) :])
    if not frames:
        return
    following = _following(sequence, options, done, start or [])
    last = done[-1] if done else None
    reads = read_ahead(sequence, frames) if images is None else images.first(frames)
    with contextlib.closing(reads):
        for frame in frames:
            begin = time.perf_counter()
            read = next(reads)
            _check_radiance(read)
            is_own = following.take(
                read.image.radiance.to(options.device),
                partial(_tell_step, on_progress, frame),
            )
            assert following.last is not None
            if is_own:
                on_image(frame, read.image.radiance)
            last = _record(frame, read, following.last, None if is_own else last, begin)
            yield last


def _tell_step(on_progress: OnProgress, frame: int, step: int, steps: int, loss: float) -> None:
    """Tell of a step within a frame."""
    on_progress(StepDone(frame, step, steps, loss))


def _following(
    sequence: Sequence, options: FitOptions, done: list[FrameRecord], start: list[Lobes]
) -> Following:
    """Go on where the frames of an earlier run end; what it needs is what a checkpoint keeps."""
    before = [*start, *(record.lobes for record in own_frames(done))]
    own = [lobes.to(options.device) for lobes in before[-2:]]
    if not done or options.preset is Preset.PAPER:
        return Following(options, own)
    last = done[-1]
    return Following(
        options,
        own,
        FrameFit(own[-1], last.loss, last.flux_error),
        sequence.read_or_fill(last.frame).radiance.to(options.device),
        is_settled=last.repeats is not None or len(before) == 1,
    )


def _check_radiance(read: ReadFrame) -> None:
    """Refuse an image that is brighter than lights can be."""
    brightest = float(read.image.radiance.max())
    if brightest > RADIANCE_MAX:
        raise InputError(
            f"{shown(read.image.path)}: has a radiance of {brightest:.2g}; expected at most "
            f"{RADIANCE_MAX:g}, so that lights can have numbers. Mask what stands for no light, or "
            "divide the images by a constant."
        )


def _record(
    frame: int, read: ReadFrame, fit: FrameFit, repeated: FrameRecord | None, begin: float
) -> FrameRecord:
    """Return what is kept of a frame; what the next one starts from is exactly that.

    Args:
        frame: Its number.
        read: The image.
        fit: Its lobes.
        repeated: The frame before, if it keeps the fit of that.
        begin: When it began, of `time.perf_counter`.
    """
    lobes = fit.lobes.to("cpu", torch.float32) if repeated is None else repeated.lobes
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
        repeats=None if repeated is None else repeated_by(repeated),
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
