# SPDX-License-Identifier: Apache-2.0
"""An image sequence: which frames it has, which are missing, and reading them one at a time.

A still is a sequence of one frame. Nothing is kept between two reads, so the memory needed does
not grow with the length.
"""

import bisect
import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

from asglight.errors import InputError
from asglight.images import frame_files
from asglight.images.decoding.decoders import APART
from asglight.images.decoding.header import DamagedError, Header
from asglight.images.frame_files import FrameFiles, frame_set, ranges
from asglight.images.latlong_image import (
    LatlongImage,
    check_height,
    read_header,
    read_latlong,
)
from asglight.images.likeness import check_same
from asglight.images.message import shown
from asglight.images.options import ReadOptions

# Over an hour at 24 frames a second; beyond it a number in a file name is a date, not a frame.
FRAMES_MAX = 100_000

Missing = Literal["error", "hold", "interpolate"]


@dataclass(frozen=True)
class Sequence:
    """Latlong images by frame number.

    Iteration yields one `LatlongImage` a frame, in the order of `frames`, each read when its turn
    comes.

    Attributes:
        source: The files on disk.
        frames: Frame numbers to use, ascending; they are the USD time codes.
        missing_frames: Those of `frames` without a file.
        missing: What stands in for them: the frame before (`hold`) or the neighbours' mean by
            distance in time, in radiance (`interpolate`). At either end the nearest frame is held.
        height: Rows that larger images are reduced to; None keeps their size.
        reading: Which image of each file is read, in which colours, and how much may be lost.
    """

    source: FrameFiles
    frames: tuple[int, ...]
    missing_frames: tuple[int, ...] = ()
    missing: Missing = "error"
    height: int | None = None
    reading: ReadOptions = field(default_factory=ReadOptions)

    @property
    def name(self) -> str:
        """Return a short name, `sky` for `sky.####.exr`."""
        return self.source.name

    @property
    def pattern(self) -> str:
        """Return the files as a pattern, one `#` a digit; for a still, its path."""
        return self.source.pattern

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.frames)

    def __iter__(self) -> Iterator[LatlongImage]:
        """Read the frames one after the other."""
        return map(self.read, self.frames)

    def path(self, frame: int) -> Path:
        """Return the file a frame is read from; for a missing one, the first that stands in.

        Raises:
            InputError: The sequence has no such frame.
        """
        return self.source.files[self._read_from(frame)[0]]

    def read(self, frame: int) -> LatlongImage:
        """Read a frame; `repair` says when another one, or two, stand in for a missing one.

        Raises:
            DamagedError: Its file cannot be decoded.
            InputError: The sequence has no such frame, or its file cannot be used.
        """
        sources = self._read_from(frame)
        return self._read_file(frame) if sources == (frame,) else self._filled(frame, sources)

    def read_or_fill(self, frame: int) -> LatlongImage:
        """Read a frame as `read`; a damaged file is treated as a missing one is (`missing`).

        Raises:
            InputError: As `read`; where damaged files are to be filled, every file is damaged.
        """
        damaged: dict[int, DamagedError] = {}
        sources = self._read_from(frame)
        while True:
            try:
                if sources == (frame,):
                    return self._read_file(frame)
                return self._filled(frame, sources, damaged.get(frame))
            except DamagedError as error:
                if self.missing == "error" or error.frame is None or error.frame in damaged:
                    raise
                damaged[error.frame] = error
                existing = [one for one in self.source.files if one not in damaged]
                if not existing:
                    raise
                sources = self._stand_ins(frame, existing)

    def _filled(
        self, frame: int, sources: tuple[int, ...], fault: DamagedError | None = None
    ) -> LatlongImage:
        """Return a frame made of another one or of two."""
        before = self._read_file(sources[0])
        if len(sources) == 1:
            radiance, account = before.radiance, before.repair
        else:
            after = self._read_file(sources[1])
            weight = (frame - sources[0]) / (sources[1] - sources[0])
            radiance = before.radiance.lerp(after.radiance, weight)
            account = before.repair.merged(after.repair)
        finding = "missing" if fault is None else fault.finding
        account = dataclasses.replace(account, filled_from=sources, fault=finding)
        return dataclasses.replace(before, radiance=radiance, repair=account)

    def _read_from(self, frame: int) -> tuple[int, ...]:
        """Return the existing frames that a frame is made of: itself, one, or two neighbours."""
        if frame not in self.frames:
            raise InputError(
                f"{self.name}: has no frame {frame}; expected one of {ranges(self.frames)}."
            )
        if frame in self.source.files:
            return (frame,)
        return self._stand_ins(frame, list(self.source.files))

    def _stand_ins(self, frame: int, existing: list[int]) -> tuple[int, ...]:
        """Return which of some other frames, in ascending order, stand in for a frame."""
        after = bisect.bisect(existing, frame)
        if after == 0:
            return (existing[0],)
        if after == len(existing) or self.missing != "interpolate":
            return (existing[after - 1],)
        return (existing[after - 1], existing[after])

    def _read_file(self, frame: int) -> LatlongImage:
        try:
            image = read_latlong(
                self.source.files[frame], height=self.height, reading=self.named, decoder=APART
            )
        except DamagedError as error:
            error.frame = frame
            raise
        check_same(image.header, frame, self.model, self.first, self.height)
        return image

    @property
    def model(self) -> Header:
        """Return the header of the first frame that can be read, which all others have to match."""
        return self._model[1]

    @property
    def first(self) -> int:
        """Return the number of that frame."""
        return self._model[0]

    @property
    def named(self) -> ReadOptions:
        """Return how every frame is read: what the first one's image is called is read of all."""
        name = self.reading.layer or next(iter(self.model.layer.names), None)
        return replace(self.reading, layer=name)

    @cached_property
    def _model(self) -> tuple[int, Header]:
        """Return the first frame whose header can be read, and that header."""
        first = self._read_from(self.frames[0])[0]
        candidates = [first, *(frame for frame in self.source.files if frame > first)]
        for frame in candidates:
            try:
                return frame, read_header(self.source.files[frame], self.reading, APART)
            except DamagedError as error:
                if self.missing == "error" or frame == candidates[-1]:
                    error.frame = frame
                    raise
        raise AssertionError(candidates)


