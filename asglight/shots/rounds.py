# SPDX-License-Identifier: Apache-2.0
"""All frames of a shot, fitted once or, with a tolerance, as often as it takes."""

from dataclasses import dataclass, field, replace
from typing import Protocol

from asglight.fitting.options import FitOptions
from asglight.images import Sequence
from asglight.lobes import Lobes
from asglight.lobes.data import stack
from asglight.shots.events import Notice, OnProgress, Started
from asglight.shots.frames import OnImage, fit_frames, frame_done, no_image
from asglight.shots.kept.kept_frames import KeptFrames
from asglight.shots.kept.records import FrameRecord, own_frames
from asglight.shots.parts.preroll import Followed, start_of
from asglight.shots.refining import is_refined, refined
from asglight.shots.tolerance import Accuracy, Worst, fewest_lobes, more_lobes, worst


class Kept(Protocol):
    """Where the frames of the first reading are kept: a checkpoint, or memory."""

    records: list[FrameRecord]

    def append(self, record: FrameRecord) -> None:
        """Keep a frame."""
        ...

    def restart(self) -> None:
        """Forget every frame."""
        ...


@dataclass
class InMemory:
    """Keeps frames in memory."""

    records: list[FrameRecord] = field(default_factory=list)

    def append(self, record: FrameRecord) -> None:
        """Keep a frame."""
        self.records.append(record)

    def restart(self) -> None:
        """Forget every frame."""
        self.records = []


@dataclass(frozen=True)
class FittedShot:
    """The frames of a shot.

    Attributes:
        records: Every frame, in order.
        options: The settings, with the number of lobes.
        resumed: How many frames came from an earlier run.
        accuracy: Knows every frame, where the shot has a tolerance.
    """

    records: list[FrameRecord]
    options: FitOptions
    resumed: int
    accuracy: Accuracy | None = None


def fitted_shot(
    sequence: Sequence,
    options: FitOptions,
    kept: Kept,
    images: KeptFrames,
    on_progress: OnProgress,
    followed: Followed | None = None,
) -> FittedShot:
    """Fit the frames that are not kept yet; with a tolerance, all again where one misses it.

    Frames of an earlier run tell the number of lobes they were fitted with, so that it is searched
    once and a resumed run comes to the same lobes as an unbroken one.

    Args:
        sequence: The shot.
        options: Settings, as `FitOptions.settled` returns them.
        kept: Frames of an earlier run; takes those of this one.
        images: What the frames show; takes them as they are read.
        on_progress: Called with each event.
        followed: Where the preroll has been already, if it has (preroll.py).

    Raises:
        InputError: A frame cannot be read, or has changed since it was fitted.
    """
    resumed = len(kept.records)
    on_progress(Started(len(sequence), resumed))
    if options.tolerance is None or options.max_lobes is None:
        # a frame starts from the two before it, so the third needs no preroll
        is_begun = len(own_frames(kept.records)) >= 2
        start = [] if is_begun else start_of(sequence, options, followed, on_progress)
        records = _round(sequence, options, kept, images, resumed, on_progress, no_image, start)
        return FittedShot(records, options, resumed)
    accuracy = Accuracy(options.tolerance)
    if kept.records:
        count = options.lobes_of(kept.records[-1].lobes.count)
    else:
        count = fewest_lobes(sequence, images, options, accuracy, on_progress)
    while True:
        counted = replace(options, lobes=count)
        records = _round(sequence, counted, kept, images, resumed, on_progress, accuracy.see)
        own = own_frames(records)
        frames = [record.frame for record in own]
        accuracy.see_all(images, frames)
        found = accuracy.errors(frames, stack([record.lobes for record in own]))
        furthest = max(worst(frames, found), key=lambda one: one.value)
        if furthest.value <= accuracy.limit or count >= options.max_lobes:
            return FittedShot(records, counted, resumed, accuracy)
        before = count
        count = more_lobes(count, furthest.value / accuracy.limit, options.max_lobes)
        on_progress(Notice(_again(furthest, accuracy.tolerance, before, count)))
        kept.restart()
        resumed = 0
        on_progress(Started(len(sequence), 0))


def is_read_again(options: FitOptions) -> bool:
    """Tell whether a shot's images are needed more than once."""
    return options.tolerance is not None or is_refined(options)


def _round(
    sequence: Sequence,
    options: FitOptions,
    kept: Kept,
    images: KeptFrames,
    resumed: int,
    on_progress: OnProgress,
    on_image: OnImage,
    start: list[Lobes] | None = None,
) -> list[FrameRecord]:
    """Fit the frames that are not kept yet, and refine them all."""
    done = kept.records
    for record in fit_frames(sequence, options, done, on_progress, on_image, start, images):
        kept.append(record)
        on_progress(frame_done(kept.records, resumed, len(sequence)))
    return refined(kept.records, sequence, images, options, on_progress)


def _again(furthest: Worst, tolerance: float, before: int, count: int) -> str:
    lobes = f"{before} {'lobe' if before == 1 else 'lobes'}"
    return (
        f"tolerance {tolerance:g}: {furthest.name} is {furthest.value:.4f} in frame "
        f"{furthest.frame} with {lobes}; fitting the shot again with {count}"
    )
