# SPDX-License-Identifier: Apache-2.0
"""The frames before a part of a shot: followed, so that parts fitted apart have the same lobes.

Two fits from nothing divide a sky differently, so a part that began from nothing would share few
lobes with its neighbours. A part with a preroll begins as the shot does: the shot's first frame is
fitted, and its lobes are followed to the part: most of the way with the steps of `live`, a quarter
of the work of `fast`, over the last frames with those of the part itself. Nothing of it is kept.
Every part of a shot thus has the lobes of one and the same first frame, in the same order.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

from asglight.errors import InputError
from asglight.fitting.options import FitOptions, Preset
from asglight.images import Sequence, open_sequence
from asglight.lobes import Lobes
from asglight.shots.events import OnProgress, Prerolled, ignore
from asglight.shots.frames import fit_frames
from asglight.shots.kept.records import FrameRecord, own_frames

SETTLING = 8
"""Frames before a part that are followed with its own steps: with none, white balls are off by up
to 13 % more over the seams of `handheld` than in one fit; with 8 by 1 %."""


@dataclass(frozen=True)
class Followed:
    """Where the lobes are that are followed through a shot.

    Attributes:
        frame: The last frame that was followed.
        lobes: Those of the last frames that repeat no other, at most two, as fitted.
    """

    frame: int
    lobes: tuple[Lobes, ...]


def check_preroll(options: FitOptions, first: int) -> None:
    """Refuse a preroll that begins too late, or that the fit has no use for.

    Args:
        options: Settings of the fit.
        first: The first frame to fit.

    Raises:
        InputError: It does.
    """
    if options.preroll is None:
        return
    if options.preroll > first:
        raise InputError(
            f"preroll: {options.preroll}; expected {first}, the first frame to fit, or one before "
            "it: the first of the shot."
        )
    if options.preset is Preset.PAPER:
        raise InputError(
            f"preroll: {options.preroll} with --preset paper, which is as published; expected "
            "--preset live, fast or best."
        )
    if options.tolerance is not None:
        raise InputError(
            f"preroll: {options.preroll} with a tolerance, which gives every part a number of "
            "lobes of its own; expected --lobes."
        )


def start_of(
    sequence: Sequence, options: FitOptions, known: Followed | None, on_progress: OnProgress
) -> list[Lobes]:
    """Return what the first frame of a part starts from: the lobes of up to two frames before it.

    Args:
        sequence: The part.
        options: Settings of the fit; without a preroll there is nothing to start from.
        known: What `follow` returned for this part, where it was called.
        on_progress: Called with each frame.

    Raises:
        InputError: A frame of the preroll is missing or cannot be read.
    """
    before = preroll_frames(sequence.frames, options.preroll)
    if not before:
        return []
    _opened(sequence, before)  # a frame that is missing is told before the first is fitted
    tell = _counter(len(before), on_progress)
    tell(len(before) - SETTLING if known is not None else 0)
    known = known or follow(sequence, options, None, tell)
    rest = before[-SETTLING:]
    state = _followed(sequence, options, rest, known, lambda: tell(1))
    return list(state.lobes)


def follow(
    sequence: Sequence,
    options: FitOptions,
    known: Followed | None,
    tell: Callable[[int], None] = lambda count: None,
) -> Followed | None:
    """Follow the lobes of a shot, with the steps of `live`, to `SETTLING` frames before a part.

    Args:
        sequence: The part.
        options: Settings of the fit.
        known: How far they were followed before, for an earlier part of the shot.
        tell: Called with 1 after each frame.

    Returns:
        None where the part begins within the first `SETTLING` frames.

    Raises:
        InputError: A frame is missing or cannot be read.
    """
    frames = preroll_frames(sequence.frames, options.preroll)[:-SETTLING]
    frames = [frame for frame in frames if known is None or frame > known.frame]
    if not frames:
        return known
    if known is None:  # the first frame of the first part too is fitted with its own preset
        known = _followed(sequence, options, frames[:1], None, lambda: tell(1))
        frames = frames[1:]
    if not frames:
        return known
    live = replace(options, preset=Preset.LIVE)
    return _followed(sequence, live, frames, known, lambda: tell(1))


def preroll_frames(frames: tuple[int, ...], first: int | None) -> list[int]:
    """Return the frames of the shot before a part, by the part's own step."""
    if first is None:
        return []
    step = min((after - before for before, after in itertools.pairwise(frames)), default=1)
    return list(range(frames[0] - step, first - 1, -step))[::-1]


def _followed(
    sequence: Sequence,
    options: FitOptions,
    frames: list[int],
    known: Followed | None,
    tell: Callable[[], None],
) -> Followed:
    """Follow the lobes through frames that are not empty."""
    through = _opened(sequence, frames)
    start = [] if known is None else list(known.lobes)
    records: list[FrameRecord] = []
    for record in fit_frames(through, options, [], ignore, start=start):
        records = [*own_frames(records)[-2:], record]
        tell()
    lobes = [*start, *(record.lobes for record in own_frames(records))]
    return Followed(frames[-1], tuple(lobes[-2:]))


def _opened(sequence: Sequence, frames: list[int]) -> Sequence:
    """Find other frames of a sequence."""
    return open_sequence(
        sequence.pattern,
        frames=",".join(map(str, frames)),
        missing=sequence.missing,
        height=sequence.height,
        reading=sequence.reading,
    )


def _counter(frames: int, on_progress: OnProgress) -> Callable[[int], None]:
    """Return what counts frames and tells how many there were."""
    done = 0

    def tell(count: int) -> None:
        nonlocal done
        if count > 0:
            done += count
            on_progress(Prerolled(done, frames))

    return tell