def open_sequence(
    source: str | Path,
    *,
    frames: str | None = None,
    missing: Missing = "error",
    height: int | None = None,
    reading: ReadOptions = ReadOptions(),  # noqa: B008  frozen, so one default serves all calls
) -> Sequence:
    """Find the frames of a still, a folder or a pattern; read none of them.

    Without `frames` and without a range in the pattern, the frames are those on disk, from the
    first to the last, by the largest step that meets them all: 1001, 1003, 1007 is a sequence on
    twos that lacks 1005.

    Args:
        source: A file; a folder that holds one image or one sequence; or a pattern such as
            `sky.####.exr`, `sky.%04d.exr`, `sky.@@@@.exr`, `sky.1001-1048x2#.exr`.
        frames: Frames to use, such as `1001-1048`, `1001-1048x2` or `5,7,9`.
        missing: `error`, or what stands in for a missing frame: `hold` or `interpolate`.
        height: Rows that larger images are reduced to; None keeps their size.
        reading: Which image of each file is read, in which colours, and how much may be lost.

    Raises:
        InputError: Nothing is there, or it is not one sequence, or frames are missing.
    """
    check_height(height)
    reading.check()
    if missing not in get_args(Missing):
        raise InputError(
            f"missing: {shown(missing)}; expected one of {', '.join(get_args(Missing))}."
        )
    found = frame_files.find(source)
    wanted = _wanted(found, frames)
    absent = tuple(frame for frame in wanted if frame not in found.files)
    if len(absent) == len(wanted):
        raise InputError(
            f"{found.name}: has none of the frames {ranges(wanted)}; expected some of "
            f"{ranges(tuple(found.files))}, which are there. Check the frame range."
        )
    if absent and missing == "error":
        count = f"{len(absent)} {'frame' if len(absent) == 1 else 'frames'} missing"
        raise InputError(
            f"{found.name}: {count} ({ranges(absent)}); expected every frame of "
            f"{_span(wanted)}. Use --missing hold or --missing interpolate, or choose --frames."
        )
    return Sequence(found, wanted, absent, missing, height, reading)


def _wanted(found: FrameFiles, frames: str | None) -> tuple[int, ...]:
    """Return the frames to use, whether or not they are there."""
    if frames is None:
        return found.asked or _regular(tuple(found.files))
    wanted = frame_set(frames, "frames")
    outside = tuple(sorted(set(wanted) - set(found.asked or wanted)))
    if outside:
        raise InputError(
            f"frames: {ranges(outside)}; expected only frames of the pattern, "
            f"{ranges(found.asked or ())}. Change one of the two ranges."
        )
    return wanted


def _regular(existing: tuple[int, ...]) -> tuple[int, ...]:
    """Return the frames from first to last, by the largest step that meets all that exist."""
    step = math.gcd(*(after - before for before, after in itertools.pairwise(existing))) or 1
    if (existing[-1] - existing[0]) // step >= FRAMES_MAX:
        raise InputError(
            f"frames: run from {existing[0]} to {existing[-1]}; expected fewer than {FRAMES_MAX}. "
            "Is one of the numbers a date or a version? Give --frames."
        )
    return tuple(range(existing[0], existing[-1] + 1, step))


def _span(frames: tuple[int, ...]) -> str:
    return str(frames[0]) if len(frames) == 1 else f"{frames[0]}-{frames[-1]}"
